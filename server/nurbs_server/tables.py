"""Pages of the node, item and occurrence tables: raw rows for programs, JSON for people."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response

from nurbs_cache.errors import UsageError
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE
from nurbs_server.backend import Backend, BackendOf
from nurbs_server.errors import problems
from nurbs_server.limits import JSON_ROWS
from nurbs_server.responses import BINARY, OCTETS, etag_of, fresh, rows_as_json, wants_json

LAYOUT_OF = {"nodes": NODE_DTYPE, "items": ITEM_DTYPE, "occurrences": OCCURRENCE_DTYPE}

router = APIRouter(tags=["scene"])

First = Annotated[int, Query(ge=0, description="first row of the page")]
Count = Annotated[int | None, Query(ge=0, description="rows in the page; all that follow if left out")]
Root = Annotated[int | None, Query(ge=0, description="row of a root: page within this root's nodes only")]


def described(layout: str) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI description of a page."""
    headers = {
        "X-First-Row": {"description": "row of the first record in the whole table", "schema": {"type": "integer"}},
        "X-Total-Rows": {"description": "rows there are to page through", "schema": {"type": "integer"}},
        "ETag": {"schema": {"type": "string"}},
    }
    rows = {"schema": {"type": "array", "items": {"type": "object"}}}
    page = {
        "description": f"Consecutive records of the layout `{layout}` in `/api/scene`; as JSON at most {JSON_ROWS}.",
        "content": {OCTETS: BINARY, "application/json": rows},
        "headers": headers,
    }
    return {200: page, 304: {"description": "Unchanged."}, **problems(422)}


@router.get("/api/nodes", response_class=Response, responses=described("node"))
async def nodes(
    request: Request, backend: BackendOf, root: Root = None, first: First = 0, count: Count = None
) -> Response:
    """Nodes of the hierarchy: the whole table, or those of one root."""
    start, stop = (0, len(backend.index.nodes)) if root is None else backend.index.rows_of_root(root)
    return await _page(request, backend, "nodes", start, stop, first, count)


@router.get("/api/items", response_class=Response, responses=described("item"))
async def items(request: Request, backend: BackendOf, first: First = 0, count: Count = None) -> Response:
    """Placed surfaces, in the order in which the nodes refer to them."""
    return await _page(request, backend, "items", 0, len(backend.index.items), first, count)


@router.get("/api/occurrences", response_class=Response, responses=described("occurrence"))
async def occurrences(request: Request, backend: BackendOf, first: First = 0, count: Count = None) -> Response:
    """Placed parts: part, product, material override, transform."""
    return await _page(request, backend, "occurrences", 0, len(backend.index.occurrences), first, count)


async def _page(
    request: Request, backend: Backend, table: str, start: int, stop: int, first: int, count: int | None
) -> Response:
    """The rows ``first:first + count`` of ``start:stop`` of a table."""
    begin = min(start + first, stop)
    end = stop if count is None else min(begin + count, stop)
    as_json = wants_json(request)
    if as_json and end - begin > JSON_ROWS:
        raise UsageError(f"count: {end - begin} rows as JSON, the limit is {JSON_ROWS}; page, or read the raw rows")
    body, etag = await asyncio.to_thread(_page_body, backend, table, begin, end, as_json)
    headers = {"X-First-Row": str(begin), "X-Total-Rows": str(stop - start), "Vary": "Accept"}
    return fresh(request, body, etag, "application/json" if as_json else OCTETS, headers)


def _page_body(backend: Backend, table: str, begin: int, end: int, as_json: bool) -> tuple[bytes, str]:
    body, digest = backend.index.page(table, begin, end)
    if as_json:
        rows = np.frombuffer(body, LAYOUT_OF[table])
        body = json.dumps(rows_as_json(rows, begin), allow_nan=False).encode()
    return body, etag_of(digest, begin, end, as_json)
