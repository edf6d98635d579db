"""The reader for all formats that go through the CAD kernel."""

from __future__ import annotations

from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import InputFileError
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.builder import EDGE_ID_PART_SHIFT
from nurbs_ooc.readers.assembly import Part
from nurbs_ooc.readers.input_file import InputFile
from nurbs_ooc.readers.kernel_client import open_session
from nurbs_ooc.readers.messages import Failed, Finished, Message, Opened, PartData, Scene


class KernelReader:
    """An ``AssemblyReader`` over the messages of a kernel session.

    Groups of root shapes arrive one after the other; their rows are moved behind those that are
    already here, equal materials are merged.
    """

    def __init__(self, file: InputFile) -> None:
        self.path: Path = file.shown
        self.products: list[Product] = []
        self.materials: list[Material] = []
        self._file = file
        self._placements: list[tuple[int, int, int, list[float]]] = []
        self._part_names: list[str] = []
        self._n_faces = 0
        self._finished = False
        self._material_rows = np.zeros(1, np.int32)
        self._messages: Connection = open_session(str(file.plain.resolve()), str(file.shown), file.kind)
        try:
            opened = self._receive()
            assert isinstance(opened, Opened)
            self.file_unit, self.unit_mm = opened.file_unit, opened.unit_mm
            self._groups_left = opened.n_groups
            self._take_scenes()
        except BaseException:
            self.close()
            raise

    @property
    def occurrences(self) -> npt.NDArray[np.void]:
        """``OCCURRENCE_DTYPE`` of all groups so far."""
        rows = [(part, product, material, np.reshape(t, (3, 4))) for part, product, material, t in self._placements]
        return np.array(rows, OCCURRENCE_DTYPE)

    @property
    def n_parts(self) -> int:
        """Parts of all groups so far."""
        return len(self._part_names)

    @property
    def n_surfaces(self) -> int | None:
        """Surfaces of all parts, None while groups are still to come."""
        return self._n_faces if self._finished or self._groups_left == 0 else None

    def parts(self) -> Iterator[Part]:
        """See ``AssemblyReader``."""
        index = first_surface = 0
        while index < self.n_parts:
            message = self._receive()
            assert isinstance(message, PartData)
            geometry = self._placed_in_scene(GeometryBatch.from_bytes(message.data), index)
            info = PartInfo(self._part_names[index], len(geometry), first_surface)
            yield Part(index, info, geometry)
            first_surface += len(geometry)
            index += 1
            if index == self.n_parts:
                self._take_scenes()

    def _placed_in_scene(self, geometry: GeometryBatch, index: int) -> GeometryBatch:
        edge_ids = np.arange(len(geometry.edges), dtype=np.uint64)
        geometry.edges["id"] = edge_ids | np.uint64(index << EDGE_ID_PART_SHIFT)
        geometry.surfaces["material"] = self._material_rows[geometry.surfaces["material"]]
        return geometry

    def _take_scenes(self) -> None:
        """Take in scenes until one has parts to be read, or the end."""
        while not self._finished:
            message = self._receive()
            if isinstance(message, Finished):
                self._finished = True
                return
            assert isinstance(message, Scene)
            self._merge(message)
            if message.part_names:
                return

    def _merge(self, scene: Scene) -> None:
        first_product, first_part = len(self.products), len(self._part_names)
        for material in scene.materials:
            if material not in self.materials:
                self.materials.append(material)
        rows = [self.materials.index(material) for material in scene.materials]
        self._material_rows = np.array(rows, np.int32)
        for product in scene.products:
            parent = product.parent + first_product if product.parent >= 0 else -1
            self.products.append(Product(product.name, parent, product.transform))
        for part, product_row, material_row, transform in scene.placements:
            override = rows[material_row] if material_row >= 0 else -1
            placed = (part + first_part, product_row + first_product, override, list(transform))
            self._placements.append(placed)
        self._part_names += scene.part_names
        self._n_faces += sum(scene.part_faces)
        self._groups_left = max(self._groups_left - 1, 0)

    def _receive(self) -> Message:
        try:
            message: Message = self._messages.recv()
        except (EOFError, OSError) as error:
            raise InputFileError(f"{self.path}: the kernel crashed while reading it") from error
        if isinstance(message, Failed):
            raise InputFileError(message.message)
        return message

    def close(self) -> None:
        """End the session and remove the unpacked copy."""
        self._messages.close()
        self._file.remove_copy()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
