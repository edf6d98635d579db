"""Certified triangles of the faces of a part: the driver of the stages in this folder.

pieces -> edge samples -> faces -> (edges that need more samples -> again) -> mesh
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.bounds.pieces import Pieces, bezier_pieces
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables
from nurbs_ooc.tessellation.cells import CellScratch
from nurbs_ooc.tessellation.edges import EdgeSamples, EdgeUses, edge_uses, sample_edges
from nurbs_ooc.tessellation.emit import Output, emit_face, emit_points, new_output
from nurbs_ooc.tessellation.face import BOX_AS_POINTS, NEEDS_SAMPLES, tessellate_face
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.refine import Check
from nurbs_ooc.tessellation.workers import chunk_runner

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Rounds of "more samples on these edges", each of which doubles them.
MAX_ROUNDS = 7
# Smallest error that is taken at its word, relative to the size of the coordinates: a few units of roundoff.
SMALLEST_ERROR = 2.0**-46


@kernel
def _faces(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, low: int, high: int, error: float, final: bool,
    wanted: Ints,
) -> tuple[Output, Ints, Ints, Floats]:  # fmt: skip
    """Tessellate faces[low:high]: arrays, end offsets (n, 3), codes (n, 3: code, status, reason), errors (n, 3)."""
    o = new_output(256 * (high - low))
    ends = np.zeros((high - low, 3), dtype=np.int64)
    codes = np.zeros((high - low, 3), dtype=np.int64)
    errors = np.zeros((high - low, 3))
    work = np.empty((3, MAX_DEGREE + 2, 4))
    cells = CellScratch(
        work,
        np.empty(5),
        np.empty((MAX_DEGREE + 1) * (MAX_DEGREE + 1) * 4),
        np.empty((MAX_DEGREE + 2, 4)),
        np.empty(4),
    )
    check = Check(work, np.empty(5), np.empty(3), np.empty(256, dtype=np.int64))
    scratch = np.empty((4, MAX_DEGREE + 2))
    for i in range(high - low):
        row = faces[low + i]
        s = g.surfaces[row]
        codes[i, 1], codes[i, 2] = s.status, s.reason
        if s.status != 3:
            code, b, t, point, f, worst, extra, status, reason = tessellate_face(
                g, p, samples, row, error, final, cells, check, wanted
            )
            codes[i, 0] = code
            if status > codes[i, 1]:
                codes[i, 1], codes[i, 2] = status, reason
            if code != NEEDS_SAMPLES:
                if reason == BOX_AS_POINTS:
                    o = emit_points(b, o)
                else:
                    o = emit_face(g, row, b, t, point, f, scratch, o)
                errors[i, 0], errors[i, 1], errors[i, 2] = worst, b.trim + extra, b.gap
        for k in range(3):
            ends[i, k] = o.n[k]
    return o, ends, codes, errors


def _run_faces(
    g: Tables, pieces: Pieces, samples: EdgeSamples, faces: Ints, error: float, final: bool, wanted: Ints,
    run: Callable[..., list[Any]],
) -> list[Any]:  # fmt: skip
    """All faces in chunks; ``wanted`` is summed over the threads' own counts."""

    def chunk(low: int, high: int) -> Any:
        own = np.zeros_like(wanted)
        return (*_faces(g, pieces, samples, faces, low, high, error, final, own), own)

    results = run(chunk, len(faces))
    for result in results:
        wanted += result[4]
    return results


def _name_gaps(codes: Ints, errors: Floats, error: float) -> None:
    """Exact faces that a gap in the file keeps above the error asked for are healed, and say why."""
    kept_open = (errors.sum(axis=1) > error) & (errors[:, 2] > 0.0) & (codes[:, 1] == FaceStatus.EXACT)
    codes[kept_open, 1] = FaceStatus.HEALED
    codes[kept_open, 2] = FaceReason.FILE_GAP


def _join(geometry: GeometryBatch, faces: Ints, results: list[Any], error: float) -> MeshBatch:
    """Concatenate the chunks' arrays into one mesh."""
    counts = [np.diff(r[1], axis=0, prepend=np.zeros((1, 3), np.int64)) for r in results]
    per_face = np.concatenate(counts) if counts else np.zeros((0, 3), np.int64)
    starts = np.concatenate([np.zeros((1, 3), np.int64), np.cumsum(per_face, axis=0)])
    base = np.concatenate([[0], np.cumsum([r[0].n[0] for r in results])]).astype(np.int64)
    codes = np.concatenate([r[2] for r in results]) if results else np.zeros((0, 3), np.int64)
    errors = np.concatenate([r[3] for r in results]) if results else np.zeros((0, 3))

    def joined(name: str, which: int, columns: int, dtype: type, offset: bool = False) -> Any:
        parts = []
        for r, start in zip(results, base, strict=False):
            part = getattr(r[0], name)[: r[0].n[which]]
            parts.append(part + start if offset else part)
        return np.concatenate(parts) if parts else np.zeros((0, columns), dtype)

    _name_gaps(codes, errors, error)
    return MeshBatch(
        faces=faces,
        vertex_start=starts[:, 0].copy(),
        triangle_start=starts[:, 1].copy(),
        segment_start=starts[:, 2].copy(),
        positions=joined("position", 0, 3, np.float64),
        normals=joined("normal", 0, 3, np.float64),
        parameters=joined("uv", 0, 2, np.float64),
        triangles=joined("triangle", 1, 3, np.int64, offset=True),
        segments=joined("segment", 2, 2, np.int64, offset=True),
        surface_error=errors[:, 0].copy(),
        trim_error=errors[:, 1].copy(),
        pcurve_error=errors[:, 2] + geometry.surfaces["approximation_error"][faces],
        status=codes[:, 1].astype(np.uint8),
        reason=codes[:, 2].astype(np.uint16),
    )


def _gather(start: Ints, faces: Ints) -> tuple[Ints, Ints]:
    """Rows start[f]:start[f + 1] of all ``faces``, one after the other, and where each face's begin."""
    counts = start[faces + 1] - start[faces]
    begins = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return np.arange(begins[-1]) + np.repeat(start[faces] - begins[:-1], counts), begins


def select_faces(mesh: MeshBatch, faces: Ints) -> MeshBatch:
    """The mesh of some faces of a mesh.

    Args:
        mesh: its ``faces`` ascending.
        faces: (n,) of those rows, in the order wanted.
    """
    at = np.searchsorted(mesh.faces, faces)
    vertices, vertex_start = _gather(mesh.vertex_start, at)
    triangles, triangle_start = _gather(mesh.triangle_start, at)
    segments, segment_start = _gather(mesh.segment_start, at)
    shift = vertex_start[:-1] - mesh.vertex_start[at]
    return MeshBatch(
        faces=faces,
        vertex_start=vertex_start,
        triangle_start=triangle_start,
        segment_start=segment_start,
        positions=mesh.positions[vertices],
        normals=mesh.normals[vertices],
        parameters=mesh.parameters[vertices],
        triangles=mesh.triangles[triangles] + np.repeat(shift, np.diff(triangle_start))[:, None],
        segments=mesh.segments[segments] + np.repeat(shift, np.diff(segment_start))[:, None],
        surface_error=mesh.surface_error[at],
        trim_error=mesh.trim_error[at],
        pcurve_error=mesh.pcurve_error[at],
        status=mesh.status[at],
        reason=mesh.reason[at],
    )


def _with_neighbours(g: Tables, uses: EdgeUses, faces: Ints) -> Ints:
    """The faces and all that share an edge with one of them; unchanged if they are all of the part."""
    if len(faces) == len(g.surfaces):
        return faces
    inside = np.zeros(len(g.surfaces) + 1, bool)  # the last for coedges of no surface
    inside[faces] = True
    touched = np.zeros(len(g.edges), bool)
    touched[g.coedges["edge"][inside[uses.surface]]] = True
    inside[uses.surface[touched[g.coedges["edge"]]]] = True
    return np.flatnonzero(inside[:-1])


def _checked_error(geometry: GeometryBatch, chord_error: float) -> float:
    """The error, if it is one that float64 coordinates of this size can keep."""
    if not (chord_error > 0.0 and np.isfinite(chord_error)):
        raise UsageError(f"chord error {chord_error} mm: must be finite and above 0")
    size = float(np.abs(geometry.vertices).max()) if len(geometry.vertices) else 0.0
    if chord_error < size * SMALLEST_ERROR:
        raise UsageError(
            f"chord error {chord_error} mm: below {size * SMALLEST_ERROR:.3g} mm, "
            f"the resolution of float64 coordinates of {size:.6g} mm"
        )
    return float(chord_error)


def tessellate(
    geometry: GeometryBatch,
    chord_error: float,
    *,
    faces: npt.NDArray[np.int64] | None = None,
    normal_error_deg: float | None = None,
    workers: int = 1,
) -> MeshBatch:
    """Triangulate faces of a part so that each differs from its surface by at most ``chord_error``.

    Args:
        geometry: the part, whole: edges are sampled as all faces that use them need.
        chord_error: mm, > 0: bound of the distance in both directions. What the file's own gaps
            between p-curves, edges and surfaces add is reported in ``pcurve_error``, not refined.
        faces: (n,) distinct rows to return, default all. Their neighbours are done too, for they may
            ask for samples on a shared edge.
        normal_error_deg: bound of the angle between interpolated and true normal, not yet kept.
        workers: threads; the result does not depend on it.

    Returns:
        One mesh; neighbouring faces have bit-identical positions along shared edges.

    Raises:
        UsageError: the error is not positive or beyond float64.
    """
    error = _checked_error(geometry, chord_error)
    if normal_error_deg is not None and not 0.0 < normal_error_deg <= 90.0:
        raise UsageError(f"normal error {normal_error_deg} degrees: must be above 0 and at most 90")
    g = tables(geometry)
    run = chunk_runner(workers)
    pieces = bezier_pieces(g)
    uses = edge_uses(g)
    wished = np.arange(len(g.surfaces), dtype=np.int64) if faces is None else np.asarray(faces, np.int64)
    rows = _with_neighbours(g, uses, wished)
    boost = np.zeros(len(g.edges), np.int64)
    for turn in range(MAX_ROUNDS + 1):
        samples = sample_edges(g, pieces, uses, error, boost, run)
        wanted = np.zeros(len(g.edges), np.int64)
        results = _run_faces(g, pieces, samples, rows, error, turn == MAX_ROUNDS, wanted, run)
        if not wanted.any() or turn == MAX_ROUNDS:
            break
        boost += wanted > 0
    mesh = _join(geometry, rows, results, error)
    return mesh if np.array_equal(rows, wished) else select_faces(mesh, wished)
