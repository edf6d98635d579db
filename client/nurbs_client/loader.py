"""Threads that fetch and decode tiles in the background, most urgent first.

The queue is replaced as a whole each frame: what no longer matters is dropped before it costs
anything. Results wait until the render thread collects them, since only that one may touch OpenGL.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from nurbs_cache.errors import NurbsOocError
from nurbs_client.prefetch import Request
from nurbs_client.residency import TileKey
from nurbs_client.tile_mesh import TileMesh

BATCH_TILES = 16  # per request at most: larger ones delay what has become more urgent meanwhile


class Loaded(NamedTuple):
    """A finished request: a mesh, or why there is none."""

    key: TileKey
    mesh: TileMesh | None
    error: NurbsOocError | None


class Loader:
    """Keeps ``n_threads`` threads busy with the first entries of the queue.

    Args:
        fetch: returns the tiles of some keys, or why there is none; called from the threads.
        n_threads: how many.
    """

    def __init__(self, fetch: Callable[[list[TileKey]], list[Loaded]], n_threads: int) -> None:
        self._fetch = fetch
        self._queue: deque[Request] = deque()
        self._done: deque[Loaded] = deque()
        self._loading: set[TileKey] = set()
        self._changed = threading.Condition()
        self._stopping = False
        self._fatal: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._work, name=f"tile-loader-{i}", daemon=True) for i in range(n_threads)
        ]
        for thread in self._threads:
            thread.start()

    def replace(self, requests: list[Request]) -> list[TileKey]:
        """Put ``requests``, already in order, in place of what has not been started; returns what was dropped."""
        with self._changed:
            asked = {request.key for request in requests}
            dropped = [r.key for r in self._queue if r.key not in asked]
            self._queue = deque(r for r in requests if r.key not in self._loading)
            self._changed.notify_all()
        return dropped

    def collect(self, max_bytes: int | None = None) -> list[Loaded]:
        """Take finished tiles, at least one if there is any, up to ``max_bytes`` of graphics memory.

        Raises:
            NurbsOocError: a loader met an error that no other tile would survive either.
        """
        result = []
        with self._changed:
            if self._fatal is not None:
                raise self._fatal
            size = 0
            while self._done and (max_bytes is None or size < max_bytes):
                loaded = self._done.popleft()
                self._loading.discard(loaded.key)
                size += loaded.mesh.n_bytes if loaded.mesh else 0
                result.append(loaded)
        return result

    @property
    def is_busy(self) -> bool:
        """Whether anything is queued, loading, or waiting to be collected."""
        with self._changed:
            return bool(self._queue or self._loading or self._done)

    def wait(self, timeout_s: float) -> None:
        """Sleep until something can be collected."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not self._done and self._fatal is None and (self._queue or self._loading):
                if not self._changed.wait(deadline - time.monotonic()) or time.monotonic() >= deadline:
                    return

    def close(self) -> None:
        """Let the threads end after what they are doing."""
        with self._changed:
            self._stopping = True
            self._queue.clear()
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._queue and not self._stopping:
                    self._changed.wait()
                if self._stopping:
                    return
                fair = math.ceil(len(self._queue) / len(self._threads))
                keys = self._take(min(fair, BATCH_TILES))
                self._loading.update(keys)
            loaded = self._load(keys)
            with self._changed:
                self._done.extend(loaded)
                self._changed.notify_all()

    def _take(self, limit: int) -> list[TileKey]:
        """The first of the queue, as many as are equally urgent: nothing waits for what matters less."""
        number = self._queue[0].bin
        keys: list[TileKey] = []
        while self._queue and self._queue[0].bin == number and len(keys) < limit:
            keys.append(self._queue.popleft().key)
        return keys

    def _load(self, keys: list[TileKey]) -> list[Loaded]:
        """What fetching raises, rather than returns, would meet every other tile too: it ends the flight."""
        try:
            return self._fetch(keys)
        except BaseException as error:  # noqa: BLE001  handed to the render thread, which raises it
            with self._changed:
                self._fatal = error
            return []
