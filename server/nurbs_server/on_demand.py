"""Tiles that are missing are built when someone asks: once for all who wait, then kept in the store.

The builders are injected: functions that build, store and return. They run in their own threads, so
neither the event loop nor reading waits for them. Whatever a build changes is visible in the store and
in the index before its flight lands, so whoever looks after that finds it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from nurbs_cache.errors import UsageError
from nurbs_cache.typed_store import TypedStore
from nurbs_server.errors import ReadOnlyError
from nurbs_server.index import SceneIndex
from nurbs_server.limits import LOD_LEVELS
from nurbs_server.metrics import Metrics
from nurbs_server.single_flight import SingleFlight
from nurbs_server.tile_reader import TileReader

NodeBuilder = Callable[[TypedStore, int], tuple[str, bytes]]  # row -> tile hash, tile
LodBuilder = Callable[[TypedStore, int, int], tuple[np.void, bytes]]  # surface id, level -> LOD record, tile


@dataclass(frozen=True)
class Builders:
    """How missing tiles are made; each stores what it makes."""

    node: NodeBuilder
    lod: LodBuilder


class OnDemand:
    """Finds the tile of a node or of a surface's level, or has it built.

    Args:
        builders: None if the store cannot be written; ``refusal`` then says why.
    """

    def __init__(
        self,
        store: TypedStore,
        index: SceneIndex,
        tiles: TileReader,
        flights: SingleFlight,
        reads: SingleFlight,
        metrics: Metrics,
        builders: Builders | None,
        refusal: str = "",
    ) -> None:
        self._store, self._index, self._tiles, self._metrics = store, index, tiles, metrics
        self._flights, self._reads = flights, reads
        self._builders, self._refusal = builders, refusal

    async def node_tile(self, row: int) -> str:
        """Hash of a node's tile.

        Raises:
            MissingRecordError: there is no such node.
            ReadOnlyError: it is not built and cannot be.
        """
        known = bytes(self._index.node(row)["tile_hash"])
        if known:
            return known.decode("ascii")
        if self._builders is None:
            return await self._reads.run(("node", row), self._look_again, row)
        return await self._flights.run(("node", row), self._build_node, row)

    async def surface_lod(self, surface: int, level: int) -> np.void:
        """Record of a surface's LOD at a ladder level.

        Raises:
            UsageError: the level is outside ``LOD_LEVELS``.
            MissingRecordError: there is no such surface.
            ReadOnlyError: it is not built and cannot be.
        """
        low, high = LOD_LEVELS
        if not low <= level <= high:
            raise UsageError(f"level {level}: LODs have levels {low} to {high} (2**level mm)")
        known = await self._reads.run(("lod", surface, level), self._find_lod, surface, level)
        if known is None and self._builders is None:
            raise ReadOnlyError(f"surface {surface} has no LOD at level {level}: {self._refusal}")
        if known is None:
            known = await self._flights.run(("lod", surface, level), self._find_or_build_lod, surface, level)
        return known

    def _look_again(self, row: int) -> str:
        """Another process may have built it since: take over its record."""
        tile_hash = bytes(self._store.get_nodes(row, 1)[0]["tile_hash"]).decode("ascii")
        if not tile_hash:
            raise ReadOnlyError(f"the tile of node {row} is not built: {self._refusal}")
        self._refresh(row)
        return tile_hash

    def _build_node(self, row: int) -> str:
        assert self._builders is not None
        with self._timed("node"):
            tile_hash, data = self._builders.node(self._store, row)
            self._tiles.keep(tile_hash, data)
            self._refresh(row)
        return tile_hash

    def _refresh(self, row: int) -> None:
        """Take over the records of a node and of its ancestors, whose errors are never below its own."""
        while row >= 0:
            record = self._store.get_nodes(row, 1)[0]
            self._index.replace_node(row, record)
            row = int(record["parent"])

    def _find_lod(self, surface: int, level: int) -> np.void | None:
        """The stored record, if there is one; refuses a surface that does not exist."""
        self._store.locate_surface(surface)
        lods = self._store.get_lods(surface)
        found = np.flatnonzero(lods["level"] == level)
        record: np.void | None = lods[found[0]] if len(found) else None
        return record

    def _find_or_build_lod(self, surface: int, level: int) -> np.void:
        """Look again first: a build may have landed between the caller's look and this flight."""
        assert self._builders is not None
        known = self._find_lod(surface, level)
        if known is not None:
            return known
        with self._timed("lod"):
            record, data = self._builders.lod(self._store, surface, level)
            self._tiles.keep(bytes(record["tile_hash"]).decode("ascii"), data)
        return record

    @contextmanager
    def _timed(self, what: str) -> Iterator[None]:
        start = time.perf_counter()
        result = "failed"
        try:
            yield
            result = "built"
        finally:
            self._metrics.builds.labels(what, result).inc()
            self._metrics.build_seconds.labels(what).observe(time.perf_counter() - start)
