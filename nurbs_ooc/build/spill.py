"""The folder of a build's intermediate files, beside its cache; it is gone when the build ends.

::

    CACHE.partial/             the store while it is built
    CACHE.spill/
        000000000512.boxes     placed surfaces of the run that begins with surface 512
        000000000512.meshes    its tessellations at every level that a node needs

A file appears whole, by one rename, so what is there after a kill is used again. After Ctrl-C or a kill the
folder stays for ``--resume``; after an error it is removed, for it may be what fills the disk.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from nurbs_cache.errors import CacheError


def spill_path(cache: Path) -> Path:
    """The folder for the intermediate files of the cache ``cache``."""
    return cache.with_name(cache.name + ".spill")


@contextlib.contextmanager
def spill_folder(cache: Path, *, fresh: bool) -> Iterator[Path]:
    """Make the folder; remove it when the block ends, unless it was interrupted.

    Args:
        cache: the folder that the user named.
        fresh: do not use what a former build has left.

    Raises:
        CacheError: it cannot be made.
    """
    folder = spill_path(cache)
    if fresh:
        _remove(folder)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise CacheError(f"{folder}: cannot be made: {error.strerror}") from error
    try:
        yield folder
    except KeyboardInterrupt:
        raise
    except BaseException:
        _remove(folder)
        raise
    _remove(folder)


def _remove(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder)


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Write a file that appears under its name when the block ends well.

    Raises:
        CacheError: the disk is full, a limit is reached, the folder is gone.
    """
    unfinished = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        with unfinished.open("wb") as file:
            yield file
        unfinished.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise CacheError(f"{path}: cannot be written: {error.strerror}") from error
