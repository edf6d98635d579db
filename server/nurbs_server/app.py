"""The application: routes, middleware and errors put together around a store."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from fastapi import FastAPI
from starlette.types import Receive, Scope, Send

from nurbs_cache.typed_store import TypedStore
from nurbs_server import batch, cors, errors, health, node_tiles, scene, surfaces, tables, tiles
from nurbs_server.backend import Backend
from nurbs_server.limits import BODY_BYTES, BUILD_THREADS
from nurbs_server.metrics import CountRequests
from nurbs_server.on_demand import Builders

ROUTERS = (scene.router, tables.router, node_tiles.router, batch.router, surfaces.router, health.router)


class Application(FastAPI):
    """The framework's application, with tiles answered in front of it."""

    def __init__(self, backend: Backend, **options: Any) -> None:
        super().__init__(**options)
        self.state.backend = backend
        self._tiles = tiles.TileEndpoint(backend.tiles, backend.metrics)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if self._tiles.takes(scope):
            await self._tiles(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)

    def openapi(self) -> dict[str, Any]:
        """The description of all routes, with those that the framework does not see."""
        description = super().openapi()  # which keeps it: made once
        description["paths"].setdefault(tiles.PATH, tiles.tile_path_item())
        return description


def create_app(
    store: TypedStore,
    builders: Builders | None = None,
    *,
    refusal: str = "this server builds nothing",
    build_threads: int = BUILD_THREADS,
) -> Application:
    """The ASGI application that serves ``store``; the index is read before this returns.

    Args:
        store: an open cache, which stays the caller's to close after the application has shut down.
        builders: how to make missing tiles (the store is then open for writing); None only serves.
        refusal: without builders: why, as the answer 409 gives it.
        build_threads: builds at a time.

    Raises:
        CacheError: the index cannot be read.
    """
    backend = Backend(store, builders, refusal, build_threads)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        yield
        backend.close(wait=False)

    app = Application(
        backend,
        title="nurbs-ooc",
        version=_version(),
        description="Hierarchical levels of detail of an assembly of trimmed NURBS. Lengths are mm.",
        lifespan=lifespan,
        max_body_size=BODY_BYTES,
    )
    for router in ROUTERS:
        app.include_router(router)
    errors.install(app)
    cors.install(app)
    app.add_middleware(CountRequests, metrics=backend.metrics)
    return app


def _version() -> str:
    try:
        return version("nurbs-ooc")
    except PackageNotFoundError:
        return "unknown"
