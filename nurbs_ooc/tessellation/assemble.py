"""One mesh from the rounds of a tessellation: each face as the last round that did it left it, copied once.

A round leaves its faces in chunks, as threads took them; they are copied chunk by chunk to where they belong, by
all threads. A mesh that is one chunk as it is needs no copy at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.tessellation.mesh import NOT_ASKED, MeshBatch

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

VERTICES, TRIANGLES, SEGMENTS = 0, 1, 2


class Arrays(NamedTuple):
    """Those of a mesh, as in ``MeshBatch``, or of a part of one, with room behind what is in use."""

    position: Floats
    normal: Floats
    uv: Floats
    triangle: Ints
    segment: Ints


class Chunk(NamedTuple):
    """Some faces of a round.

    Attributes:
        arrays: their vertices, triangles and segments, face after face.
        turns: (n,) which of the faces of the round they are.
        ends: (n, 3) where those of each face end.
        codes: (n, 3) result of ``tessellate_face``, status, reason.
        errors: (n, 5) mm: surface, trim and p-curve error; then the normals' (radians) and the combined error.
    """

    arrays: Arrays
    turns: Ints
    ends: Ints
    codes: Ints
    errors: Floats


class Round(NamedTuple):
    """Faces that have been done at the same edge samples: their rows in the order of the chunks."""

    rows: Ints
    chunks: list[Chunk]


class _Latest(NamedTuple):
    """Where the faces of a mesh lie, and what is known of each."""

    chunks: Sequence[Chunk]
    chunk: Ints  # (n,) the chunk that a face is in
    place: Ints  # (n,) its number there
    starts: Ints  # (n + 1, 3) where it begins in the mesh
    codes: Ints  # (n, 3)
    errors: Floats  # (n, 5)


@kernel
def _copy_faces(o: Arrays, ends: Ints, place: Ints, start: Ints, out: Arrays) -> None:
    """Copy the faces ``place`` (n,) of a chunk to where they begin in the mesh, by ``start`` (n, 3)."""
    for i in range(len(place)):
        face = place[i]
        v, t, s = 0, 0, 0
        if face > 0:
            v, t, s = ends[face - 1, VERTICES], ends[face - 1, TRIANGLES], ends[face - 1, SEGMENTS]
        shift = start[i, VERTICES] - v
        to = start[i, VERTICES]
        for k in range(v, ends[face, VERTICES]):
            for m in range(3):
                out.position[to, m] = o.position[k, m]
                out.normal[to, m] = o.normal[k, m]
            out.uv[to, 0], out.uv[to, 1] = o.uv[k, 0], o.uv[k, 1]
            to += 1
        to = start[i, TRIANGLES]
        for k in range(t, ends[face, TRIANGLES]):
            for m in range(3):
                out.triangle[to, m] = o.triangle[k, m] + shift
            to += 1
        to = start[i, SEGMENTS]
        for k in range(s, ends[face, SEGMENTS]):
            for m in range(2):
                out.segment[to, m] = o.segment[k, m] + shift
            to += 1


def _copied(latest: _Latest, run: Run) -> Arrays:
    """The faces of all chunks, each where it belongs."""
    vertices, triangles, segments = latest.starts[-1].tolist()
    out = Arrays(
        np.empty((vertices, 3)), np.empty((vertices, 3)), np.empty((vertices, 2)),
        np.empty((triangles, 3), np.int64), np.empty((segments, 2), np.int64),
    )  # fmt: skip
    order = np.argsort(latest.chunk, kind="stable")
    place, start = latest.place[order], latest.starts[order]
    of_chunk = np.searchsorted(latest.chunk[order], np.arange(len(latest.chunks) + 1))

    def copy(low: int, high: int) -> None:
        for c in range(low, high):
            own = slice(of_chunk[c], of_chunk[c + 1])
            _copy_faces(latest.chunks[c].arrays, latest.chunks[c].ends, place[own], start[own], out)

    run(copy, len(latest.chunks))
    return out


def _as_they_are(chunk: Chunk) -> Arrays:
    """The arrays of a chunk that is the mesh."""
    o = chunk.arrays
    vertices, triangles, segments = chunk.ends[-1].tolist()
    return Arrays(
        o.position[:vertices], o.normal[:vertices], o.uv[:vertices], o.triangle[:triangles], o.segment[:segments]
    )


def _name_gaps(codes: Ints, errors: Floats, error: float) -> None:
    """Exact faces that a gap in the file keeps above the error asked for are healed, and say why.

    Without the gap they would have kept it: what surface and trim take is within the error.
    """
    if not errors[:, 2].any():
        return
    over = (errors[:, :3].sum(axis=1) > error) & (errors[:, :2].sum(axis=1) <= error)
    kept_open = over & (codes[:, 1] == FaceStatus.EXACT)
    codes[kept_open, 1] = FaceStatus.HEALED
    codes[kept_open, 2] = FaceReason.FILE_GAP


def _latest(rounds: Sequence[Round], faces: Ints) -> _Latest:
    """The ``faces`` as the last round left them."""
    chunks = [chunk for done in rounds for chunk in done.chunks]
    sizes = np.array([len(c.ends) for c in chunks], np.int64)
    number = np.repeat(np.arange(len(chunks)), sizes)
    within = np.arange(len(number)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    last = np.zeros(1 + max(int(done.rows.max(initial=-1)) for done in rounds), np.int64)
    at = 0
    for done in rounds:
        last[done.rows] = np.arange(at, at + len(done.rows))
        at += len(done.rows)
    pick = last[faces]
    starts = np.zeros((len(faces) + 1, 3), np.int64)
    counts = [np.diff(c.ends, axis=0, prepend=np.zeros((1, 3), np.int64)) for c in chunks]
    np.cumsum(np.concatenate(counts)[pick], axis=0, out=starts[1:])
    codes, errors = np.concatenate([c.codes for c in chunks]), np.concatenate([c.errors for c in chunks])
    return _Latest(chunks, number[pick], within[pick], starts, codes[pick], errors[pick])


def _only(chunk: Chunk) -> _Latest:
    """The faces of a chunk, all of them in its order."""
    n = len(chunk.ends)
    starts = np.zeros((n + 1, 3), np.int64)
    starts[1:] = chunk.ends
    return _Latest([chunk], np.zeros(n, np.int64), np.arange(n), starts, chunk.codes, chunk.errors)


def _nothing() -> _Latest:
    """No faces."""
    none = np.zeros(0, np.int64)
    return _Latest([], none, none, np.zeros((1, 3), np.int64), none.reshape(0, 3), np.zeros((0, 5)))


def assemble(
    rounds: Sequence[Round],
    faces: Ints,
    error: float,
    approximation: Floats,
    run: Run,
    shaded: bool = False,
    combined: bool = False,
) -> MeshBatch:
    """The mesh of ``faces``.

    Args:
        rounds: all of them in their order.
        faces: (n,) distinct rows, each in one round at least.
        error: mm, what was asked for.
        approximation: (n,) mm: what the faces' own surfaces are off by, part of the p-curve error.
        run: maps the copying over ranges of chunks.
        shaded, combined: whether the mesh has ``normal_error``, and ``appearance_error``.
    """
    first = rounds[0].chunks
    whole = len(rounds) == 1 and len(first) == 1 and np.array_equal(rounds[0].rows, faces)
    latest = _only(first[0]) if whole else _latest(rounds, faces) if len(faces) else _nothing()
    starts, codes, errors = latest.starts, latest.codes, latest.errors
    _name_gaps(codes, errors, error)
    arrays = _as_they_are(latest.chunks[0]) if whole else _copied(latest, run)
    return MeshBatch(
        faces=faces,
        vertex_start=starts[:, VERTICES].copy(),
        triangle_start=starts[:, TRIANGLES].copy(),
        segment_start=starts[:, SEGMENTS].copy(),
        positions=arrays.position,
        normals=arrays.normal,
        parameters=arrays.uv,
        triangles=arrays.triangle,
        segments=arrays.segment,
        surface_error=errors[:, 0].copy(),
        trim_error=errors[:, 1].copy(),
        pcurve_error=errors[:, 2] + approximation,
        status=codes[:, 1].astype(np.uint8),
        reason=codes[:, 2].astype(np.uint16),
        normal_error=np.degrees(errors[:, 3]) if shaded else NOT_ASKED,
        appearance_error=errors[:, 4].copy() if combined else NOT_ASKED,
    )
