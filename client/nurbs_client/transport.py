"""Where tiles come from: a cache on this machine, or a server."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import httpx
import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CacheError, CorruptRecordError, MissingRecordError
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material
from nurbs_cache.store import Store
from nurbs_client.errors import RefusedError, ServerError

Table = npt.NDArray[np.void]
NodeBuilder = Callable[[Store, int], tuple[str, bytes]]
LodBuilder = Callable[[Store, int, int], tuple[Any, bytes]]

TIMEOUT_S = httpx.Timeout(10.0, read=120.0)  # a tile that has to be built first may take its time
PAGE_ROWS = 65536  # rows of a table per request
RETRY_S = (0.25, 0.5, 1.0, 2.0)  # waits before asking a busy server again: its queue drains at some 20 tiles a second
FRAME = struct.Struct("<32sII")  # of a batch's answer: hash, status, bytes that follow


class Transport(Protocol):
    """What the client asks for; safe to call from several threads.

    All methods raise ``MissingRecordError`` for what does not exist, ``CorruptRecordError`` for what
    cannot be read, and ``ServerError`` where the other side is gone. ``tiles`` returns the first two
    instead, in the place of the tile, so that one bad tile costs only itself.
    """

    bytes_received: int
    n_threads: int  # loaders that it can keep busy

    def scene(self) -> dict[str, Any]:
        """At least ``materials``: a list of ``name`` and ``rgba``."""

    def nodes(self) -> Table:
        """The whole node table, ``NODE_DTYPE``."""

    def items(self) -> Table:
        """The whole item table, ``ITEM_DTYPE``."""

    def occurrences(self) -> Table:
        """The whole occurrence table, ``OCCURRENCE_DTYPE``."""

    def tiles(self, names: list[str]) -> list[bytes | CacheError]:
        """The tiles with these content hashes, or why there is none."""

    def node_tile(self, row: int) -> bytes:
        """The tile of a node that had none when the tables were read."""

    def surface_lod(self, surface_id: int, level: int) -> bytes:
        """A surface's LOD within 2**level mm, in its own space."""

    def close(self) -> None:
        """Give files and connections back."""


def materials_of(scene: dict[str, Any]) -> list[Material]:
    """The scene's materials, in the order of their indices."""
    return [Material(str(m["name"]), tuple(m["rgba"])) for m in scene.get("materials", [])]


class CacheTransport:
    """Reads a cache directory; tiles it lacks are built by what the caller injects.

    Args:
        path: the cache.
        node_builder: of ``nurbs_ooc.build.on_demand``; None: what is not stored is missing.
        lod_builder: likewise. With a builder, the cache is opened for writing where that is possible.

    Attributes:
        refusal: why nothing is built, "" if missing tiles are.
    """

    n_threads = 2

    def __init__(
        self, path: Path | str, node_builder: NodeBuilder | None = None, lod_builder: LodBuilder | None = None
    ) -> None:
        self.refusal = "" if node_builder or lod_builder else "nothing here builds it"
        self._store = self._opened(path)
        self._node_builder, self._lod_builder = node_builder, lod_builder
        self._building = threading.Lock()
        self._counting = threading.Lock()
        self.bytes_received = 0

    def _opened(self, path: Path | str) -> Store:
        """For writing, if there is something to write; else as it is, while others write it."""
        if not self.refusal:
            try:
                return Store.open(path, read_only=False)
            except CacheError as error:
                self.refusal = f"the cache is open for reading only: {error}"
        return Store.open(path, read_only=True)

    def scene(self) -> dict[str, Any]:
        """The fields of the server's ``/api/scene`` that the client uses."""
        materials = [{"name": m.name, "rgba": list(m.rgba)} for m in self._store.get_materials()]
        return {"materials": materials}

    def nodes(self) -> Table:
        """The whole node table."""
        return np.array(self._store.get_nodes())

    def items(self) -> Table:
        """The whole item table."""
        return np.array(self._store.get_items())

    def occurrences(self) -> Table:
        """The whole occurrence table."""
        return np.array(self._store.get_occurrences())

    def tiles(self, names: list[str]) -> list[bytes | CacheError]:
        """The tiles with these content hashes, or why there is none."""
        result: list[bytes | CacheError] = []
        for name in names:
            try:
                result.append(self._counted(self._store.get_tile(name)))
            except CacheError as error:
                result.append(error)
        return result

    def node_tile(self, row: int) -> bytes:
        """The tile of a node that had none when the tables were read."""
        if self._node_builder is None or self.refusal:
            raise MissingRecordError(f"node {row} has no tile: {self.refusal}")
        with self._building:
            return self._counted(self._node_builder(self._store, row)[1])

    def surface_lod(self, surface_id: int, level: int) -> bytes:
        """A surface's LOD within 2**level mm, in its own space."""
        for lod in self._store.get_lods(surface_id):
            if int(lod["level"]) == level:
                return self._counted(self._store.get_tile(lod["tile_hash"].decode()))
        if self._lod_builder is None or self.refusal:
            raise MissingRecordError(f"surface {surface_id} has no LOD at level {level}: {self.refusal}")
        with self._building:
            return self._counted(self._lod_builder(self._store, surface_id, level)[1])

    def _counted(self, data: bytes) -> bytes:
        with self._counting:
            self.bytes_received += len(data)
        return data

    def close(self) -> None:
        """Close the cache."""
        self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class HttpTransport:
    """Asks a server; one connection pool for all threads.

    Args:
        url: of the server, ``http://host:port``.
        client: for tests.
    """

    n_threads = 6

    def __init__(self, url: str, client: httpx.Client | None = None) -> None:
        self.url = url.rstrip("/")
        self._client = client or httpx.Client(base_url=self.url, timeout=TIMEOUT_S, follow_redirects=True)
        self._counting = threading.Lock()
        self.bytes_received = 0

    def scene(self) -> dict[str, Any]:
        """``GET /api/scene``."""
        answer = self._get("/api/scene")
        try:
            content = answer.json()
        except ValueError as error:
            raise ServerError(f"{self.url}: /api/scene is no JSON: not a nurbs-ooc server?") from error
        if not isinstance(content, dict) or "materials" not in content:
            raise ServerError(f"{self.url}: /api/scene has no materials: not a nurbs-ooc server?")
        return content

    def nodes(self) -> Table:
        """The whole node table, page by page."""
        return self._table("/api/nodes", NODE_DTYPE)

    def items(self) -> Table:
        """The whole item table, page by page."""
        return self._table("/api/items", ITEM_DTYPE)

    def occurrences(self) -> Table:
        """The whole occurrence table, page by page."""
        return self._table("/api/occurrences", OCCURRENCE_DTYPE)

    def tiles(self, names: list[str]) -> list[bytes | CacheError]:
        """One ``GET /tiles/{hash}``, or one ``POST /tiles:batch`` for several."""
        try:
            if len(names) == 1:
                return [self._get(f"/tiles/{names[0]}").content]
            return self._frames(names, self._ask("POST", "/tiles:batch", json={"hashes": names}).content)
        except CacheError as error:
            return [error] * len(names)

    def _frames(self, names: list[str], data: bytes) -> list[bytes | CacheError]:
        """Cut a batch's answer into tiles, each with its own status."""
        result: list[bytes | CacheError] = []
        at = 0
        for name in names:
            if len(data) < at + FRAME.size:
                raise CorruptRecordError(f"{self.url}/tiles:batch: {len(data)} bytes end before tile {name}")
            named, status, size = FRAME.unpack_from(data, at)
            at += FRAME.size
            if named != name.encode() or len(data) < at + size:
                raise CorruptRecordError(f"{self.url}/tiles:batch: no whole tile {name} at byte {at}")
            what = f"{self.url}/tiles/{name}: status {status}"
            good = status == httpx.codes.OK
            result.append(data[at : at + size] if good else _tile_error(status, what))
            at += size
        return result

    def node_tile(self, row: int) -> bytes:
        """``GET /api/nodes/{row}/tile``: built there if it has to be; the redirect is followed."""
        return self._get(f"/api/nodes/{row}/tile").content

    def surface_lod(self, surface_id: int, level: int) -> bytes:
        """``GET /api/surfaces/{id}/lods/{level}``."""
        return self._get(f"/api/surfaces/{surface_id}/lods/{level}").content

    def close(self) -> None:
        """Close all connections."""
        self._client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _table(self, path: str, dtype: np.dtype[np.void]) -> Table:
        pages: list[Table] = []
        while not pages or len(pages[-1]) == PAGE_ROWS:
            first = sum(len(page) for page in pages)
            data = self._get(path, {"first": first, "count": PAGE_ROWS}).content
            if len(data) % dtype.itemsize:
                raise CorruptRecordError(f"{self.url}{path}: {len(data)} bytes are no rows of {dtype.itemsize} bytes")
            pages.append(np.frombuffer(bytearray(data), dtype))
        return np.concatenate(pages)

    def _get(self, path: str, params: dict[str, int] | None = None) -> httpx.Response:
        return self._ask("GET", path, params=params)

    def _ask(self, method: str, path: str, **content: Any) -> httpx.Response:
        """A good answer. A broken connection (an idle one may have been closed) and a busy server get more tries."""
        for attempt in range(len(RETRY_S) + 1):
            try:
                answer = self._client.request(method, path, **content)
                if answer.status_code != httpx.codes.SERVICE_UNAVAILABLE or attempt == len(RETRY_S):
                    break
                time.sleep(RETRY_S[attempt])
            except httpx.InvalidURL as error:
                raise ServerError(f"{self.url}: not a URL: {error}") from error
            except httpx.HTTPError as error:
                if attempt or isinstance(error, httpx.UnsupportedProtocol):
                    raise ServerError(f"{self.url}: {_reason(error)}; is the server running?") from error
        with self._counting:
            self.bytes_received += len(answer.content)
        if answer.status_code == httpx.codes.NOT_FOUND:
            raise MissingRecordError(f"{self.url}{path}: not found")
        if answer.status_code >= 400:
            raise RefusedError(f"{self.url}{path}: status {answer.status_code}: {answer.text[:200].strip()}")
        return answer


def _tile_error(status: int, what: str) -> CacheError:
    """A status of a batch's frame as the error that the tile's own request would have raised."""
    return MissingRecordError(what) if status == httpx.codes.NOT_FOUND else RefusedError(what)


def _reason(error: httpx.HTTPError) -> str:
    """What happened, in one line."""
    text = str(error).splitlines()
    return text[0] if text and text[0] else type(error).__name__
