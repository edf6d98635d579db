"""Reads one file in a process of its own and sends it group by group, part by part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from nurbs_cache.errors import InputFileError
from nurbs_ooc.readers.iges import IgesFile
from nurbs_ooc.readers.isolation import PART_LIMIT_S, WorkDiedError, run_isolated
from nurbs_ooc.readers.leftover import Leftover
from nurbs_ooc.readers.messages import Failed, Finished, Message, Opened, PartData, Scene, Transferred
from nurbs_ooc.readers.part_geometry import crashed_part, isolated_parts
from nurbs_ooc.readers.products import ProductTree
from nurbs_ooc.readers.step import StepFile

Send = Callable[[Message], None]
TRANSFER_S_PER_MB = 20.0  # s/MB of STEP that a transfer may take; 0.3 is usual
FORMATS: dict[str, type[StepFile] | type[IgesFile]] = {"step": StepFile, "iges": IgesFile}


class KernelFile(Protocol):
    """A parsed file of one format."""

    def unit(self) -> tuple[str, float]:
        """Name and size in mm of the file's length unit."""
        ...

    def groups(self) -> list[list[int]]:
        """Root numbers that are transferred together."""
        ...

    def transfer(self, roots: list[int]) -> Any:
        """A document with these roots, or None."""
        ...

    def transferred(self) -> set[int]:
        """What the last ``transfer`` made shapes of."""
        ...

    def leftovers(self, transferred: set[int]) -> list[Leftover]:
        """What no transfer made a shape of."""
        ...


def serve_file(send: Send, path: str, shown: str, kind: str) -> None:
    """Send everything there is in ``path``; ``kind`` is "step" or "iges"."""
    try:
        file: KernelFile = FORMATS[kind](path, shown)
        groups = file.groups()
        send(Opened(*file.unit(), n_groups=len(groups)))
        limit_s = 2.0 * PART_LIMIT_S + TRANSFER_S_PER_MB * Path(path).stat().st_size / 1e6
        transferred: set[int] = set()
        for roots in groups:
            transferred |= _serve_group(send, file, roots, shown if len(groups) == 1 else "", limit_s)
        _serve_leftovers(send, file, transferred)
    except InputFileError as error:
        send(Failed(str(error)))
    else:
        send(Finished())


def _serve_group(send: Send, file: KernelFile, roots: list[int], alone: str, limit_s: float) -> set[int]:
    """Transfer ``roots`` behind a fork, so that their shapes are released with it.

    Args:
        alone: the file's name if this is its only group: without it there is nothing.
        limit_s: silence after which the transfer counts as hung.
    """
    transferred: set[int] = set()
    scene: Scene | None = None
    sent = 0
    try:
        for message in run_isolated(lambda inner: _transfer_and_read(inner, file, roots), limit_s):
            if isinstance(message, Transferred):
                transferred = message.entities
                continue
            scene = message if isinstance(message, Scene) else scene
            sent += isinstance(message, PartData)
            send(message)
    except WorkDiedError as death:
        if scene is None and alone:
            raise InputFileError(f"{alone}: the kernel crashed while reading it ({death})") from death
        if scene is None:
            return set()  # its faces are among the leftovers
        for name, n_faces in list(zip(scene.part_names, scene.part_faces, strict=True))[sent:]:
            send(PartData(crashed_part(n_faces, name).to_bytes()))
    return transferred


def _transfer_and_read(send: Send, file: KernelFile, roots: list[int]) -> None:
    document = file.transfer(roots)
    tree = ProductTree()
    if document is not None:
        tree.add_document(document)
    send(Transferred(file.transferred()))
    send(tree.scene())
    for data in isolated_parts(tree.parts):
        send(PartData(data))


def _serve_leftovers(send: Send, file: KernelFile, transferred: set[int]) -> None:
    tree = ProductTree()
    for name, rgb, record in file.leftovers(transferred):
        tree.add_single(name, rgb, record)
    if tree.parts:
        send(tree.scene())
    for part in tree.parts:
        send(PartData(part.record().to_bytes()))
