"""Tiles of a store, the surfaces' levels of detail that point to them, and the face report."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from nurbs_cache import record
from nurbs_cache.errors import MissingRecordError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.keys import number_key, surface_key, tile_key
from nurbs_cache.node_record import LOD_DTYPE
from nurbs_cache.raw_store import RawStore, Writing
from nurbs_cache.row_pages import Rows, clean_rows, parse_rows
from nurbs_cache.tile import check_tile

FACE_PAGE = 4096  # surface ids in one page of the face report


class TileTables(RawStore):
    """Tables ``tiles``, ``lods`` and ``faces``."""

    def put_tiles(self, tiles: Iterable[tuple[str, bytes]]) -> None:
        """Store (hash, bytes) in one transaction; the hash is ``tile_hash`` of the bytes."""
        self.put_many("tiles", ((tile_key(name), data) for name, data in tiles))

    def get_tile(self, tile_hash: str | bytes) -> bytes:
        """Bytes of a tile, their checksum verified.

        Raises:
            MissingRecordError: it is not stored.
            CorruptRecordError: what is stored is damaged.
        """
        data = self.find("tiles", tile_key(tile_hash))
        name = tile_hash.decode() if isinstance(tile_hash, bytes) else tile_hash
        if data is None:
            raise MissingRecordError(f"{self.name}: there is no tile {name}")
        check_tile(data, f"{self.name}: tile {name}")
        return data

    def has_tile(self, tile_hash: str | bytes) -> bool:
        """Whether a tile is stored."""
        return self.find("tiles", tile_key(tile_hash)) is not None

    def put_lods(self, surface_id: int, lods: Rows) -> None:
        """Add ``LOD_DTYPE`` rows to a surface; a row of a level that is there replaces it."""
        added = clean_rows(lods, LOD_DTYPE)
        key, what = surface_key(surface_id), f"levels of detail of surface {surface_id}"

        def change(writing: Writing) -> None:
            stored = writing.find("lods", key)
            rows = (
                np.zeros(0, LOD_DTYPE) if stored is None else parse_rows(record.unpack(stored, what), LOD_DTYPE, what)
            )
            writing.put("lods", key, record.pack(_latest(rows, added, "level").tobytes()))

        self.transact(change)

    def get_lods(self, surface_id: int) -> Rows:
        """(n,) ``LOD_DTYPE`` by ascending level (finest first); empty if none is stored."""
        data = self.find("lods", surface_key(surface_id))
        if data is None:
            return np.zeros(0, LOD_DTYPE)
        what = f"{self.name}: levels of detail of surface {surface_id}"
        return parse_rows(record.unpack(data, what), LOD_DTYPE, what).copy()

    def put_face_report(self, rows: Rows) -> None:
        """Add ``FACE_REPORT_DTYPE`` rows, in one transaction; a surface that is there is replaced."""
        added = clean_rows(rows, FACE_REPORT_DTYPE)
        self.transact(lambda writing: merge_face_rows(writing, added))

    def get_face_report(self) -> Rows:
        """(n,) ``FACE_REPORT_DTYPE`` by ascending surface id."""
        what = f"{self.name}: face report"
        pages = [parse_rows(record.unpack(data, what), FACE_REPORT_DTYPE, what) for _, data in self.scan("faces")]
        return np.concatenate([np.zeros(0, FACE_REPORT_DTYPE), *pages])

    def get_face_rows(self, surfaces: npt.NDArray[np.uint64]) -> Rows:
        """Those of the face report's rows that are of ``surfaces``, ascending; only their pages are read."""
        found = [np.zeros(0, FACE_REPORT_DTYPE)]
        for page in np.unique(surfaces // np.uint64(FACE_PAGE)).tolist():
            data, what = self.find("faces", number_key(page)), f"{self.name}: page {page} of the face report"
            rows = parse_rows(b"" if data is None else record.unpack(data, what), FACE_REPORT_DTYPE, what)
            found.append(rows[np.isin(rows["surface"], surfaces)])
        return np.concatenate(found)


def merge_face_rows(writing: Writing, added: Rows) -> None:
    """Add clean ``FACE_REPORT_DTYPE`` rows to the report; a surface that is there is replaced."""
    pages = (added["surface"] // np.uint64(FACE_PAGE)).astype(np.int64)
    for page in np.unique(pages).tolist():
        stored = writing.find("faces", number_key(page))
        what = f"page {page} of the face report"
        payload = b"" if stored is None else record.unpack(stored, what)
        merged = _latest(parse_rows(payload, FACE_REPORT_DTYPE, what), added[pages == page], "surface")
        writing.put("faces", number_key(page), record.pack(merged.tobytes()))


def _latest(rows: Rows, added: Rows, field: str) -> Rows:
    """Both together, sorted by ``field``; of equal ones the last added stays."""
    both = np.concatenate([rows, added])[::-1]
    _, kept = np.unique(both[field], return_index=True)
    latest: Rows = clean_rows(both[kept], rows.dtype)
    return latest
