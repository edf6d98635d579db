"""Meshes by samples of all faces of a part: what ``sampled_face`` gives, as the tessellator would return it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.accuracy.face_meshes import collect_faces
from nurbs_ooc.accuracy.sampled_face import CROSSED, FULL, READY, sampled_face
from nurbs_ooc.geometry.surface import evaluate
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.tessellation.mesh import MeshBatch

FIRST_CAPACITY = 4096  # points of a face; four times as many until it fits
MOST_POINTS = 1 << 23

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def sampled_mesh(geometry: GeometryBatch, error: float) -> MeshBatch:
    """Every face refined until samples say that it is within ``error`` mm; nothing is promised.

    The ``surface_error`` of the result repeats the request, so that an attack on it counts how often an
    estimate is wrong.
    """
    if not (error > 0.0 and np.isfinite(error)):
        raise UsageError(f"error {error} mm: must be finite and above 0")
    return _mesh(geometry, error, 0)


def uniform_mesh(geometry: GeometryBatch, steps: int) -> MeshBatch:
    """Every face on a regular grid of ``steps`` x ``steps`` over its box in (u, v), trimmed by its loops."""
    if steps < 1:
        raise UsageError(f"{steps} steps: must be at least 1")
    return _mesh(geometry, 0.0, steps)


def _face(g: Tables, row: int, error: float, grid: int) -> tuple[int, Floats, Ints]:
    capacity = FIRST_CAPACITY
    while True:
        code, uv, triangles = sampled_face(g, row, error, grid, capacity)
        if code != FULL or capacity >= MOST_POINTS:
            return code, uv, triangles
        capacity *= 4


def _mesh(geometry: GeometryBatch, error: float, grid: int) -> MeshBatch:
    g = tables(geometry)
    faces = []
    status, reason = geometry.surfaces["status"].copy(), geometry.surfaces["reason"].copy()
    for row in range(len(geometry)):
        code, uv, t = READY, np.empty((0, 2)), np.empty((0, 3), np.int64)
        if status[row] != FaceStatus.FAILED:
            code, uv, t = _face(g, row, error, grid)
        p, normal = evaluate(geometry, row, uv)
        a, b, c = (p[t[:, k]] for k in range(3))
        t = t[(a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)]
        if geometry.surfaces["reversed"][row]:
            t = t[:, ::-1]
        if status[row] < FaceStatus.DEGRADED and (code == CROSSED or not len(t)):
            status[row] = FaceStatus.DEGRADED
            reason[row] = FaceReason.LOOPS_CROSS if len(t) else FaceReason.NO_TRIANGLES
        faces.append((p, normal, uv, t))
    return collect_faces(faces, error, status, reason)
