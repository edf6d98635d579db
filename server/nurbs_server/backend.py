"""What the routes share: the store, what is kept of it in memory, and the threads that read and build."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import Annotated

from fastapi import Depends, Request

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_server.byte_cache import ByteCache
from nurbs_server.index import SceneIndex
from nurbs_server.limits import (
    BUILD_QUEUE,
    BUILD_THREADS,
    CONTENT_HASH_WAIT_S,
    PART_CACHE_BYTES,
    READ_QUEUE,
    READ_THREADS,
    TILE_CACHE_BYTES,
)
from nurbs_server.metrics import Metrics
from nurbs_server.on_demand import Builders, OnDemand
from nurbs_server.single_flight import SingleFlight
from nurbs_server.tile_reader import TileReader


class Backend:
    """One per application; the store stays its opener's to close, after ``close``.

    Args:
        store: an open cache.
        builders: how to make missing tiles; None serves what is there.
        refusal: why nothing can be built, for the answer 409.
        build_threads: builds at a time.
    """

    def __init__(
        self, store: TypedStore, builders: Builders | None, refusal: str, build_threads: int = BUILD_THREADS
    ) -> None:
        self.store = store
        self.builds_allowed = builders is not None
        self.metrics = Metrics()
        self.index = SceneIndex(store)
        self.reads = SingleFlight(READ_THREADS, READ_QUEUE, "reads")
        self.builds = SingleFlight(build_threads, BUILD_QUEUE, "builds")
        self.tiles = TileReader(store, self.reads, self.metrics, TILE_CACHE_BYTES)
        self.parts: ByteCache[int, GeometryBatch] = ByteCache(PART_CACHE_BYTES)
        self.on_demand = OnDemand(
            store, self.index, self.tiles, self.builds, self.reads, self.metrics, builders, refusal
        )
        waiting = self.metrics.gauge("builds_waiting", "on-demand builds running or queued")
        waiting.set_function(lambda: len(self.builds))
        self._content_hash: str | None = None

    async def content_hash(self) -> str | None:
        """The content hash of the cache when it was first asked for; None while it is being worked out.

        It reads the whole cache, so a large one answers its first clients without. A damaged cache has
        none; what is whole in it is served all the same.
        """
        if self._content_hash is None:
            with suppress(TimeoutError, CorruptRecordError):
                async with asyncio.timeout(CONTENT_HASH_WAIT_S):
                    await self.reads.run("content_hash", self._find_content_hash)
        return self._content_hash

    def _find_content_hash(self) -> None:
        self._content_hash = self.store.content_hash()

    def turn_away(self) -> None:
        """Answer 503 to whoever waits for a build: the server is stopping."""
        self.builds.turn_away()

    def settle(self, seconds: float) -> bool:
        """Take no more work and give what runs a moment; True if all has ended and the store may be closed."""
        self.close(wait=False)
        end = time.monotonic() + seconds
        while self.reads.running or self.builds.running:
            if time.monotonic() > end:
                return False
            time.sleep(0.01)
        return True

    def close(self, *, wait: bool) -> None:
        """Take no more work; with ``wait``, return when running reads and builds have ended."""
        self.reads.close(wait=wait)
        self.builds.close(wait=wait)


def _of_request(request: Request) -> Backend:
    backend: Backend = request.app.state.backend
    return backend


BackendOf = Annotated[Backend, Depends(_of_request)]
