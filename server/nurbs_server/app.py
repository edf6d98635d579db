"""The application: routes, middleware and errors put together around a store."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware

from nurbs_cache.typed_store import TypedStore
from nurbs_server import batch, errors, health, node_tiles, scene, surfaces, tables, tiles
from nurbs_server.backend import Backend
from nurbs_server.limits import BODY_BYTES, BUILD_THREADS, CORS_MAX_AGE_S
from nurbs_server.metrics import CountRequests
from nurbs_server.on_demand import Builders

ROUTERS = (scene.router, tables.router, node_tiles.router, batch.router, surfaces.router, health.router)
EXPOSED = (
    "ETag",
    "Content-Length",
    "Content-Range",
    "Content-Location",
    "X-Geometric-Error",
    "X-First-Row",
    "X-Total-Rows",
)


def create_app(
    store: TypedStore,
    builders: Builders | None = None,
    *,
    refusal: str = "this server builds nothing",
    build_threads: int = BUILD_THREADS,
    allow_origins: Sequence[str] = ("*",),
) -> FastAPI:
    """The ASGI application that serves ``store``; the index is read before this returns.

    Args:
        store: an open cache, which stays the caller's to close after the application has shut down.
        builders: how to make missing tiles (the store is then open for writing); None only serves.
        refusal: without builders: why, as the answer 409 gives it.
        build_threads: builds at a time.
        allow_origins: whose web pages may read from here; nothing here depends on who asks.

    Raises:
        CacheError: the index cannot be read.
    """
    backend = Backend(store, builders, refusal, build_threads)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        yield
        backend.close(wait=False)

    app = FastAPI(
        title="nurbs-ooc",
        version=_version(),
        description="Hierarchical levels of detail of an assembly of trimmed NURBS. Lengths are mm.",
        lifespan=lifespan,
        max_body_size=BODY_BYTES,
    )
    app.state.backend = backend
    app.router.routes.append(tiles.tile_route(backend.tiles))
    for router in ROUTERS:
        app.include_router(router)
    errors.install(app)
    app.add_middleware(
        CORSMiddleware,
        allow_origins=allow_origins,
        allow_methods=["GET", "HEAD", "POST"],
        allow_headers=["*"],
        expose_headers=EXPOSED,
        max_age=CORS_MAX_AGE_S,
    )
    app.add_middleware(CountRequests, metrics=backend.metrics)
    _describe_raw_routes(app)
    return app


def _describe_raw_routes(app: FastAPI) -> None:
    """Add to the OpenAPI description what the framework cannot see."""
    derive = app.openapi

    def openapi() -> dict[str, Any]:
        description = derive()  # kept by the framework: made once
        description["paths"].setdefault(tiles.PATH, tiles.tile_path_item())
        return description

    app.openapi = openapi  # type: ignore[method-assign]


def _version() -> str:
    try:
        return version("nurbs-ooc")
    except PackageNotFoundError:
        return "unknown"
