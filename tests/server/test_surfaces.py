"""Single surfaces: cut out whole, and their levels of detail built once."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx
import numpy as np
import pytest

from nurbs_cache.keys import number_key
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_cache.tile import tile_hash
from nurbs_server.limits import LOD_LEVELS
from tests.server.small_cache import CountingBuilders, Serve, tile_of

KINDS = [SurfaceKind.PLANE, SurfaceKind.CYLINDER, SurfaceKind.SPHERE, SurfaceKind.NURBS]


@pytest.mark.parametrize("surface", range(4))
def test_a_surface_comes_with_all_it_needs(small_cache: Path, serve: Serve, surface: int) -> None:
    with Store.open(small_cache) as store:
        whole = store.get_part(surface // 2)

    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get(f"/api/surfaces/{surface}")
        assert answer.headers["content-type"] == "application/octet-stream"
        one = GeometryBatch.from_bytes(answer.content)
        assert one.surfaces["kind"].tolist() == [KINDS[surface]]
        loop = whole.surfaces[surface % 2]["first_loop"]
        assert len(one.coedges) == whole.loops[loop]["n_coedges"]
        assert set(one.edges["id"]) <= set(whole.edges["id"])
        assert len(answer.content) < len(whole.to_bytes())
        kept = await client.get(f"/api/surfaces/{surface}", headers={"If-None-Match": answer.headers["etag"]})
        assert kept.status_code == 304

    serve(test)


def test_absent_damaged_and_nonsense_surfaces(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache, read_only=False) as store:
        record = bytearray(store.get("parts", number_key(1)))
        record[-1] ^= 1
        store.put_many("parts", [(number_key(1), bytes(record))])

    async def test(client: httpx.AsyncClient) -> None:
        assert (await client.get("/api/surfaces/0")).status_code == 200
        assert (await client.get("/api/surfaces/2")).status_code == 500
        for absent in (4, 1 << 40, (1 << 63) - 1):
            assert (await client.get(f"/api/surfaces/{absent}")).status_code == 404
        for nonsense in ("-1", "x", str(1 << 64), "9" * 5000):
            assert (await client.get(f"/api/surfaces/{nonsense}")).status_code == 422

    serve(test)


def test_a_lod_is_built_once_and_kept(small_cache: Path, serve: Serve, builders: CountingBuilders) -> None:
    data = tile_of(1000 * 3 - 4 + 50)

    async def test(client: httpx.AsyncClient) -> None:
        url = "/api/surfaces/3/lods/-4"
        answers = await asyncio.gather(*(client.get(url) for _ in range(20)))
        assert builders.lods == [(3, -4)]
        for answer in [*answers, await client.get(url)]:
            assert answer.content == data
            assert float(answer.headers["x-geometric-error"]) == 0.7 * 2.0**-4
            assert answer.headers["cache-control"] == "no-cache"
        assert builders.lods == [(3, -4)]
        assert (await client.get(answers[0].headers["content-location"])).content == data
        kept = await client.get(url, headers={"If-None-Match": answers[0].headers["etag"]})
        assert (kept.status_code, kept.headers["x-geometric-error"]) == (304, "0.04375")

    serve(test)
    with Store.open(small_cache) as store:
        assert store.get_lods(3)["level"].tolist() == [-4]
        assert store.get_tile(tile_hash(data)) == data


def test_lods_that_cannot_be(serve: Serve, builders: CountingBuilders) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        for level in (LOD_LEVELS[0] - 1, LOD_LEVELS[1] + 1, 10**30):
            assert (await client.get(f"/api/surfaces/0/lods/{level}")).status_code == 422
        assert (await client.get("/api/surfaces/0/lods/fine")).status_code == 422
        assert (await client.get("/api/surfaces/4/lods/0")).status_code == 404

    serve(test)
    assert builders.lods == []


def test_read_only_serves_what_is_there(small_cache: Path, serve_read_only: Serve, builders: CountingBuilders) -> None:
    with Store.open(small_cache, read_only=False) as store:
        _, data = builders.build_lod(store, 0, 2)

    async def test(client: httpx.AsyncClient) -> None:
        assert (await client.get("/api/surfaces/0/lods/2")).content == data
        refused = await client.get("/api/surfaces/0/lods/1")
        assert refused.status_code == 409
        assert "process 7 is writing to it" in refused.json()["detail"]
        assert np.frombuffer((await client.get("/api/surfaces/1")).content[:4], "S4")[0] == b"NGB1"

    serve_read_only(test)
