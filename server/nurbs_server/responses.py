"""Answers that may change: always revalidated, cheap when they have not.

``no-cache`` makes a browser ask each time, the ETag lets it keep what it has.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from fastapi import Request, Response

from nurbs_server.conditional import Conditions, decide

OCTETS = "application/octet-stream"
BINARY: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}


def etag_of(*parts: object) -> str:
    """A strong entity tag for what these parts identify."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part if isinstance(part, bytes) else f"{part}|".encode())
    return f'"{digest.hexdigest()}"'


def fresh(
    request: Request, body: bytes, etag: str, media_type: str = OCTETS, headers: Mapping[str, str] | None = None
) -> Response:
    """``body``, or 304 or 412 if the request's conditions say so."""
    known = {"ETag": etag, "Cache-Control": "no-cache", **(headers or {})}
    status = decide(Conditions.from_headers(request.headers.raw), etag, len(body), ranges=False).status
    if status != 200:
        return Response(status_code=status, headers=known)
    return Response(body, headers=known, media_type=media_type)


def wants_json(request: Request) -> bool:
    """Whether the client asks for JSON where raw rows are the default."""
    return "application/json" in request.headers.get("accept", "")


def layout_of(dtype: np.dtype[np.void]) -> dict[str, Any]:
    """A record's layout for readers in any language: little-endian fields with offsets in bytes."""
    offsets = {name: int(entry[1]) for name, entry in (dtype.fields or {}).items()}
    fields = []
    for name in dtype.names or ():
        base, shape = dtype[name].subdtype or (dtype[name], ())
        fields.append({"name": name, "type": base.str.lstrip("<|"), "shape": list(shape), "offset": offsets[name]})
    return {"bytes": dtype.itemsize, "fields": fields}


def row_as_json(record: np.void) -> dict[str, Any]:
    """One record as plain values; byte strings become text."""
    return {name: _plain(record[name]) for name in record.dtype.names or ()}


def rows_as_json(table: npt.NDArray[np.void], first: int) -> list[dict[str, Any]]:
    """Records as plain values, each with its ``row`` in the whole table."""
    return [{"row": first + i, **row_as_json(record)} for i, record in enumerate(table)]


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("ascii")
    return value.tolist()
