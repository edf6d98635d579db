"""Transports and loader: what they ask, and what happens when the other side misbehaves."""

from __future__ import annotations

import json
import socket
import struct
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from nurbs_cache.errors import CacheError, CorruptRecordError, MissingRecordError
from nurbs_cache.node_record import NODE_DTYPE
from nurbs_cache.store import Store
from nurbs_client.errors import RefusedError, ServerError
from nurbs_client.loader import Loaded, Loader
from nurbs_client.prefetch import Request
from nurbs_client.residency import TileKey
from nurbs_client.tile_mesh import make_mesh
from nurbs_client.tile_source import TileSource
from nurbs_client.transport import CacheTransport, HttpTransport, materials_of

Handler = Callable[[httpx.Request], httpx.Response]


def http(handler: Handler) -> HttpTransport:
    client = httpx.Client(transport=httpx.MockTransport(handler), base_url="http://there", follow_redirects=True)
    return HttpTransport("http://there", client)


def test_server_that_is_gone_is_one_line() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{probe.getsockname()[1]}"
    with HttpTransport(url) as transport, pytest.raises(ServerError, match="is the server running") as caught:
        transport.scene()
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)


def test_broken_connection_is_tried_again_once() -> None:
    calls: list[str] = []

    def handler(request: httpx.Request) -> httpx.Response:
        calls.append(request.url.path)
        if len(calls) == 1:
            raise httpx.ReadError("connection reset")
        return httpx.Response(200, content=b"tile")

    transport = http(handler)
    assert transport.surface_lod(7, -2) == b"tile"
    assert calls == ["/api/surfaces/7/lods/-2"] * 2
    assert transport.bytes_received == 4


@pytest.mark.parametrize(("status", "error"), [(404, MissingRecordError), (500, RefusedError), (409, RefusedError)])
def test_statuses(status: int, error: type[CacheError]) -> None:
    transport = http(lambda _: httpx.Response(status, text="why"))
    with pytest.raises(error, match="/api/nodes/3/tile"):
        transport.node_tile(3)
    [answer] = transport.tiles(["a" * 32])
    assert isinstance(answer, error)


@pytest.mark.parametrize("content", [b"<html>", b"[1]", b'{"a": 1}'])
def test_other_servers_are_recognised(content: bytes) -> None:
    with pytest.raises(ServerError, match="not a nurbs-ooc server"):
        http(lambda _: httpx.Response(200, content=content)).scene()


def test_tables_come_in_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    table = np.zeros(25, NODE_DTYPE)
    table["level"] = np.arange(25)
    monkeypatch.setattr("nurbs_client.transport.PAGE_ROWS", 10)
    asked: list[int] = []

    def handler(request: httpx.Request) -> httpx.Response:
        first, count = (int(request.url.params[name]) for name in ("first", "count"))
        asked.append(first)
        return httpx.Response(200, content=table[first : first + count].tobytes())

    assert (http(handler).nodes() == table).all()
    assert asked == [0, 10, 20]
    with pytest.raises(CorruptRecordError, match="no rows"):
        http(lambda _: httpx.Response(200, content=b"x" * 17)).items()


def answered(content: bytes, _: httpx.Request) -> httpx.Response:
    return httpx.Response(200, content=content)


def test_batches() -> None:
    names = [f"{i:032x}" for i in range(4)]
    frames = [(200, b"first"), (404, b""), (200, b""), (500, b"")]
    content = b"".join(
        struct.pack("<32sII", name.encode(), status, len(data)) + data
        for name, (status, data) in zip(names, frames, strict=True)
    )

    def handler(request: httpx.Request) -> httpx.Response:
        assert request.url.path == "/tiles:batch"
        assert json.loads(request.content) == {"hashes": names}
        return httpx.Response(200, content=content)

    answers = http(handler).tiles(names)
    assert answers[0] == b"first"
    assert answers[2] == b""
    assert isinstance(answers[1], MissingRecordError)
    assert isinstance(answers[3], RefusedError)
    for cut in (content[:10], content[:-1], content[:42], b""):
        broken = http(partial(answered, cut)).tiles(names)
        assert all(isinstance(answer, CorruptRecordError) for answer in broken)


def test_busy_server_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nurbs_client.transport.RETRY_S", (0.0, 0.0))
    answers = iter([httpx.Response(503), httpx.Response(503), httpx.Response(200, content=b"tile")])
    assert http(lambda _: next(answers)).node_tile(1) == b"tile"


def test_materials() -> None:
    [material] = materials_of({"materials": [{"name": "steel", "rgba": [0.1, 0.2, 0.3, 1]}]})
    assert material.rgba == (0.1, 0.2, 0.3, 1)


def test_cache_transport(tmp_path: Path, grid_world: Any) -> None:
    folder = tmp_path / "cache"
    name = grid_world.nodes["tile_hash"][5].decode()
    with Store.create(folder, provenance={}) as store:
        store.put_scene([], grid_world.materials, grid_world.occurrences, {})
        store.put_tree(grid_world.nodes, grid_world.items, {})
        store.put_tiles([(name, grid_world.tiles[name])])
    with CacheTransport(folder) as transport:
        assert materials_of(transport.scene()) == grid_world.materials
        assert (transport.nodes() == grid_world.nodes).all()
        assert (transport.items() == grid_world.items).all()
        assert (transport.occurrences() == grid_world.occurrences).all()
        found, lost = transport.tiles([name, "0" * 32])
        assert found == grid_world.tiles[name]
        assert isinstance(lost, MissingRecordError)
        with pytest.raises(MissingRecordError, match="nothing here builds"):
            transport.node_tile(2)
        assert transport.bytes_received == len(grid_world.tiles[name])
    with CacheTransport(folder, node_builder=lambda _, row: ("hash", b"built %d" % row)) as transport:
        assert transport.node_tile(2) == b"built 2"
        with Store.open(folder) as _, pytest.raises(MissingRecordError, match="no LOD"):
            transport.surface_lod(1000, 3)


def test_cache_that_another_writes_is_read_as_it_is(tmp_path: Path, grid_world: Any) -> None:
    folder = tmp_path / "cache"
    with Store.create(folder, provenance={}) as store:
        store.put_scene([], grid_world.materials, grid_world.occurrences, {})
        store.put_tree(grid_world.nodes, grid_world.items, {})
        with CacheTransport(folder, node_builder=lambda *_: ("hash", b"")) as transport:
            assert len(transport.nodes()) == len(grid_world.nodes)
            with pytest.raises(MissingRecordError, match="reading only"):
                transport.node_tile(0)


def test_missing_cache_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(CacheError) as caught:
        CacheTransport(tmp_path / "none")
    assert "\n" not in str(caught.value)


def test_source_fetches_names_in_one_go_and_keeps_failures_apart(grid_world: Any, transport_of: Any) -> None:
    transport = transport_of(grid_world)
    names = grid_world.nodes["tile_hash"]
    transport.missing.add(names[1].decode())
    transport.broken.add(names[2].decode())
    keys = [TileKey.of_node(0), TileKey.of_node(1), TileKey.of_node(2), TileKey.of_lod(4, 0)]
    loaded = TileSource(grid_world.scene(), transport).fetch(keys)
    assert [item.key for item in loaded] == keys
    assert [item.mesh is not None for item in loaded] == [True, False, False, True]
    assert isinstance(loaded[1].error, MissingRecordError)
    assert isinstance(loaded[2].error, CorruptRecordError)


class Slow:
    """A fetch that waits to be let go, and notes the order."""

    def __init__(self) -> None:
        self.order: list[TileKey] = []
        self.started, self.go = threading.Event(), threading.Event()

    def __call__(self, keys: list[TileKey]) -> list[Loaded]:
        self.order += keys
        self.started.set()
        self.go.wait(10)
        none = np.zeros(0, np.uint32)
        mesh = make_mesh(np.zeros(3), np.zeros((3, 3), np.float32), np.zeros((3, 3), np.float32),
                         np.arange(3, dtype=np.uint32), none, none, 0.1)  # fmt: skip
        return [Loaded(key, mesh, None) for key in keys]


def requests(*rows: int) -> list[Request]:
    return [Request(0, TileKey.of_node(row)) for row in rows]


def drained(loader: Loader) -> list[int]:
    rows = []
    while loader.is_busy:
        loader.wait(5)
        rows += [loaded.key.node for loaded in loader.collect()]
    return rows


def test_loader_drops_what_no_longer_matters() -> None:
    fetch = Slow()
    loader = Loader(fetch, 1)
    loader.replace(requests(1))
    assert fetch.started.wait(5)
    assert loader.replace(requests(2, 3)) == []
    assert loader.replace(requests(3, 4)) == [TileKey.of_node(2)]
    fetch.go.set()
    assert drained(loader) == [1, 3, 4]
    loader.close()


def test_loader_does_not_load_twice() -> None:
    fetch = Slow()
    loader = Loader(fetch, 2)
    loader.replace(requests(1))
    assert fetch.started.wait(5)
    loader.replace(requests(1))
    fetch.go.set()
    loader.wait(5)
    loader.replace(requests(1))
    assert drained(loader) == [1], "finished, not collected yet: not again"
    loader.close()


def test_loader_hands_on_what_ends_the_flight() -> None:
    def fetch(keys: list[TileKey]) -> list[Loaded]:
        raise ServerError("http://there: gone")

    loader = Loader(fetch, 2)
    loader.replace(requests(1, 2, 3))
    loader.wait(5)
    with pytest.raises(ServerError, match="gone"):
        loader.collect()
    loader.close()


def test_collect_takes_at_least_one_and_stops_at_the_limit() -> None:
    fetch = Slow()
    fetch.go.set()
    loader = Loader(fetch, 1)
    loader.replace(requests(*range(10)))
    for _ in range(100):
        if len(fetch.order) == 10:
            break
        loader.wait(0.05)
    taken = len(loader.collect(max_bytes=1))
    assert taken == 1
    assert sorted(drained(loader)) == list(range(1, 10))
    loader.close()
