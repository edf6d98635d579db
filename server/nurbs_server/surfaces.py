"""Single surfaces: the exact NURBS for clients that tessellate, levels of detail for those that do not."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Request, Response

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.subset import subset
from nurbs_server.backend import Backend, BackendOf
from nurbs_server.errors import problems
from nurbs_server.responses import BINARY, OCTETS, etag_of, fresh

router = APIRouter(tags=["surfaces"])

SurfaceId = Annotated[int, Path(ge=0, lt=1 << 63, description="id of the surface in the whole assembly")]
Level = Annotated[int, Path(description="ladder level: the error budget is 2**level mm, in the surface's space")]

_RECORD: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A geometry batch of one surface with its loops, curves and edges (`cache/FORMAT.md`).",
        "content": {OCTETS: BINARY},
        "headers": {"ETag": {"schema": {"type": "string"}}},
    },
    304: {"description": "Unchanged."},
    **problems(404, 422, 500),
}
_LOD: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A tile in the surface's own space, the same bytes as `Content-Location` names.",
        "content": {OCTETS: BINARY},
        "headers": {
            "X-Geometric-Error": {"description": "certified, mm, surface space", "schema": {"type": "number"}},
            "Content-Location": {"description": "the tile by its content hash", "schema": {"type": "string"}},
            "ETag": {"schema": {"type": "string"}},
        },
    },
    304: {"description": "Unchanged."},
    **problems(404, 409, 422, 500, 503),
}


@router.get("/api/surfaces/{surface_id}", response_class=Response, responses=_RECORD)
async def surface(request: Request, backend: BackendOf, surface_id: SurfaceId) -> Response:
    """The trimmed NURBS of one surface, self-contained."""
    body = await backend.reads.run(("surface", surface_id), read_surface, backend, surface_id)
    return fresh(request, body, etag_of(body))


@router.get("/api/surfaces/{surface_id}/lods/{level}", response_class=Response, responses=_LOD)
async def surface_lod(request: Request, backend: BackendOf, surface_id: SurfaceId, level: Level) -> Response:
    """One level of detail of a surface, built if nobody has asked for it before."""
    record = await backend.on_demand.surface_lod(surface_id, level)
    tile_hash = bytes(record["tile_hash"]).decode("ascii")
    data = await backend.tiles.read(tile_hash)
    headers = {
        "X-Geometric-Error": repr(float(record["geometric_error"])),
        "Content-Location": request.scope.get("root_path", "") + f"/tiles/{tile_hash}",
    }
    return fresh(request, data, f'"{tile_hash}"', headers=headers)


def read_surface(backend: Backend, surface_id: int) -> bytes:
    """The record of one surface, cut out of its part.

    Raises:
        MissingRecordError: there is no such surface.
        CorruptRecordError: its part cannot be read.
    """
    part, row = backend.store.locate_surface(surface_id)
    geometry = backend.parts.get(part)
    if geometry is None:
        geometry = backend.store.get_part(part)
        backend.parts.put(part, geometry, _size(geometry))
    return subset(geometry, np.array([row])).to_bytes()


def _size(geometry: GeometryBatch) -> int:
    """Bytes of its arrays."""
    arrays = (getattr(geometry, f.name) for f in fields(geometry) if f.name != "sources")
    return sum(array.nbytes for array in arrays)
