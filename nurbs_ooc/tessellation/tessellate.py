"""Certified triangles of the faces of a part: the driver of the stages in this folder.

pieces -> edge samples -> faces -> (segments that need more samples -> the faces beside them again) -> mesh
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.bounds.curve_pieces import curve_pieces
from nurbs_ooc.bounds.derivatives import BOXES
from nurbs_ooc.bounds.pieces import Pieces, surface_pieces
from nurbs_ooc.geometry.soundness import sound_tables
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables
from nurbs_ooc.tessellation.appearance import Appearance, kernel_aim
from nurbs_ooc.tessellation.crease_samples import with_crease_samples
from nurbs_ooc.tessellation.deviation import Check
from nurbs_ooc.tessellation.edge_uses import edge_uses, faces_of_edges, with_neighbours
from nurbs_ooc.tessellation.edges import EdgeSamples, sample_edges, split_segments
from nurbs_ooc.tessellation.emit import Output, emit_face, emit_points, new_output
from nurbs_ooc.tessellation.face import BOX_AS_POINTS, DEGRADED, NEEDS_SAMPLES, tessellate_face
from nurbs_ooc.tessellation.fallback import box_diagonal
from nurbs_ooc.tessellation.mesh import NOT_ASKED, MeshBatch, join_meshes, take_faces
from nurbs_ooc.tessellation.shading import ANGLE, APPEARANCE, Aim
from nurbs_ooc.tessellation.triangulate import room_for
from nurbs_ooc.tessellation.workers import chunk_runner

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Rounds of "more samples on these segments".
MAX_ROUNDS = 7
NO_TRIANGLES = int(FaceReason.NO_TRIANGLES)
# Smallest error that is taken at its word, relative to the size of the coordinates: a few units of roundoff.
SMALLEST_ERROR = 2.0**-46


@kernel
def _faces(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, low: int, high: int, error: float, final: bool,
    wanted: Ints, aim: Aim | None,
) -> tuple[Output, Ints, Ints, Floats]:  # fmt: skip
    """Tessellate faces[low:high]: arrays, end offsets (n, 3), codes (n, 3: code, status, reason), errors (n, 5)."""
    o = new_output(256 * (high - low))
    ends = np.zeros((high - low, 3), dtype=np.int64)
    codes = np.zeros((high - low, 3), dtype=np.int64)
    errors = np.zeros((high - low, 5))
    found = np.zeros(2)
    apart = aim is not None
    check = Check(np.empty(3 + BOXES), np.empty(256, dtype=np.int64), np.zeros(1, dtype=np.int64))
    scratch = np.empty((4, MAX_DEGREE + 2))
    room = room_for(1024)
    for i in range(high - low):
        row = faces[low + i]
        s = g.surfaces[row]
        codes[i, 1], codes[i, 2] = s.status, s.reason
        if s.status != 3:
            found[ANGLE], found[APPEARANCE] = 0.0, 0.0
            d, room = tessellate_face(g, p, samples, row, error, final, check, wanted, room, aim, found)
            codes[i, 0] = d.code
            if d.status > codes[i, 1]:
                codes[i, 1], codes[i, 2] = d.status, d.reason
            if d.code != NEEDS_SAMPLES:
                b = d.boundary
                first, drawn = o.n[0], o.n[1]
                extra = d.extra
                if d.reason == BOX_AS_POINTS:
                    o = emit_points(b, o)
                else:
                    o = emit_face(g, p, row, b, d.triangulation, d.point, d.frame, scratch, apart, o)
                    if o.n[1] == drawn and codes[i, 1] < DEGRADED:
                        # Every triangle has two corners in one place: its points alone stand for it.
                        codes[i, 1], codes[i, 2] = DEGRADED, NO_TRIANGLES
                        extra += box_diagonal(o.position[first : o.n[0]])
                errors[i, 0], errors[i, 1], errors[i, 2] = d.worst, b.trim + extra, b.gap
                errors[i, 3], errors[i, 4] = found[ANGLE], found[APPEARANCE]
        for k in range(3):
            ends[i, k] = o.n[k]
    return o, ends, codes, errors


def _run_faces(
    g: Tables, pieces: Pieces, samples: EdgeSamples, faces: Ints, error: float, final: bool, wanted: Ints,
    aim: Aim | None, run: Callable[..., list[Any]],
) -> list[Any]:  # fmt: skip
    """All faces in chunks; ``wanted`` (n_samples,) becomes the largest of the threads' own."""

    def chunk(low: int, high: int) -> Any:
        own = np.zeros_like(wanted)
        return (*_faces(g, pieces, samples, faces, low, high, error, final, own, aim), own)

    results = run(chunk, len(faces))
    for result in results:
        np.maximum(wanted, result[4], out=wanted)
    return results


def _name_gaps(codes: Ints, errors: Floats, error: float) -> None:
    """Exact faces that a gap in the file keeps above the error asked for are healed, and say why.

    Without the gap they would have kept it: what surface and trim take is within the error.
    """
    over = (errors[:, :3].sum(axis=1) > error) & (errors[:, :2].sum(axis=1) <= error)
    kept_open = over & (codes[:, 1] == FaceStatus.EXACT)
    codes[kept_open, 1] = FaceStatus.HEALED
    codes[kept_open, 2] = FaceReason.FILE_GAP


def _join(geometry: GeometryBatch, faces: Ints, results: list[Any], error: float, aim: Aim | None) -> MeshBatch:
    """Concatenate the chunks' arrays into one mesh; faces that wait for samples have no vertices in it."""
    counts = [np.diff(r[1], axis=0, prepend=np.zeros((1, 3), np.int64)) for r in results]
    per_face = np.concatenate(counts) if counts else np.zeros((0, 3), np.int64)
    starts = np.concatenate([np.zeros((1, 3), np.int64), np.cumsum(per_face, axis=0)])
    base = np.concatenate([[0], np.cumsum([r[0].n[0] for r in results])]).astype(np.int64)
    codes = np.concatenate([r[2] for r in results]) if results else np.zeros((0, 3), np.int64)
    errors = np.concatenate([r[3] for r in results]) if results else np.zeros((0, 5))

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
        normal_error=np.degrees(errors[:, 3]) if aim is not None else NOT_ASKED,
        appearance_error=errors[:, 4].copy() if aim is not None and aim.appearance > 0.0 else NOT_ASKED,
    )


def _waiting(results: list[Any]) -> npt.NDArray[np.bool_]:
    """Mask of the faces of a round that asked for samples."""
    return np.concatenate([r[2][:, 0] == NEEDS_SAMPLES for r in results]) if results else np.zeros(0, bool)


def _latest(rounds: list[MeshBatch], faces: Ints) -> MeshBatch:
    """Each of ``faces`` as the last round that did it left it."""
    if len(rounds) == 1 and np.array_equal(rounds[0].faces, faces):
        return rounds[0]
    mesh = join_meshes(rounds)
    place = np.full(int(mesh.faces.max(initial=-1)) + 1, -1, np.int64)
    place[mesh.faces] = np.arange(len(mesh.faces))
    return take_faces(mesh, place[faces])


def _checked_error(geometry: GeometryBatch, chord_error: float) -> float:
    """The error, if it is one that float64 coordinates of this size can keep."""
    if not (chord_error > 0.0 and np.isfinite(chord_error)):
        raise UsageError(f"chord error {chord_error} mm: must be finite and above 0")
    finite = geometry.vertices[np.isfinite(geometry.vertices)]
    size = float(np.abs(finite).max()) if len(finite) else 0.0
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
    appearance: Appearance | None = None,
    workers: int = 1,
) -> MeshBatch:
    """Triangulate faces of a part so that each differs from its surface by at most ``chord_error``.

    Args:
        geometry: the part, whole: edges are sampled as all faces that use them need.
        chord_error: mm, > 0: bound of the distance in both directions. What the file's own gaps
            between p-curves, edges and surfaces add is reported in ``pcurve_error``, not refined.
        faces: (n,) distinct rows to return, default all. Their neighbours are done too, for they may
            ask for samples on a shared edge.
        normal_error_deg: degrees, in (0, 90]: bound of the angle between the normal interpolated from a
            triangle's corners and the surface's at the interpolated parameters.
        appearance: let shading count like distance, in one combined error.
        workers: threads; the result does not depend on it.

    Returns:
        One mesh; neighbouring faces have bit-identical positions along shared edges.

    Raises:
        UsageError: an error is not positive, beyond float64, or beyond a right angle.
    """
    error = _checked_error(geometry, chord_error)
    g = sound_tables(tables(geometry))
    aim = kernel_aim(geometry, g, normal_error_deg, appearance)
    run = chunk_runner(workers)
    # Strips between knots turn normals however thin they are: none is taken for a crease then.
    pieces = surface_pieces(g, error if aim is None else 0.0)
    uses = edge_uses(g)
    wished = np.arange(len(g.surfaces), dtype=np.int64) if faces is None else np.asarray(faces, np.int64)
    samples = sample_edges(g, pieces, curve_pieces(g), uses, error, run)
    if aim is not None:
        samples = with_crease_samples(g, pieces, uses, samples, run)
    rows = with_neighbours(g, uses, wished)
    rounds = []
    for turn in range(MAX_ROUNDS + 1):
        parts = np.zeros(len(samples.t), np.int64)
        results = _run_faces(g, pieces, samples, rows, error, turn == MAX_ROUNDS, parts, aim, run)
        rounds.append(_join(geometry, rows, results, error, aim))
        if not parts.any() or turn == MAX_ROUNDS:
            break
        samples, changed = split_segments(g, uses, samples, parts, run)
        # Once more: who asked, and who looks at an edge that has changed.
        again = faces_of_edges(g, uses, changed)
        again[rows[_waiting(results)]] = True
        rows = np.intersect1d(np.flatnonzero(again), rounds[0].faces)
    return _latest(rounds, wished)
