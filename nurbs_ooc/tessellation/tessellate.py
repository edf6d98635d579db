"""Certified triangles of the faces of a part: the driver of the stages in this folder.

pieces -> edge samples -> faces -> (segments that need more samples -> the faces beside them again) -> mesh
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.jit import helper, kernel
from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.bounds.curve_pieces import curve_pieces
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.bounds.strips import PiecesByError
from nurbs_ooc.geometry.soundness import sound_tables
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.tessellation.appearance import Appearance, kernel_aim
from nurbs_ooc.tessellation.assemble import Chunk, assemble
from nurbs_ooc.tessellation.beside_edges import BesideEdgesByError
from nurbs_ooc.tessellation.crease_samples import with_crease_samples
from nurbs_ooc.tessellation.edge_uses import EdgeUses, edge_uses, faces_of_edges, uses_of_faces, with_neighbours
from nurbs_ooc.tessellation.edges import EdgeSamples, sample_edges, split_segments
from nurbs_ooc.tessellation.emit import Output, emit_face, emit_points, new_output, with_room
from nurbs_ooc.tessellation.face import (
    BOX_AS_POINTS,
    DEGRADED,
    EXTRA,
    GAP,
    NEEDS_SAMPLES,
    NO_ROOM,
    READY,
    REASON,
    STATUS,
    TRIM,
    WORST,
    Draft,
    tessellate_face,
)
from nurbs_ooc.tessellation.fallback import box_diagonal
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.shading import ANGLE, APPEARANCE, Aim
from nurbs_ooc.tessellation.workers import chunk_runner
from nurbs_ooc.tessellation.workspace import Workspace, larger, new_workspace

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Edges per call of a kernel: they take a tenth of the time of faces.
EDGE_CHUNK = 256
# Rounds of "more samples on these segments".
MAX_ROUNDS = 7
# Beside the results of ``tessellate_face``: the arrays that faces are appended to are full.
NO_OUTPUT = 3
# Vertices of a face that there is room for at first.
FIRST_VERTICES = 256
NO_TRIANGLES = int(FaceReason.NO_TRIANGLES)
# Smallest error that is taken at its word, relative to the size of the coordinates: a few units of roundoff.
SMALLEST_ERROR = 2.0**-46


@helper
def _finish_face(
    g: Tables, p: Pieces, row: int, w: Workspace, d: Draft, o: Output, codes: Ints, errors: Floats, apart: bool
) -> bool:
    """Append the face in the workspace to ``o``, with its codes (3,) and errors (5,); False if there is no room."""
    first, drawn = o.n[0], o.n[1]
    points = d.code[REASON] == BOX_AS_POINTS
    if not (emit_points(w, o) if points else emit_face(g, p, row, w, apart, o)):
        return False
    errors[0], errors[1], errors[2] = d.error[WORST], d.error[TRIM] + d.error[EXTRA], d.error[GAP]
    errors[3], errors[4] = d.found[ANGLE], d.found[APPEARANCE]
    if not points and o.n[1] == drawn and codes[1] < DEGRADED:
        # Every triangle has two corners in one place: its points alone stand for it.
        codes[1], codes[2] = DEGRADED, NO_TRIANGLES
        errors[1] += box_diagonal(o.position[first : o.n[0]])
    return True


@helper
def _face_after_face(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, start: int, error: float, final: bool, wanted: Ints,
    w: Workspace, d: Draft, o: Output, ends: Ints, codes: Ints, errors: Floats, drafted: bool, aim: Aim | None,
) -> tuple[int, int]:  # fmt: skip
    """Tessellate faces[start:] until something is too small: how far it came, and NO_ROOM in ``w`` or NO_OUTPUT.

    With ``drafted`` the first of them is in the workspace already.
    """
    for i in range(start, len(faces)):
        row = faces[i]
        s = g.surfaces[row]
        if s.status == 3:
            codes[i, 1], codes[i, 2] = s.status, s.reason
        else:
            code = READY
            if not (drafted and i == start):
                d.code[STATUS], d.code[REASON] = 0, 0
                d.found[ANGLE], d.found[APPEARANCE] = 0.0, 0.0
                code = tessellate_face(g, p, samples, row, error, final, w, wanted, d, aim)
                if code == NO_ROOM:
                    return i, NO_ROOM
                codes[i, 0], codes[i, 1], codes[i, 2] = code, s.status, s.reason
                if d.code[STATUS] > codes[i, 1]:
                    codes[i, 1], codes[i, 2] = d.code[STATUS], d.code[REASON]
            if code == READY and not _finish_face(g, p, row, w, d, o, codes[i], errors[i], aim is not None):
                return i, NO_OUTPUT
        for k in range(3):
            ends[i, k] = o.n[k]
    return len(faces), READY


@kernel
def _faces(
    g: Tables, p: Pieces, samples: EdgeSamples, faces: Ints, error: float, final: bool, wanted: Ints, aim: Aim | None
) -> tuple[Output, Ints, Ints, Floats]:
    """Tessellate some faces: arrays, end offsets (n, 3), codes (n, 3: code, status, reason), errors (n, 5)."""
    n = len(faces)
    o = new_output(FIRST_VERTICES * n)
    ends = np.zeros((n, 3), dtype=np.int64)
    codes = np.zeros((n, 3), dtype=np.int64)
    errors = np.zeros((n, 5))
    w = new_workspace(g)
    d = Draft(np.zeros(4), np.zeros(2, dtype=np.int64), np.zeros(2))
    done = 0
    drafted = False
    while done < n:
        done, lack = _face_after_face(
            g, p, samples, faces, done, error, final, wanted, w, d, o, ends, codes, errors, drafted, aim
        )
        drafted = lack == NO_OUTPUT
        if lack == NO_ROOM:
            w = larger(w)
        elif lack == NO_OUTPUT:
            o = with_room(o)
    return o, ends, codes, errors


def _run_faces(
    g: Tables, pieces: Pieces, samples: EdgeSamples, faces: Ints, error: float, final: bool, wanted: Ints,
    aim: Aim | None, run: Callable[..., list[Any]],
) -> list[Chunk]:  # fmt: skip
    """All faces in chunks; ``wanted`` (n_samples,) becomes the largest of the threads' own."""

    def chunk(low: int, high: int) -> Any:
        own = np.zeros_like(wanted)
        return _faces(g, pieces, samples, faces[low:high], error, final, own, aim), own

    results = run(chunk, len(faces))
    for _, own in results:
        np.maximum(wanted, own, out=wanted)
    return [Chunk(*result) for result, _ in results]


def _waiting(chunks: list[Chunk]) -> npt.NDArray[np.bool_]:
    """Mask of the faces of a round that asked for samples."""
    return np.concatenate([c.codes[:, 0] == NEEDS_SAMPLES for c in chunks]) if chunks else np.zeros(0, bool)


def _mask(rows: Ints, n: int) -> npt.NDArray[np.bool_]:
    mask = np.zeros(n, np.bool_)
    mask[rows] = True
    return mask


def smallest_error(geometry: GeometryBatch) -> float:
    """The smallest chord error, mm, that float64 coordinates of this size can keep."""
    finite = geometry.vertices[np.isfinite(geometry.vertices)]
    return SMALLEST_ERROR * (float(np.abs(finite).max()) if len(finite) else 0.0)


class Tessellator:
    """Meshes of one part, or of several in one batch, at one error after another.

    What does not depend on the error is found once: that is half of the time of a coarse mesh.

    Args:
        geometry: the part, whole: edges are sampled as all faces that use them need.
        workers: threads that prepare it.
    """

    def __init__(self, geometry: GeometryBatch, workers: int = 1) -> None:
        self._geometry = geometry
        self._g = sound_tables(tables(geometry))
        self._pieces = PiecesByError(self._g, chunk_runner(workers))
        self._curves = curve_pieces(self._g)
        self._uses = edge_uses(self._g)
        self._beside = BesideEdgesByError(self._g, self._curves, self._uses.surface)

    def mesh(
        self,
        chord_error: float,
        *,
        faces: npt.NDArray[np.int64] | None = None,
        present: npt.NDArray[np.int64] | None = None,
        normal_error_deg: float | None = None,
        appearance: Appearance | None = None,
        workers: int = 1,
    ) -> MeshBatch:
        """Triangulate faces so that each differs from its surface by at most ``chord_error``.

        Args:
            chord_error: mm, finite and > 0; below ``smallest_error`` more triangles do not help.
            faces: (n,) distinct rows to return, default all that are present.
            present: (m,) the rows that the part counts as consisting of, ``faces`` among them, default
                all. The others have no say in how edges are sampled.
            normal_error_deg, appearance: see ``tessellate``.
            workers: threads; the result does not depend on it.

        Returns:
            As ``tessellate``.

        Raises:
            UsageError: the normal error is not above 0 and at most a right angle.
        """
        aim = kernel_aim(self._geometry, self._g, normal_error_deg, appearance)
        n = len(self._geometry)
        uses = self._uses if present is None else uses_of_faces(self._uses, _mask(present, n))
        wished = np.arange(n, dtype=np.int64) if present is None else np.asarray(present, np.int64)
        if faces is not None:
            wished = np.asarray(faces, np.int64)
        rows = with_neighbours(self._g, uses, wished)
        if present is not None:
            # What is further off does not reach them: edges that none of these uses are not sampled.
            near = with_neighbours(self._g, uses, rows)
            uses = uses_of_faces(uses, _mask(near, n))
        error = float(chord_error)
        approximation = self._geometry.surfaces["approximation_error"][wished]
        rounds = self._rounds(uses, rows, error, aim, workers)
        combined = aim is not None and aim.appearance > 0.0
        return assemble(rounds, wished, error, approximation, aim is not None, combined)

    def _rounds(
        self, uses: EdgeUses, rows: Ints, error: float, aim: Aim | None, workers: int
    ) -> list[tuple[Ints, list[Chunk]]]:
        """The faces ``rows``, then again and again those that edges with more samples have changed."""
        g, run, run_edges = self._g, chunk_runner(workers), chunk_runner(workers, EDGE_CHUNK)
        # Strips between knots turn normals however thin they are: none is taken for a crease then.
        pieces = self._pieces.at(error if aim is None else 0.0)
        near = self._beside.at(pieces, self._pieces.changing)
        samples = sample_edges(g, pieces, self._curves, near, uses, error, run_edges, aim is None)
        if aim is not None:
            samples = with_crease_samples(g, pieces, uses, samples, run_edges)
        rounds: list[tuple[Ints, list[Chunk]]] = []
        final = False
        while True:
            parts = np.zeros(len(samples.t), np.int64)
            chunks = _run_faces(g, pieces, samples, rows, error, final, parts, aim, run)
            rounds.append((rows, chunks))
            if final or not parts.any():
                break
            samples, changed = split_segments(g, uses, samples, parts, run_edges)
            # Once more: who asked, and who looks at an edge that has changed.
            again = faces_of_edges(g, uses, changed)
            again[rows[_waiting(chunks)]] = True
            rows = np.intersect1d(np.flatnonzero(again), rounds[0][0])
            final = len(rounds) == MAX_ROUNDS or not changed.any()
        return rounds


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

    For one part at several errors see ``Tessellator``.

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
    if not (chord_error > 0.0 and np.isfinite(chord_error)):
        raise UsageError(f"chord error {chord_error} mm: must be finite and above 0")
    smallest = smallest_error(geometry)
    if chord_error < smallest:
        raise UsageError(
            f"chord error {chord_error} mm: below {smallest:.3g} mm, "
            f"the resolution of float64 coordinates of {smallest / SMALLEST_ERROR:.6g} mm"
        )
    tessellator = Tessellator(geometry, workers)
    return tessellator.mesh(
        chord_error, faces=faces, normal_error_deg=normal_error_deg, appearance=appearance, workers=workers
    )
