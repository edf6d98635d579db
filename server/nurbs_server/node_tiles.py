"""``GET /api/nodes/{row}/tile``: the way to a node's tile, built if it is missing."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel

from nurbs_server.backend import BackendOf
from nurbs_server.errors import problems
from nurbs_server.responses import wants_json

router = APIRouter(tags=["tiles"])


class NodeTile(BaseModel):
    """Where a node's tile is."""

    hash: str


_DESCRIBED: dict[int | str, dict[str, Any]] = {
    200: {"description": "With `Accept: application/json`: the hash.", "model": NodeTile},
    307: {"description": "To `/tiles/{hash}`.", "headers": {"Location": {"schema": {"type": "string"}}}},
    **problems(404, 409, 422, 500, 503),
}

Row = Annotated[int, Path(ge=0, description="row of the node")]


@router.get("/api/nodes/{row}/tile", response_class=JSONResponse, responses=_DESCRIBED)
async def node_tile(request: Request, backend: BackendOf, row: Row) -> Response:
    """Redirect to the node's tile; builds it first, once for all who wait."""
    tile_hash = await backend.on_demand.node_tile(row)
    headers = {"Cache-Control": "no-cache", "Vary": "Accept"}
    if wants_json(request):
        return JSONResponse({"hash": tile_hash}, headers=headers)
    location = request.scope.get("root_path", "") + f"/tiles/{tile_hash}"
    return Response(status_code=307, headers={**headers, "Location": location})
