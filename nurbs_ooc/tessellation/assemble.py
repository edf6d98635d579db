"""One mesh from the rounds of a tessellation: each face as the last round that did it left it, copied once.

A round leaves its faces in chunks, one after the other. Faces that follow one another in a chunk and in the mesh
are copied together; a mesh that is one chunk as it is needs no copy at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_ooc.tessellation.emit import Output
from nurbs_ooc.tessellation.mesh import NOT_ASKED, MeshBatch

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

VERTICES, TRIANGLES, SEGMENTS = 0, 1, 2


class Chunk(NamedTuple):
    """Some faces of a round.

    Attributes:
        output: their vertices, triangles and segments, face after face.
        ends: (n, 3) where those of each face end.
        codes: (n, 3) result of ``tessellate_face``, status, reason.
        errors: (n, 5) mm: surface, trim and p-curve error; then the normals' (radians) and the combined error.
    """

    output: Output
    ends: Ints
    codes: Ints
    errors: Floats


class _Run(NamedTuple):
    """Faces that follow one another: where they lie in a chunk and where they go, by vertices, triangles, segments."""

    output: Output
    start: Ints
    end: Ints
    to: Ints


def _runs(chunks: Sequence[Chunk], chunk: Ints, place: Ints, starts: Ints) -> list[_Run]:
    """The runs of faces number ``place`` of ``chunk``, (n,) each, that begin at ``starts`` (n + 1, 3) in the mesh."""
    breaks = np.flatnonzero((np.diff(chunk) != 0) | (np.diff(place) != 1)) + 1
    runs = []
    for low, high in zip([0, *breaks.tolist()], [*breaks.tolist(), len(chunk)], strict=True):
        c, first = chunks[chunk[low]], int(place[low])
        start = c.ends[first - 1] if first else np.zeros(3, np.int64)
        runs.append(_Run(c.output, start, c.ends[place[high - 1]], starts[low]))
    return runs


def _column(runs: Sequence[_Run], name: str, which: int) -> Any:
    """The rows of all runs, one after the other."""
    parts = [getattr(run.output, name)[run.start[which] : run.end[which]] for run in runs]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _indices(runs: Sequence[_Run], name: str, which: int) -> Ints:
    """The same of rows that name vertices."""
    parts = []
    for run in runs:
        part = getattr(run.output, name)[run.start[which] : run.end[which]]
        shift = run.to[VERTICES] - run.start[VERTICES]
        parts.append(part + shift if shift else part)
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _name_gaps(codes: Ints, errors: Floats, error: float) -> None:
    """Exact faces that a gap in the file keeps above the error asked for are healed, and say why.

    Without the gap they would have kept it: what surface and trim take is within the error.
    """
    over = (errors[:, :3].sum(axis=1) > error) & (errors[:, :2].sum(axis=1) <= error)
    kept_open = over & (codes[:, 1] == FaceStatus.EXACT)
    codes[kept_open, 1] = FaceStatus.HEALED
    codes[kept_open, 2] = FaceReason.FILE_GAP


def _latest(rounds: Sequence[tuple[Ints, Sequence[Chunk]]], faces: Ints) -> tuple[list[_Run], Ints, Ints, Floats]:
    """The runs of ``faces``, where each begins (n + 1, 3), their codes and errors, as the last round left them."""
    chunks = [chunk for _, round_chunks in rounds for chunk in round_chunks]
    starts = np.zeros((len(faces) + 1, 3), np.int64)
    if len(chunks) == 1 and np.array_equal(rounds[0][0], faces):
        c = chunks[0]
        starts[1:] = c.ends
        return [_Run(c.output, starts[0], starts[-1], starts[0])], starts, c.codes, c.errors
    sizes = np.array([len(c.ends) for c in chunks], np.int64)
    number = np.repeat(np.arange(len(chunks)), sizes)
    within = np.arange(len(number)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    last = np.zeros(1 + max(int(rows.max(initial=-1)) for rows, _ in rounds), np.int64)
    at = 0
    for rows, _ in rounds:
        last[rows] = np.arange(at, at + len(rows))
        at += len(rows)
    pick = last[faces]
    counts = [np.diff(c.ends, axis=0, prepend=np.zeros((1, 3), np.int64)) for c in chunks]
    np.cumsum(np.concatenate(counts)[pick], axis=0, out=starts[1:])
    codes, errors = np.concatenate([c.codes for c in chunks]), np.concatenate([c.errors for c in chunks])
    return _runs(chunks, number[pick], within[pick], starts), starts, codes[pick], errors[pick]


def _nothing() -> tuple[list[_Run], Ints, Ints, Floats]:
    none = np.zeros(0, np.int64)
    output = Output(
        np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), none.reshape(0, 3), none.reshape(0, 2), none, none, none
    )
    starts = np.zeros((1, 3), np.int64)
    return [_Run(output, starts[0], starts[0], starts[0])], starts, none.reshape(0, 3), np.zeros((0, 5))


def assemble(
    rounds: Sequence[tuple[Ints, Sequence[Chunk]]],
    faces: Ints,
    error: float,
    approximation: Floats,
    shaded: bool = False,
    combined: bool = False,
) -> MeshBatch:
    """The mesh of ``faces``.

    Args:
        rounds: the rows of each round, and its chunks in their order.
        faces: (n,) distinct rows, each in one round at least.
        error: mm, what was asked for.
        approximation: (n,) mm: what the faces' own surfaces are off by, part of the p-curve error.
        shaded, combined: whether the mesh has ``normal_error``, and ``appearance_error``.
    """
    runs, starts, codes, errors = _latest(rounds, faces) if len(faces) else _nothing()
    _name_gaps(codes, errors, error)
    return MeshBatch(
        faces=faces,
        vertex_start=starts[:, VERTICES].copy(),
        triangle_start=starts[:, TRIANGLES].copy(),
        segment_start=starts[:, SEGMENTS].copy(),
        positions=_column(runs, "position", VERTICES),
        normals=_column(runs, "normal", VERTICES),
        parameters=_column(runs, "uv", VERTICES),
        triangles=_indices(runs, "triangle", TRIANGLES),
        segments=_indices(runs, "segment", SEGMENTS),
        surface_error=errors[:, 0].copy(),
        trim_error=errors[:, 1].copy(),
        pcurve_error=errors[:, 2] + approximation,
        status=codes[:, 1].astype(np.uint8),
        reason=codes[:, 2].astype(np.uint16),
        normal_error=np.degrees(errors[:, 3]) if shaded else NOT_ASKED,
        appearance_error=errors[:, 4].copy() if combined else NOT_ASKED,
    )
