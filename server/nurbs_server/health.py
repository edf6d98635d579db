"""What an operator asks: is it alive, and what has it done."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import PlainTextResponse
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, Field

from nurbs_server.backend import BackendOf
from nurbs_server.errors import problems

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The server's state."""

    status: str = Field(description="`ok`: the store can be read")
    builds: bool = Field(description="whether missing tiles are built on demand")


@router.get("/healthz", responses=problems(500))
async def healthz(backend: BackendOf) -> Health:
    """Reads from the store; 500 if that fails."""
    await backend.reads.run("healthz", backend.store.counts)
    return Health(status="ok", builds=backend.builds_allowed)


@router.get("/metrics", response_class=PlainTextResponse)
async def metrics(backend: BackendOf) -> Response:
    """Counters in Prometheus' text format."""
    return Response(generate_latest(backend.metrics.registry), headers={"Content-Type": CONTENT_TYPE_LATEST})
