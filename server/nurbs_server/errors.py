"""The one table from what went wrong to the HTTP status that says so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from nurbs_cache.errors import CacheError, CorruptRecordError, MissingRecordError, NurbsOocError, UsageError


class ReadOnlyError(CacheError):
    """The request needs something to be built, but this server may not write its cache."""


class BusyError(NurbsOocError):
    """More work is waiting than this server takes on; asking again later may succeed."""


STATUS: dict[type[NurbsOocError], int] = {
    MissingRecordError: 404,  # nothing of that name
    ReadOnlyError: 409,  # the state of this server forbids it
    UsageError: 422,  # the request itself is wrong
    BusyError: 503,  # right, but not now
    CorruptRecordError: 500,  # there, but unreadable: never 404
    NurbsOocError: 500,
}


class Problem(BaseModel):
    """The body of every answer from 400 on."""

    error: str = Field(description="name of the error's class")
    detail: str = Field(description="one line: what, which value, which limit")


def status_of(error: NurbsOocError) -> int:
    """The status of the nearest class in the table."""
    return next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)


def problem_response(error: NurbsOocError, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """The answer for an error of ours, the same from every route."""
    status = status_of(error)
    headers = {**(headers or {}), **({"Retry-After": "1"} if status == 503 else {})}
    return JSONResponse(Problem(error=type(error).__name__, detail=str(error)).model_dump(), status, headers)


def problems(*statuses: int) -> dict[int | str, dict[str, object]]:
    """What a route adds to its OpenAPI description for the errors it can answer with."""
    return {status: {"model": Problem} for status in statuses}


def install(app: FastAPI) -> None:
    """Answer errors of ours, and badly formed requests, through the table."""

    async def on_error(_: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, NurbsOocError)
        return problem_response(error)

    async def on_invalid(_: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        return problem_response(UsageError(_first_line(error.errors())))

    app.add_exception_handler(NurbsOocError, on_error)
    app.add_exception_handler(RequestValidationError, on_invalid)


def _first_line(errors: Sequence[dict[str, object]]) -> str:
    """The first complaint of a validation as "where: what (value)"."""
    first = errors[0]
    where = ".".join(str(step) for step in first["loc"]) if isinstance(first["loc"], tuple) else str(first["loc"])
    return f"{where}: {first['msg']} ({str(first.get('input'))[:80]!r})"
