"""Certified triangles of the faces of a part: the driver of the stages in this folder.

pieces -> edge samples -> faces -> (segments that need more samples -> the faces beside them again) -> mesh
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.bounds.curve_pieces import curve_pieces
from nurbs_ooc.bounds.strips import PiecesByError
from nurbs_ooc.geometry.soundness import sound_tables
from nurbs_ooc.geometry.tables import tables
from nurbs_ooc.tessellation.appearance import Appearance, kernel_aim
from nurbs_ooc.tessellation.assemble import Round, assemble
from nurbs_ooc.tessellation.beside_edges import BesideEdgesByError
from nurbs_ooc.tessellation.crease_samples import with_crease_samples
from nurbs_ooc.tessellation.edge_uses import EdgeUses, edge_uses, faces_of_edges, uses_of_faces, with_neighbours
from nurbs_ooc.tessellation.edges import sample_edges
from nurbs_ooc.tessellation.face import NEEDS_SAMPLES
from nurbs_ooc.tessellation.face_runs import run_faces
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.shading import Aim
from nurbs_ooc.tessellation.split_segments import most_samples, split_segments
from nurbs_ooc.tessellation.workers import CHUNKS, CURVES, EDGES, SURFACES, Threads

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Rounds of "more samples on these segments".
MAX_ROUNDS = 7
# Smallest error that is taken at its word, relative to the size of the coordinates: a few units of roundoff.
SMALLEST_ERROR = 2.0**-46


def _waiting(done: Round) -> Ints:
    """The faces of a round that asked for samples."""
    return done.rows[np.concatenate([c.codes[:, 0] == NEEDS_SAMPLES for c in done.chunks])]


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
        threads = self._threads = Threads(workers)
        self._g = sound_tables(tables(geometry), threads.runner(CURVES))
        self._pieces = PiecesByError(self._g, threads.runner(SURFACES))
        self._curves = curve_pieces(self._g, threads.runner(CURVES))
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
        combined = aim is not None and aim.appearance > 0.0
        turned = aim is not None and (aim.normal < math.inf or aim.shaded > 0.0)
        threads = self._threads if self._threads.workers == workers else Threads(workers)
        rounds = self._rounds(uses, rows, error, aim, threads)
        return assemble(rounds, wished, error, approximation, threads.runner(CHUNKS), turned, combined)

    def _rounds(self, uses: EdgeUses, rows: Ints, error: float, aim: Aim | None, threads: Threads) -> list[Round]:
        """The faces ``rows``, then again and again those that edges with more samples have changed."""
        g, run_edges = self._g, threads.runner(EDGES)
        # Strips between knots turn normals however thin they are: none is taken for a crease then.
        pieces = self._pieces.at(error if aim is None else 0.0)
        near = self._beside.at(pieces, self._pieces.changing, threads.runner(CURVES))
        samples = sample_edges(g, pieces, self._curves, near, uses, error, run_edges, aim is None)
        if aim is not None:
            samples = with_crease_samples(g, pieces, uses, samples, run_edges)
        most = most_samples(samples)
        rounds: list[Round] = []
        final = False
        while True:
            done, parts = run_faces(g, pieces, samples, rows, error, final, aim, threads)
            rounds.append(done)
            if final or not parts.any():
                break
            samples, changed = split_segments(g, uses, samples, parts, most, run_edges)
            # Once more: who asked, and who looks at an edge that has changed.
            again = faces_of_edges(g, uses, changed)
            again[_waiting(done)] = True
            rows = np.intersect1d(np.flatnonzero(again), rounds[0].rows)
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
