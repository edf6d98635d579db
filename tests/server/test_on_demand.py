"""Missing node tiles: built once for all who wait, kept, refused where nothing may be built."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import httpx
import numpy as np

from nurbs_cache.errors import NurbsOocError
from nurbs_cache.store import Store
from nurbs_cache.tile import tile_hash
from nurbs_cache.typed_store import TypedStore
from nurbs_server.app import create_app
from nurbs_server.on_demand import Builders
from tests.server.small_cache import CountingBuilders, Serve, client_of, tile_of

JSON = {"Accept": "application/json"}


def test_a_built_tile_is_only_pointed_to(serve: Serve, builders: CountingBuilders) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get("/api/nodes/0/tile")
        assert answer.status_code == 307
        assert answer.headers["location"] == f"/tiles/{tile_hash(tile_of(0))}"
        assert answer.headers["cache-control"] == "no-cache"
        followed = await client.get("/api/nodes/3/tile", follow_redirects=True)
        assert followed.content == tile_of(3)
        assert (await client.get("/api/nodes/0/tile", headers=JSON)).json() == {"hash": tile_hash(tile_of(0))}

    serve(test)
    assert builders.nodes == []


def test_one_build_for_all_who_wait(small_cache: Path, serve: Serve, builders: CountingBuilders) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        answers = await asyncio.gather(*(client.get("/api/nodes/1/tile", headers=JSON) for _ in range(50)))
        assert {answer.json()["hash"] for answer in answers} == {tile_hash(tile_of(101))}
        assert builders.nodes == [1]
        await client.get("/api/nodes/1/tile")
        assert builders.nodes == [1]
        assert (await client.get(f"/tiles/{tile_hash(tile_of(101))}")).content == tile_of(101)

    serve(test)
    assert all(name.startswith("builds") for name in builders.threads)
    with Store.open(small_cache) as store:
        assert store.get_nodes()[1]["tile_hash"].decode() == tile_hash(tile_of(101))


def test_tiles_are_served_while_others_are_built(serve: Serve, builders: CountingBuilders) -> None:
    builders.seconds = 0.3

    async def test(client: httpx.AsyncClient) -> None:
        build = asyncio.create_task(client.get("/api/nodes/1/tile"))
        await asyncio.sleep(0.05)
        start = time.perf_counter()
        assert (await client.get(f"/tiles/{tile_hash(tile_of(0))}")).status_code == 200
        assert time.perf_counter() - start < 0.2
        assert not build.done()
        assert (await build).status_code == 307

    serve(test)


def test_who_hangs_up_does_not_stop_the_build(serve: Serve, builders: CountingBuilders) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        leaving = asyncio.create_task(client.get("/api/nodes/2/tile"))
        staying = asyncio.create_task(client.get("/api/nodes/2/tile"))
        while not builders.nodes:
            await asyncio.sleep(0.001)
        leaving.cancel()
        assert (await staying).status_code == 307
        assert builders.nodes == [2]

    serve(test)


def test_a_failed_build_is_reported_and_tried_again(small_cache: Path) -> None:
    tries: list[int] = []

    def fail(store: TypedStore, row: int) -> tuple[str, bytes]:
        tries.append(row)
        raise NurbsOocError(f"node {row}: no memory left")

    def fail_lod(store: TypedStore, surface: int, level: int) -> tuple[np.void, bytes]:
        raise AssertionError

    async def main(store: Store) -> None:
        app = create_app(store, Builders(fail, fail_lod))
        async with client_of(app, raise_app_exceptions=False) as client:
            for _ in range(2):
                answer = await client.get("/api/nodes/1/tile")
                assert (answer.status_code, answer.json()["detail"]) == (500, "node 1: no memory left")
            assert (await client.get("/api/surfaces/0/lods/0")).status_code == 500  # a bug of ours: no traceback
            metrics = (await client.get("/metrics")).text
            assert 'nurbs_server_builds_total{result="failed",what="node"} 2.0' in metrics

    with Store.open(small_cache, read_only=False) as store:
        asyncio.run(main(store))
    assert tries == [1, 1]


def test_no_second_build_by_who_looked_too_early(small_cache: Path, builders: CountingBuilders) -> None:
    async def main(store: Store) -> None:
        app = create_app(store, builders.injected)
        on_demand = app.state.backend.on_demand
        async with client_of(app) as client:
            assert on_demand._find_lod(0, 1) is None  # one looks, another's build lands, the first goes on
            assert (await client.get("/api/surfaces/0/lods/1")).status_code == 200
            assert on_demand._find_or_build_lod(0, 1)["level"] == 1

    with Store.open(small_cache, read_only=False) as store:
        asyncio.run(main(store))
    assert builders.lods == [(0, 1)]


def test_no_such_node(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        for row in (4, 1 << 70):
            assert (await client.get(f"/api/nodes/{row}/tile")).status_code == 404
        for row in ("-1", "x"):
            assert (await client.get(f"/api/nodes/{row}/tile")).status_code == 422

    serve(test)


def test_read_only_says_why_not(small_cache: Path, serve_read_only: Serve, builders: CountingBuilders) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        refused = await client.get("/api/nodes/1/tile")
        assert refused.status_code == 409
        problem = refused.json()
        assert problem["error"] == "ReadOnlyError"
        assert "node 1" in problem["detail"]
        assert "process 7 is writing to it" in problem["detail"]
        with Store.open(small_cache, read_only=False) as writer:  # what the other process then builds is found
            builders.build_node(writer, 1)
        assert (await client.get("/api/nodes/1/tile", follow_redirects=True)).content == tile_of(101)

    serve_read_only(test)
