"""Parts of a store: their geometry, what is known of them without it, and where a surface lies."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache import record
from nurbs_cache.errors import CorruptRecordError, MissingRecordError, UsageError
from nurbs_cache.keys import number_key, parse_number_key
from nurbs_cache.raw_store import RawStore, Writing
from nurbs_cache.row_pages import clean_rows
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    GeometryBatch,
)

BATCH_BYTES = 64 << 20  # packed bytes of parts in one transaction: bounds the memory of a long put
_INFO = struct.Struct("<QI")  # first surface id, number of surfaces; the name follows

Triples = list[tuple[bytes, bytes, bytes]]


class _Index(NamedTuple):
    """All part infos, with the first surface ids of the parts that have surfaces, ascending."""

    revision: int
    numbers: list[int]
    infos: list[PartInfo]
    first_surfaces: npt.NDArray[np.int64]
    rows: npt.NDArray[np.int64]  # in ``infos``


class PartTables(RawStore):
    """Tables ``parts`` and ``part_infos``."""

    _index: _Index | None = None

    def put_parts(self, parts: Iterable[tuple[int, PartInfo, GeometryBatch]]) -> None:
        """Store (index, info, geometry), some 64 MiB to a transaction; a part put again is replaced."""
        batch: Triples = []
        n_bytes = 0
        for index, info, geometry in parts:
            if info.n_surfaces != len(geometry):
                raise UsageError(f"part {index}: {len(geometry)} surfaces, its info says {info.n_surfaces}")
            batch.append((number_key(index), _pack_info(info), pack_geometry(geometry)))
            n_bytes += len(batch[-1][2])
            if n_bytes >= BATCH_BYTES:
                self._put_batch(batch)
                batch, n_bytes = [], 0
        self._put_batch(batch)

    def get_part(self, index: int) -> GeometryBatch:
        """Geometry of a part.

        Raises:
            MissingRecordError: there is no such part.
            CorruptRecordError: it cannot be read.
        """
        data = self.find("parts", number_key(index))
        if data is None:
            raise MissingRecordError(f"{self.name}: there is no part {index}")
        return GeometryBatch.from_bytes(record.unpack(data, f"{self.name}: part {index}"))

    def part_infos(self) -> list[PartInfo]:
        """Infos of all parts in the order of their index; do not change the list."""
        return self._part_index().infos

    def part_numbers(self) -> list[int]:
        """Indices of the parts that are stored, ascending: 0, 1, 2, … once all are there."""
        return self._part_index().numbers

    def locate_surface(self, surface_id: int) -> tuple[int, int]:
        """Part and row in the part of a surface.

        Raises:
            MissingRecordError: no part has it.
        """
        index = self._part_index()
        at = int(np.searchsorted(index.first_surfaces, surface_id, side="right")) - 1
        if at >= 0:
            row = int(index.rows[at])
            offset = surface_id - index.infos[row].first_surface
            if offset < index.infos[row].n_surfaces:
                return index.numbers[row], int(offset)
        raise MissingRecordError(f"{self.name}: there is no surface {surface_id}")

    def _put_batch(self, batch: Triples) -> None:
        def change(writing: Writing) -> None:
            for key, info, geometry in batch:
                writing.put("part_infos", key, info)
                writing.put("parts", key, geometry)

        if batch:
            self.transact(change)

    def _part_index(self) -> _Index:
        """Read the infos once per revision of the store."""
        revision = self.revision()
        if self._index is None or self._index.revision != revision:
            numbers, infos = [], []
            for key, data in self.scan("part_infos"):
                numbers.append(parse_number_key(key))
                infos.append(_unpack_info(data, f"{self.name}: info of part {numbers[-1]}"))
            firsts = np.array([info.first_surface for info in infos], np.int64)
            rows = np.flatnonzero([info.n_surfaces > 0 for info in infos]).astype(np.int64)
            rows = rows[np.argsort(firsts[rows], kind="stable")]
            self._index = _Index(revision, numbers, infos, firsts[rows], rows)
        return self._index


def pack_geometry(geometry: GeometryBatch) -> bytes:
    """What is stored of a part."""
    return record.pack(_clean(geometry).to_bytes())


def _clean(geometry: GeometryBatch) -> GeometryBatch:
    """The same geometry with zero padding bytes."""
    return dataclasses.replace(
        geometry,
        surfaces=clean_rows(geometry.surfaces, SURFACE_DTYPE),
        loops=clean_rows(geometry.loops, LOOP_DTYPE),
        coedges=clean_rows(geometry.coedges, COEDGE_DTYPE),
        edges=clean_rows(geometry.edges, EDGE_DTYPE),
        curves=clean_rows(geometry.curves, CURVE_DTYPE),
        vertices=np.ascontiguousarray(geometry.vertices, np.float64),
        values=np.ascontiguousarray(geometry.values, np.float64),
    )


def _pack_info(info: PartInfo) -> bytes:
    return record.pack(_INFO.pack(info.first_surface, info.n_surfaces) + info.name.encode())


def _unpack_info(data: bytes, what: str) -> PartInfo:
    payload = record.unpack(data, what)
    try:
        first_surface, n_surfaces = _INFO.unpack_from(payload)
        return PartInfo(payload[_INFO.size :].decode(), n_surfaces, first_surface)
    except (struct.error, ValueError) as error:
        raise CorruptRecordError(f"{what}: {error}") from error
