"""Health, counters and the API's own description."""

from __future__ import annotations

import re

import httpx

from nurbs_cache.tile import tile_hash
from tests.server.small_cache import Serve, tile_of

URL = f"/tiles/{tile_hash(tile_of(0))}"


def test_health(serve: Serve, serve_read_only: Serve) -> None:
    async def writable(client: httpx.AsyncClient) -> None:
        assert (await client.get("/healthz")).json() == {"status": "ok", "builds": True}

    async def read_only(client: httpx.AsyncClient) -> None:
        assert (await client.get("/healthz")).json() == {"status": "ok", "builds": False}

    serve(writable)
    serve_read_only(read_only)


def test_counters(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        for _ in range(3):
            await client.get(URL)
        await client.get("/api/surfaces/99")
        await client.get("/nowhere")
        await client.get("/api/nodes/1/tile")
        answer = await client.get("/metrics")
        assert answer.headers["content-type"].startswith("text/plain")
        for line in (
            'nurbs_server_requests_total{route="/tiles/{hash}",status="200"} 3.0',
            f'nurbs_server_sent_bytes_total{{route="/tiles/{{hash}}"}} {float(3 * len(tile_of(0)))}',
            'nurbs_server_requests_total{route="/api/surfaces/{surface_id}",status="404"} 1.0',
            'nurbs_server_requests_total{route="unmatched",status="404"} 1.0',
            'nurbs_server_tile_cache_lookups_total{result="hit"} 2.0',
            'nurbs_server_tile_cache_lookups_total{result="miss"} 1.0',
            'nurbs_server_builds_total{result="built",what="node"} 1.0',
            'nurbs_server_build_seconds_count{what="node"} 1.0',
            "nurbs_server_builds_waiting 0.0",
        ):
            assert line in answer.text

    serve(test)


def test_description_covers_every_route(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        for _ in range(2):
            description = (await client.get("/openapi.json")).json()
        assert description["openapi"].startswith("3.")
        assert set(description["paths"]) == {
            "/api/scene",
            "/api/nodes",
            "/api/nodes/{row}/tile",
            "/api/items",
            "/api/occurrences",
            "/tiles/{hash}",
            "/tiles:batch",
            "/api/surfaces/{surface_id}",
            "/api/surfaces/{surface_id}/lods/{level}",
            "/healthz",
            "/metrics",
        }
        text = str(description)
        schemas = description["components"]["schemas"]
        for name in re.findall(r"#/components/schemas/(\w+)", text):
            assert name in schemas
        assert "HTTPValidationError" not in text  # errors have one form
        operations = [op for path in description["paths"].values() for op in path.values()]
        names = [op["operationId"] for op in operations]
        assert len(set(names)) == len(names)
        for path, item in description["paths"].items():
            wanted = set(re.findall(r"\{(\w+)\}", path))
            for operation in item.values():
                given = {p["name"] for p in operation.get("parameters", []) if p["in"] == "path"}
                assert given == wanted
        binary = description["paths"]["/tiles/{hash}"]["get"]["responses"]["200"]["content"]
        assert binary == {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}

    serve(test)
