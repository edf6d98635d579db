"""The scene and its tables: the same bytes as stored, revalidated, and as JSON for people."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx
import numpy as np
import pytest

from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE
from nurbs_cache.store import Store
from nurbs_server.app import create_app
from nurbs_server.limits import JSON_ROWS
from tests.server.small_cache import IDENTITY, Serve, client_of, tile_of

JSON = {"Accept": "application/json"}


def test_scene(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache) as store:
        content_hash = store.content_hash()
        first_hash = store.get_nodes()[0]["tile_hash"].decode()

    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get("/api/scene")
        assert answer.headers["cache-control"] == "no-cache"
        scene = answer.json()
        assert scene["schema"] == 1
        assert scene["units"] == {"file": "inch"}
        assert scene["content_hash"] == content_hash
        assert scene["products"][1] == {"name": "bolt Ø5", "parent": 0, "transform": list(IDENTITY)}
        assert scene["materials"][1] == {"name": "red", "rgba": [1.0, 0.0, 0.0, 0.5]}
        assert (scene["n_nodes"], scene["n_items"], scene["n_occurrences"], scene["n_surfaces"]) == (4, 6, 3, 4)
        assert [root["row"] for root in scene["roots"]] == [0, 3]
        assert scene["roots"][0] == {
            "row": 0,
            "key": "0",
            "material": 0,
            "aabb_min": [0.0, 0.0, 0.0],
            "aabb_max": [10.0, 10.0, 10.0],
            "geometric_error": 1.0,
            "tile_hash": first_hash,
        }

    serve(test)


def test_a_reader_of_the_layouts_needs_no_numpy_of_ours(small_cache: Path, serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        layouts = (await client.get("/api/scene")).json()["layouts"]
        for name, dtype in (("node", NODE_DTYPE), ("item", ITEM_DTYPE), ("occurrence", OCCURRENCE_DTYPE)):
            fields = layouts[name]["fields"]
            rebuilt = np.dtype(
                {
                    "names": [f["name"] for f in fields],
                    "formats": [("<" + f["type"], tuple(f["shape"])) for f in fields],
                    "offsets": [f["offset"] for f in fields],
                    "itemsize": layouts[name]["bytes"],
                }
            )
            assert rebuilt.fields == dtype.fields

    serve(test)


def test_tables_are_the_stored_bytes(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache) as store:
        stored = {"nodes": store.get_nodes(), "items": store.get_items(), "occurrences": store.get_occurrences()}

    async def test(client: httpx.AsyncClient) -> None:
        for name, table in stored.items():
            answer = await client.get(f"/api/{name}")
            assert answer.content == table.tobytes()
            assert answer.headers["content-type"] == "application/octet-stream"
            assert answer.headers["cache-control"] == "no-cache"
            assert answer.headers["x-total-rows"] == str(len(table))
            page = await client.get(f"/api/{name}?first=1&count=2")
            assert page.content == table[1:3].tobytes()
            assert page.headers["x-first-row"] == "1"
            assert (await client.get(f"/api/{name}?first=99&count=5")).content == b""

    serve(test)


def test_nodes_of_one_root(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache) as store:
        nodes = store.get_nodes()

    async def test(client: httpx.AsyncClient) -> None:
        for root, rows in ((0, slice(0, 3)), (3, slice(3, 4))):
            answer = await client.get(f"/api/nodes?root={root}")
            assert answer.content == nodes[rows].tobytes()
            assert answer.headers["x-first-row"] == str(root)
        assert (await client.get("/api/nodes?root=0&first=2&count=10")).content == nodes[2:3].tobytes()
        for row in (1, 99):
            refused = await client.get(f"/api/nodes?root={row}")
            assert refused.status_code == 422
            assert "no root" in refused.json()["detail"]

    serve(test)


def test_tables_as_json(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        nodes = (await client.get("/api/nodes?first=1&count=1", headers=JSON)).json()
        assert len(nodes) == 1
        assert (nodes[0]["row"], nodes[0]["key"], nodes[0]["parent"]) == (1, "0-1", 0)
        assert nodes[0]["aabb_max"] == [10.0, 10.0, 10.0]
        items = (await client.get("/api/items", headers=JSON)).json()
        assert [item["surface"] for item in items] == [0, 1, 0, 1, 2, 3]
        assert len((await client.get("/api/occurrences", headers=JSON)).json()[0]["transform"]) == 3

    serve(test)


@pytest.mark.parametrize("path", ["/api/scene", "/api/nodes", "/api/items?first=1", "/api/occurrences"])
def test_unchanged_costs_nothing(serve: Serve, path: str) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        raw, as_json = (await client.get(path)).headers["etag"], await client.get(path, headers=JSON)
        again = await client.get(path, headers={"If-None-Match": raw})
        assert (again.status_code, again.content) == (304, b"")
        assert (await client.get(path, headers={"If-Match": '"other"'})).status_code == 412
        if path != "/api/scene":
            assert as_json.headers["etag"] != raw  # another representation, another tag

    serve(test)


def test_a_built_tile_changes_the_index(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        old = {path: (await client.get(path)).headers["etag"] for path in ("/api/nodes", "/api/items")}
        assert (await client.get("/api/nodes/1/tile")).status_code == 307
        nodes = await client.get("/api/nodes", headers={"If-None-Match": old["/api/nodes"]})
        assert nodes.status_code == 200
        rows = np.frombuffer(nodes.content, NODE_DTYPE)
        assert rows[1]["tile_bytes"] == len(tile_of(101))
        assert rows[0]["geometric_error"] == 1.125  # the ancestor that the build raised
        scene = (await client.get("/api/scene")).json()
        assert scene["roots"][0]["geometric_error"] == 1.125
        items = await client.get("/api/items", headers={"If-None-Match": old["/api/items"]})
        assert items.status_code == 304

    serve(test)


@pytest.mark.parametrize(
    "path", ["/api/nodes?first=-1", "/api/nodes?count=-1", "/api/items?first=x", "/api/nodes?root=-1"]
)
def test_bad_pages_are_refused(serve: Serve, path: str) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get(path)
        assert answer.status_code == 422
        assert set(answer.json()) == {"error", "detail"}

    serve(test)


def test_json_is_bounded(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache, read_only=False) as store:
        store.put_tree(store.get_nodes(), np.zeros(JSON_ROWS + 1, ITEM_DTYPE))

    async def test(client: httpx.AsyncClient) -> None:
        assert (await client.get("/api/items", headers=JSON)).status_code == 422
        assert len((await client.get("/api/items")).content) == (JSON_ROWS + 1) * ITEM_DTYPE.itemsize
        assert len((await client.get(f"/api/items?count={JSON_ROWS}", headers=JSON)).json()) == JSON_ROWS

    serve(test)


def test_a_cache_without_a_tree(cache_path: Path) -> None:
    async def main(store: Store) -> None:
        async with client_of(create_app(store)) as client:
            scene = (await client.get("/api/scene")).json()
            assert (scene["roots"], scene["n_nodes"], scene["products"]) == ([], 0, [])
            for table in ("nodes", "items", "occurrences"):
                assert (await client.get(f"/api/{table}")).content == b""
            assert (await client.get("/api/nodes?root=0")).status_code == 422
            assert (await client.get("/api/nodes/0/tile")).status_code == 404
            assert (await client.get("/api/surfaces/0")).status_code == 404

    with Store.create(cache_path) as store:
        asyncio.run(main(store))


def test_a_damaged_cache_is_served_without_its_hash(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache, read_only=False) as store:
        store.delete_many("tiles", list(store.scan_keys("tiles"))[:1])

    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get("/api/scene")
        assert (answer.status_code, answer.json()["content_hash"]) == (200, None)
        assert len(answer.json()["roots"]) == 2

    serve(test)
