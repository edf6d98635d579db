"""Tiles over HTTP: whole, in part, not at all, and many at once."""

from __future__ import annotations

import struct
from pathlib import Path

import httpx
import pytest

from nurbs_cache.keys import tile_key
from nurbs_cache.store import Store
from nurbs_cache.tile import tile_hash
from nurbs_server.limits import BATCH_TILES, BODY_BYTES
from tests.server.small_cache import Serve, tile_of

TILE = tile_of(0)
HASH = tile_hash(TILE)
URL = f"/tiles/{HASH}"
ABSENT = "0" * 32


def test_a_tile_may_be_kept_for_ever(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        for _ in range(2):  # from the store, then from memory
            answer = await client.get(URL)
            assert answer.status_code == 200
            assert answer.content == TILE
            assert answer.headers["etag"] == f'"{HASH}"'
            assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
            assert answer.headers["content-length"] == str(len(TILE))
            assert answer.headers["accept-ranges"] == "bytes"
            assert answer.headers["content-type"] == "application/octet-stream"

    serve(test)


def test_head_is_get_without_the_bytes(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        get, head = await client.get(URL), await client.head(URL, headers={"Range": "bytes=0-1"})
        assert head.status_code == 200
        assert head.content == b""
        assert dict(head.headers) == dict(get.headers)
        assert (await client.head(f"/tiles/{ABSENT}")).status_code == 404

    serve(test)


def test_conditions(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        kept = await client.get(URL, headers={"If-None-Match": f'"{HASH}"'})
        assert (kept.status_code, kept.content) == (304, b"")
        assert kept.headers["etag"] == f'"{HASH}"'
        assert "content-length" not in kept.headers
        assert (await client.get(URL, headers={"If-None-Match": f'"{ABSENT}"'})).status_code == 200
        assert (await client.get(URL, headers={"If-Match": f'"{ABSENT}"'})).status_code == 412
        assert (await client.get(URL, headers={"If-Match": "*"})).status_code == 200

    serve(test)


def test_ranges(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        part = await client.get(URL, headers={"Range": "bytes=10-19"})
        assert (part.status_code, part.content) == (206, TILE[10:20])
        assert part.headers["content-range"] == f"bytes 10-19/{len(TILE)}"
        assert part.headers["content-length"] == "10"
        tail = await client.get(URL, headers={"Range": "bytes=-7", "If-Range": f'"{HASH}"'})
        assert (tail.status_code, tail.content) == (206, TILE[-7:])
        beyond = await client.get(URL, headers={"Range": f"bytes={len(TILE)}-"})
        assert (beyond.status_code, beyond.headers["content-range"]) == (416, f"bytes */{len(TILE)}")
        assert (await client.get(URL, headers={"Range": "bytes=5-1"})).content == TILE

    serve(test)


def test_absent_is_404_and_damaged_is_500(small_cache: Path, serve: Serve) -> None:
    with Store.open(small_cache, read_only=False) as store:
        store.put_many("tiles", [(tile_key(HASH), TILE[:-1] + bytes([TILE[-1] ^ 1]))])

    async def test(client: httpx.AsyncClient) -> None:
        absent = await client.get(f"/tiles/{ABSENT}")
        assert absent.status_code == 404
        assert absent.json()["error"] == "MissingRecordError"
        for _ in range(2):  # nothing damaged is kept
            damaged = await client.get(URL)
            assert damaged.status_code == 500
            assert damaged.json()["error"] == "CorruptRecordError"
            assert HASH in damaged.json()["detail"]

    serve(test)


@pytest.mark.parametrize(
    "path",
    [
        "/tiles/nonsense",
        "/tiles/",
        "/tiles/..%2f..%2fetc%2fpasswd",
        "/tiles/%2e%2e/%2e%2e/etc/passwd",
        "/tiles//etc/passwd",
        f"/tiles/{HASH.upper()}",
        f"/tiles/{HASH}%00",
        f"/tiles/{HASH}0",
        "/tiles/" + "a" * 5000,
        "/tiles/%ff%fe",
        f"/tiles/{HASH}/more",
    ],
)
def test_nonsense_names_nothing(serve: Serve, path: str) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        assert (await client.get(path)).status_code in (404, 422)

    serve(test)


def test_other_methods_are_refused(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        assert (await client.put(URL, content=b"x")).status_code == 405
        assert (await client.delete(URL)).status_code == 405

    serve(test)


def test_other_origins_may_read(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        answer = await client.get(URL, headers={"Origin": "http://viewer.example"})
        assert answer.headers["access-control-allow-origin"] == "*"
        exposed = {name.strip() for name in answer.headers["access-control-expose-headers"].split(",")}
        assert {"ETag", "Content-Length"} <= exposed
        asked = {"Origin": "http://viewer.example", "Access-Control-Request-Method": "GET"}
        preflight = await client.options(URL, headers={**asked, "Access-Control-Request-Headers": "range"})
        assert preflight.status_code == 200
        assert "range" in preflight.headers["access-control-allow-headers"].lower()

    serve(test)


def frames(body: bytes) -> list[tuple[str, int, bytes]]:
    """Hash, status and bytes of each frame of a batch, read as the documentation says."""
    found = []
    while body:
        name, status, n = struct.unpack("<32sII", body[:40])
        found.append((name.decode(), status, body[40 : 40 + n]))
        assert len(body) >= 40 + n
        body = body[40 + n :]
    return found


def test_batch_answers_in_order(small_cache: Path, serve: Serve) -> None:
    damaged, other = tile_of(7), tile_of(3)
    with Store.open(small_cache, read_only=False) as store:
        store.put_many("tiles", [(tile_key(tile_hash(damaged)), damaged[:-1] + bytes([damaged[-1] ^ 1]))])

    async def test(client: httpx.AsyncClient) -> None:
        hashes = [HASH, ABSENT, tile_hash(other), tile_hash(damaged), HASH]
        answer = await client.post("/tiles:batch", json={"hashes": hashes})
        assert answer.status_code == 200
        assert frames(answer.content) == [
            (HASH, 200, TILE),
            (ABSENT, 404, b""),
            (tile_hash(other), 200, other),
            (tile_hash(damaged), 500, b""),
            (HASH, 200, TILE),
        ]

    serve(test)


def test_batch_limits(serve: Serve) -> None:
    async def test(client: httpx.AsyncClient) -> None:
        full = await client.post("/tiles:batch", json={"hashes": [HASH] * BATCH_TILES})
        assert len(frames(full.content)) == BATCH_TILES
        for hashes in ([HASH] * (BATCH_TILES + 1), [], ["../../etc/passwd"], [HASH.upper()], "all", None):
            refused = await client.post("/tiles:batch", json={"hashes": hashes})
            assert refused.status_code == 422
            assert set(refused.json()) == {"error", "detail"}
        assert (await client.post("/tiles:batch", content=b"{", headers=JSON)).status_code == 422
        huge = b'{"hashes": ["' + b"a" * BODY_BYTES + b'"]}'
        assert (await client.post("/tiles:batch", content=huge, headers=JSON)).status_code == 413

    serve(test)


JSON = {"Content-Type": "application/json"}
