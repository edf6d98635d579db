"""Bounding boxes and average normals of surfaces, from a coarse tessellation with a certified error.

The control net's box overestimates trimmed surfaces and high degrees. So each surface is tessellated
at a coarse error, and the box of the mesh is extended by the error that the mesh promises. If the
diagonal turns out shorter than 100 errors, the surface is done again at 1 % of the diagonal::

    error of the ladder nearest to 1 % of the rough extent --> mesh --> box + certified error
              ^                                                              |
              `------- 1 % of the diagonal, while diagonal < 100 errors -----'

The box of a *placed* surface is that of its transformed mesh, not of the transformed box.

Source: M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_cache.node_record import ITEM_DTYPE
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.hierarchy.extents import rough_extents
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hierarchy.runs import run_rows
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import Tessellator, smallest_error

RELATIVE_ERROR = 0.01  # of the diagonal: the paper's figure
FINEST_LEVEL = -30  # 2**-30 mm, for surfaces whose extent is 0
COARSEST_LEVEL = 40
MAX_ROUNDS = 4  # the rough extent is off by more than 100**3 only for surfaces that are points


@dataclass(frozen=True, eq=False)
class PartSketch:
    """Coarse meshes of surfaces of a part, as far as boxes need them.

    Attributes:
        point_start: (n + 1,) int64; surface ``i`` has the points ``point_start[i]:point_start[i + 1]``,
            none if nothing of it could be tessellated.
        points: (m, 3) float64, mm, part space.
        error: (n,) float64, mm: how far the surface may be from its points' convex hull.
        normal: (n, 3) float64: area-weighted mean normal, unit.
        status, reason: (n,) as in ``MeshBatch``.
    """

    point_start: npt.NDArray[np.int64]
    points: npt.NDArray[np.float64]
    error: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    status: npt.NDArray[np.uint8]
    reason: npt.NDArray[np.uint16]

    def of_rows(self, low: int, high: int) -> PartSketch:
        """The surfaces ``low`` to ``high``."""
        start = self.point_start[low : high + 1]
        own = slice(low, high)
        return PartSketch(
            start - start[0], self.points[start[0] : start[-1]], self.error[own], self.normal[own], self.status[own],
            self.reason[own],
        )  # fmt: skip

    @property
    def drawable(self) -> npt.NDArray[np.bool_]:
        """(n,) whether there is anything of the surface at all."""
        return np.diff(self.point_start) > 0


@kernel
def _face_boxes(
    start: npt.NDArray[np.int64],
    points: npt.NDArray[np.float64],
    error: npt.NDArray[np.float64],
    transforms: npt.NDArray[np.float64],
    stretch: npt.NDArray[np.float64],
    boxes: npt.NDArray[np.float64],
) -> None:
    """Boxes (m, n, 6) of the points under each of m transforms, extended by the transformed error."""
    for placed in range(len(transforms)):
        transform = transforms[placed]
        for face in range(len(start) - 1):
            box = boxes[placed, face]
            for axis in range(3):
                low, high = np.inf, -np.inf
                for i in range(start[face], start[face + 1]):
                    x = transform[axis, 3]
                    for k in range(3):
                        x += transform[axis, k] * points[i, k]
                    low, high = min(low, x), max(high, x)
                box[axis] = low - stretch[placed] * error[face]
                box[3 + axis] = high + stretch[placed] * error[face]


@kernel
def _average_normals(
    vertex_start: npt.NDArray[np.int64],
    triangle_start: npt.NDArray[np.int64],
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    triangles: npt.NDArray[np.int64],
    out: npt.NDArray[np.float64],
) -> None:
    """Mean of the triangles' normals weighted by area; the first vertex normal where they cancel out."""
    sums = np.empty(3)
    for face in range(len(out)):
        sums[0], sums[1], sums[2] = 0.0, 0.0, 0.0
        total = 0.0
        for t in range(triangle_start[face], triangle_start[face + 1]):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            size = 0.0
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                cross = (positions[b, i] - positions[a, i]) * (positions[c, j] - positions[a, j]) - (
                    positions[b, j] - positions[a, j]
                ) * (positions[c, i] - positions[a, i])
                sums[k] += cross
                size += cross * cross
            total += np.sqrt(size)
        length = np.sqrt(sums[0] * sums[0] + sums[1] * sums[1] + sums[2] * sums[2])
        for k in range(3):
            if length > 1e-6 * total:
                out[face, k] = sums[k] / length
            elif vertex_start[face] < vertex_start[face + 1]:
                out[face, k] = normals[vertex_start[face], k]
            else:
                out[face, k] = 1.0 if k == 2 else 0.0


def _levels_for(diagonal: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Ladder level at or below ``RELATIVE_ERROR`` of each diagonal."""
    exponent = np.frexp(RELATIVE_ERROR * diagonal)[1].astype(np.int64) - 1
    return np.clip(np.where(diagonal > 0, exponent, FINEST_LEVEL), FINEST_LEVEL, COARSEST_LEVEL)


def _diagonals(mesh: MeshBatch) -> npt.NDArray[np.float64]:
    """(n,) diagonal of the extended boxes, 0 for faces without vertices."""
    placed = np.empty((1, len(mesh.faces), 6))
    _face_boxes(mesh.vertex_start, mesh.positions, mesh.certified_error, np.eye(3, 4)[None], np.ones(1), placed)
    boxes = placed[0]
    filled = boxes[:, 0] <= boxes[:, 3]
    return np.where(filled, np.linalg.norm(np.where(filled[:, None], boxes[:, 3:] - boxes[:, :3], 0.0), axis=1), 0.0)


def _coarse_meshes(geometry: GeometryBatch, workers: int) -> list[MeshBatch]:
    """Meshes of all surfaces, each at an error of at most 1 % of its diagonal; a later mesh of a surface counts."""
    meshes: list[MeshBatch] = []
    tessellator, smallest = Tessellator(geometry, workers), smallest_error(geometry)
    rows, level = np.arange(len(geometry)), _levels_for(rough_extents(geometry))
    for _ in range(MAX_ROUNDS):
        too_coarse = [rows[:0]]
        for value in np.unique(level[rows]).tolist():
            # Alone, without the neighbours, who may be far larger: boxes need no common edges.
            faces = rows[level[rows] == value]
            mesh = tessellator.mesh(max(2.0**value, smallest), faces=faces, present=faces, workers=workers)
            meshes.append(mesh)
            diagonal = _diagonals(mesh)
            finer = np.minimum(_levels_for(diagonal), value)
            level[faces] = finer
            too_coarse.append(faces[(finer < value) & (diagonal > 0)])
        rows = np.sort(np.concatenate(too_coarse))
    return meshes


def sketch_part(geometry: GeometryBatch, workers: int = 1) -> PartSketch:
    """Tessellate a part, or several in one batch, as coarsely as boxes allow.

    Args:
        geometry: the part, mm.
        workers: threads for the tessellation; the result does not depend on it.
    """
    n = len(geometry)
    start, count, error = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n)
    normal, status, reason = np.zeros((n, 3)), np.zeros(n, np.uint8), np.zeros(n, np.uint16)
    points, n_points = [np.zeros((0, 3))], 0
    for mesh in _coarse_meshes(geometry, workers):
        faces, normals = mesh.faces, np.empty((len(mesh.faces), 3))
        _average_normals(mesh.vertex_start, mesh.triangle_start, mesh.positions, mesh.normals, mesh.triangles, normals)
        start[faces], count[faces] = n_points + mesh.vertex_start[:-1], np.diff(mesh.vertex_start)
        error[faces], normal[faces] = mesh.certified_error, normals
        status[faces], reason[faces] = mesh.status, mesh.reason
        points.append(mesh.positions)
        n_points += len(mesh.positions)
    point_start = np.concatenate([[0], np.cumsum(count)])
    return PartSketch(point_start, np.concatenate(points)[run_rows(start, count)], error, normal, status, reason)


def placed_items(
    sketch: PartSketch,
    first_surface: int,
    occurrences: npt.NDArray[np.integer],
    transforms: npt.NDArray[np.float64],
) -> npt.NDArray[np.void]:
    """The drawable surfaces of a part as often as it is placed.

    Args:
        sketch: the part.
        first_surface: id of its first surface.
        occurrences: (m,) rows in the occurrences.
        transforms: (m, 3, 4) part to assembly, mm; may mirror and scale.

    Returns:
        ``ITEM_DTYPE`` rows by occurrence, then surface; ``node`` still -1.
    """
    placements = Placements.of_transforms(transforms)
    rows, m = np.flatnonzero(sketch.drawable), len(occurrences)
    boxes = np.empty((m, len(sketch.error), 6))
    _face_boxes(sketch.point_start, sketch.points, sketch.error, placements.points, placements.stretch, boxes)
    normals = sketch.normal[rows] @ np.swapaxes(placements.normals, 1, 2)
    items = np.zeros((m, len(rows)), ITEM_DTYPE)
    items["surface"], items["occurrence"], items["node"] = first_surface + rows, np.asarray(occurrences)[:, None], -1
    items["aabb_min"], items["aabb_max"] = boxes[:, rows, :3], boxes[:, rows, 3:]
    items["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    items["scale"] = placements.stretch[:, None]
    return items.reshape(-1)
