"""Parts of a store for several threads: the ones used last stay in memory, up to so many bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Protocol

from nurbs_cache.surface_record import GeometryBatch

KEPT_BYTES = 256 << 20


class StoredParts(Protocol):
    """What is needed of a store."""

    def get_part(self, index: int) -> GeometryBatch:
        """Geometry of a part."""


class PartSource:
    """Reads parts when they are first asked for.

    Args:
        store: where they are.
        kept_bytes: how much stays; the part asked for last always does.
    """

    def __init__(self, store: StoredParts, kept_bytes: int = KEPT_BYTES) -> None:
        self._store, self._most = store, kept_bytes
        self._kept: OrderedDict[int, GeometryBatch] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    def __getitem__(self, part: int) -> GeometryBatch:
        with self._lock:
            if part not in self._kept:
                self._kept[part] = self._store.get_part(part)
                self._bytes += _size(self._kept[part])
                while self._bytes > self._most and len(self._kept) > 1:
                    self._bytes -= _size(self._kept.popitem(last=False)[1])
            self._kept.move_to_end(part)
            return self._kept[part]

    def name(self, part: int, row: int) -> str:
        """What the file calls a surface, "" if nothing."""
        geometry = self[part]
        source = int(geometry.surfaces["source"][row])
        return geometry.sources[source] if 0 <= source < len(geometry.sources) else ""


def _size(geometry: GeometryBatch) -> int:
    tables = (geometry.surfaces, geometry.loops, geometry.coedges, geometry.edges, geometry.curves)
    return int(sum(t.nbytes for t in tables) + geometry.values.nbytes + geometry.vertices.nbytes)
