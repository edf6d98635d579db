"""``POST /tiles:batch``: many tiles in one answer, for clients that may open few connections.

The answer is one frame per hash, in the order of the request, nothing before, between or after::

     0  32  the hash, ASCII
    32   4  u32 little-endian: the status that GET /tiles/{hash} would have answered: 200, 404, 500 or 503
    36   4  u32 little-endian: n, the bytes that follow (0 unless the status is 200)
    40   n  the tile
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field, StringConstraints

from nurbs_cache.errors import NurbsOocError
from nurbs_server.backend import BackendOf
from nurbs_server.errors import problems, status_of
from nurbs_server.limits import BATCH_CHUNK, BATCH_TILES
from nurbs_server.responses import BINARY
from nurbs_server.tile_reader import TileReader

MEDIA_TYPE = "application/vnd.nurbs-ooc.tiles"
FRAME = struct.Struct("<32sII")

router = APIRouter(tags=["tiles"])

TileHash = Annotated[str, StringConstraints(pattern="^[0-9a-f]{32}$")]


class BatchRequest(BaseModel):
    """Which tiles."""

    hashes: list[TileHash] = Field(min_length=1, max_length=BATCH_TILES)


_DESCRIBED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": (
            "One frame per hash, in order: 32 bytes hash (ASCII), u32 status (200, 404, 500, 503), u32 length n, "
            "n bytes of the tile; little-endian."
        ),
        "content": {MEDIA_TYPE: BINARY},
    },
    413: {"description": "The request's body is too large."},
    **problems(422),
}


@router.post("/tiles:batch", response_class=StreamingResponse, responses=_DESCRIBED)
async def batch(wanted: BatchRequest, backend: BackendOf) -> StreamingResponse:
    """Several tiles in one binary answer; a tile that cannot be read costs only its own frame."""
    frames = _frames(backend.tiles, wanted.hashes)
    return StreamingResponse(frames, media_type=MEDIA_TYPE, headers={"Cache-Control": "no-store"})


async def _frames(tiles: TileReader, hashes: list[str]) -> AsyncIterator[bytes]:
    """The frames in order, some to a chunk: what is cold in a chunk is read side by side."""
    for first in range(0, len(hashes), BATCH_CHUNK):
        chunk = hashes[first : first + BATCH_CHUNK]
        found = {name: tiles.warm(name) for name in chunk}
        cold = [name for name, data in found.items() if data is None]
        read = await asyncio.gather(*(tiles.load(name) for name in cold), return_exceptions=True)
        yield b"".join(_frame(name, found[name] or read[cold.index(name)]) for name in chunk)


def _frame(name: str, tile: bytes | BaseException) -> bytes:
    if isinstance(tile, bytes):
        return FRAME.pack(name.encode(), 200, len(tile)) + tile
    if isinstance(tile, NurbsOocError):
        return FRAME.pack(name.encode(), status_of(tile), 0)
    raise tile
