"""Web pages of any origin may read from here: nothing here depends on who asks."""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware

from nurbs_server.limits import CORS_MAX_AGE_S

EXPOSED = (
    "ETag",
    "Content-Length",
    "Content-Range",
    "Content-Location",
    "X-Geometric-Error",
    "X-First-Row",
    "X-Total-Rows",
)

# what an answer carries that does not pass through the middleware
TO_ANY_ORIGIN = {"access-control-allow-origin": "*", "access-control-expose-headers": ", ".join(EXPOSED)}


def install(app: FastAPI) -> None:
    """Let pages read the headers they need, and ask in advance only once a day."""
    app.add_middleware(
        CORSMiddleware,
        allow_origins=["*"],
        allow_methods=["GET", "HEAD", "POST"],
        allow_headers=["*"],
        expose_headers=EXPOSED,
        max_age=CORS_MAX_AGE_S,
    )
