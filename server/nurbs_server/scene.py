"""``/api/scene`` and the tables around it: what a client reads before any geometry."""

from __future__ import annotations

import asyncio
from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from nurbs_cache.node_record import ITEM_DTYPE, LOD_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE
from nurbs_server.backend import Backend, BackendOf
from nurbs_server.errors import problems
from nurbs_server.responses import etag_of, fresh, layout_of, row_as_json

SCHEMA = 1  # of this API; a client refuses a newer one
LAYOUTS = {"node": NODE_DTYPE, "item": ITEM_DTYPE, "occurrence": OCCURRENCE_DTYPE, "lod": LOD_DTYPE}

router = APIRouter(tags=["scene"])
Vector = tuple[float, float, float]


class ProductModel(BaseModel):
    """A node of the product tree."""

    name: str
    parent: int = Field(description="row of the parent, -1 for a root")
    transform: list[float] = Field(description="12 numbers, row-major 3 x 4, to the parent, mm")


class MaterialModel(BaseModel):
    """A colour."""

    name: str
    rgba: tuple[float, float, float, float] = Field(description="linear, 0 to 1")


class RootModel(BaseModel):
    """The root of one material's lazy octree."""

    row: int
    key: str
    material: int
    aabb_min: Vector = Field(description="assembly space, mm")
    aabb_max: Vector
    geometric_error: float = Field(description="mm")
    tile_hash: str = Field(description="empty while the tile is not built")


class FieldModel(BaseModel):
    """A field of a raw record."""

    name: str
    type: str = Field(description="numpy's code: i4, u8, f8, f4, S32 (zero-padded ASCII)")
    shape: list[int]
    offset: int = Field(description="bytes from the record's start")


class LayoutModel(BaseModel):
    """How a raw record lies in memory, little-endian."""

    bytes: int
    fields: list[FieldModel]


class SceneModel(BaseModel):
    """What there is to see."""

    schema_: int = Field(alias="schema", description="version of this API")
    units: dict[str, Any]
    content_hash: str | None = Field(description="of the cache as first asked for; null while it is not known")
    products: list[ProductModel]
    materials: list[MaterialModel]
    n_nodes: int
    n_items: int
    n_occurrences: int
    n_surfaces: int
    roots: list[RootModel]
    layouts: dict[str, LayoutModel] = Field(description="of node, item, occurrence and lod records")


@router.get("/api/scene", response_model=SceneModel, responses=problems(500))
async def scene(request: Request, backend: BackendOf) -> Response:
    """Products, materials and the roots of the hierarchy."""
    content_hash = await backend.content_hash()
    body = await asyncio.to_thread(scene_body, backend, content_hash)
    return fresh(request, body, etag_of(body), "application/json")


def scene_body(backend: Backend, content_hash: str | None) -> bytes:
    """The scene as JSON."""
    index = backend.index
    names = RootModel.model_fields.keys() - {"row"}
    roots = []
    for row in index.roots.tolist():
        record = row_as_json(index.node(row))
        roots.append({"row": row, **{name: record[name] for name in names}})
    value = SceneModel(
        schema=SCHEMA,
        units=index.units,
        content_hash=content_hash,
        products=[ProductModel.model_validate(p, from_attributes=True) for p in index.products],
        materials=[MaterialModel.model_validate(m, from_attributes=True) for m in index.materials],
        n_nodes=len(index.nodes),
        n_items=len(index.items),
        n_occurrences=len(index.occurrences),
        n_surfaces=index.n_surfaces,
        roots=[RootModel.model_validate(root) for root in roots],
        layouts={name: LayoutModel.model_validate(layout_of(dtype)) for name, dtype in LAYOUTS.items()},
    )
    return value.model_dump_json(by_alias=True).encode()
