"""Checked tiles, from memory where they are warm and from the store in a thread where they are not."""

from __future__ import annotations

from nurbs_cache.typed_store import TypedStore
from nurbs_server.byte_cache import ByteCache
from nurbs_server.metrics import Metrics
from nurbs_server.single_flight import SingleFlight


class TileReader:
    """Reads tiles by content hash.

    A tile's bytes never change under its hash, so what has been read and checked once may be sent
    again without a look at the store: warm tiles cost the event loop a dictionary lookup, and no page
    fault of the store can ever stop it.
    """

    def __init__(self, store: TypedStore, reads: SingleFlight, metrics: Metrics, cache_bytes: int) -> None:
        self._store = store
        self._reads = reads
        self._metrics = metrics
        self._warm: ByteCache[str, bytes] = ByteCache(cache_bytes)

    def warm(self, tile_hash: str) -> bytes | None:
        """The tile if it is in memory; never waits."""
        data = self._warm.get(tile_hash)
        (self._metrics.miss if data is None else self._metrics.hit).inc()
        return data

    async def read(self, tile_hash: str) -> bytes:
        """The tile, warm or not; raises as ``load``."""
        return self.warm(tile_hash) or await self.load(tile_hash)

    async def load(self, tile_hash: str) -> bytes:
        """The tile, read from the store in a thread and checked.

        Raises:
            UsageError: this is no hash.
            MissingRecordError: there is no such tile.
            CorruptRecordError: the stored bytes fail their checksum.
        """
        return await self._reads.run(("tile", tile_hash), self._load, tile_hash)

    def keep(self, tile_hash: str, data: bytes) -> None:
        """Take in a tile that was just built."""
        self._warm.put(tile_hash, data, len(data))

    def _load(self, tile_hash: str) -> bytes:
        data = bytes(self._store.get_tile(tile_hash))
        self.keep(tile_hash, data)
        return data
