"""``GET`` and ``HEAD /tiles/{hash}``: bytes that never change, straight from ASGI.

Tiles are nearly all that a client asks for, and with the layers of the framework (routing, limits, error
and CORS handling) a request takes three to four times the time (``scripts/bench_serve.py``). So ``Application``
answers these paths before the framework sees them; what the layers would have added, the few headers
for other origins and the counting, is done here.

A tile's name is the hash of its content: it may be kept for ever, and its ETag is its name.
"""

from __future__ import annotations

from typing import Any

from starlette.types import Receive, Scope, Send

from nurbs_cache.errors import NurbsOocError
from nurbs_server.conditional import Conditions, decide
from nurbs_server.cors import TO_ANY_ORIGIN
from nurbs_server.errors import Problem, problem_response
from nurbs_server.metrics import Metrics
from nurbs_server.responses import BINARY, OCTETS
from nurbs_server.tile_reader import TileReader

PREFIX = "/tiles/"
PATH = PREFIX + "{hash}"
IMMUTABLE = "public, max-age=31536000, immutable"

_ORIGIN = [(name.encode(), value.encode()) for name, value in TO_ANY_ORIGIN.items()]
_BASE = [
    (b"content-type", OCTETS.encode()),
    (b"cache-control", IMMUTABLE.encode()),
    (b"accept-ranges", b"bytes"),
    *_ORIGIN,
]


class TileEndpoint:
    """The ASGI application for paths that start with ``PREFIX``."""

    def __init__(self, tiles: TileReader, metrics: Metrics) -> None:
        self._tiles = tiles
        self._metrics = metrics

    def takes(self, scope: Scope) -> bool:
        """Whether this is a request to answer here; what a browser asks in advance is not."""
        return bool(scope["type"] == "http" and scope["path"].startswith(PREFIX) and scope["method"] != "OPTIONS")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 200, 206, 304, 404, 405, 412, 416, 422 or 500."""
        tile_hash = scope["path"][len(PREFIX) :]
        if scope["method"] not in ("GET", "HEAD"):
            await _send(send, 405, [*_ORIGIN, (b"allow", b"GET, HEAD")], b"")
            self._metrics.count(PATH, 405, 0)
            return
        try:
            data = self._tiles.warm(tile_hash) or await self._tiles.load(tile_hash)
        except NurbsOocError as error:
            problem = problem_response(error, TO_ANY_ORIGIN)
            await problem(scope, receive, send)
            self._metrics.count(PATH, problem.status_code, len(problem.body))
            return
        status, n_sent = await _answer(scope, send, f'"{tile_hash}"', data)
        self._metrics.count(PATH, status, n_sent)


async def _answer(scope: Scope, send: Send, etag: str, data: bytes) -> tuple[int, int]:
    """Send what the request's conditions leave of the tile; returns the status and the bytes sent."""
    is_get = scope["method"] == "GET"
    decision = decide(Conditions.from_headers(scope["headers"]), etag, len(data), ranges=is_get)
    headers = [*_BASE, (b"etag", etag.encode())]
    body = b""
    if decision.status in (200, 206):
        body = data if decision.status == 200 else data[decision.start : decision.stop]
        headers.append((b"content-length", b"%d" % len(body)))
    if decision.status == 206:
        headers.append((b"content-range", b"bytes %d-%d/%d" % (decision.start, decision.stop - 1, len(data))))
    elif decision.status == 416:
        headers.append((b"content-range", b"bytes */%d" % len(data)))
    body = body if is_get else b""
    await _send(send, decision.status, headers, body)
    return decision.status, len(body)


async def _send(send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes) -> None:
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def tile_path_item() -> dict[str, Any]:
    """The route's OpenAPI description, which the framework cannot derive."""
    text: dict[str, Any] = {"schema": {"type": "string"}}
    number: dict[str, Any] = {"schema": {"type": "integer"}}
    headers = {"ETag": text, "Cache-Control": text, "Accept-Ranges": text, "Content-Length": number}
    problem = {"content": {"application/json": {"schema": {"$ref": f"#/components/schemas/{Problem.__name__}"}}}}
    responses: dict[str, Any] = {
        "200": {"description": "The tile.", "headers": headers, "content": {OCTETS: BINARY}},
        "206": {
            "description": "The bytes asked for by `Range` (a single range).",
            "headers": {**headers, "Content-Range": text},
            "content": {OCTETS: BINARY},
        },
        "304": {"description": "The client has it: `If-None-Match` names it."},
        "404": {"description": "There is no such tile.", **problem},
        "412": {"description": "`If-Match` names another one."},
        "416": {"description": "The range lies beyond the tile.", "headers": {"Content-Range": text}},
        "422": {"description": "This is no tile hash.", **problem},
        "500": {"description": "The stored tile fails its checksum.", **problem},
    }
    parameters = [
        {"name": "hash", "in": "path", "required": True, "schema": {"type": "string", "pattern": "^[0-9a-f]{32}$"}},
        *(
            {"name": name, "in": "header", "required": False, **text}
            for name in ("Range", "If-Range", "If-None-Match", "If-Match")
        ),
    ]
    operation = {"tags": ["tiles"], "parameters": parameters, "responses": responses}
    head = {status: {k: v for k, v in answer.items() if k != "content"} for status, answer in responses.items()}
    return {
        "get": {**operation, "summary": "A tile by its content hash", "operationId": "get_tile"},
        "head": {
            **operation,
            "summary": "The same without the bytes",
            "operationId": "head_tile",
            "responses": {status: answer for status, answer in head.items() if status not in ("206", "416")},
        },
    }
