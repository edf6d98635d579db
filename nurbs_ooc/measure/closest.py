"""Exact distance from points to sets of triangles, segments and points, by a forest of bounding-box trees.

A segment is the triangle (a, b, b) and a point (a, a, a); each *group* of primitives (the mesh of a
face, the tile of a node) has a tree of its own, so one call answers questions about many faces.

Distances err to the safe side where a triangle is a needle: its three edges are always measured, its
inside only where the triangle has one to speak of.

Source: C. Ericson, Real-Time Collision Detection, 2005, 5.1.2 (segment).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.measure.box_forest import STACK, box_distance2, box_forest


@leaf
def _segment_distance2(p, a, b) -> float:  # type: ignore[no-untyped-def]
    ab2, dot = 0.0, 0.0
    for k in range(3):
        ab2 += (b[k] - a[k]) * (b[k] - a[k])
        dot += (p[k] - a[k]) * (b[k] - a[k])
    t = 0.0
    if ab2 > 0.0:
        t = min(1.0, max(0.0, dot / ab2))
    d2 = 0.0
    for k in range(3):
        d = p[k] - (a[k] + t * (b[k] - a[k]))
        d2 += d * d
    return d2


@leaf
def triangle_distance2(p, a, b, c) -> float:  # type: ignore[no-untyped-def]
    """Squared distance of p to the triangle; degenerate ones are their edges."""
    best = _segment_distance2(p, a, b)
    if b[0] == c[0] and b[1] == c[1] and b[2] == c[2]:
        return best
    best = min(best, _segment_distance2(p, b, c), _segment_distance2(p, c, a))
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    n2 = nx * nx + ny * ny + nz * nz
    if n2 <= 1e-24 * (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz):
        return best
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    height = wx * nx + wy * ny + wz * nz
    # Barycentric coordinates of the foot, times n2.
    beta = (wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz
    gamma = (uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz
    if beta >= 0.0 and gamma >= 0.0 and beta + gamma <= n2:
        best = min(best, height * height / n2)
    return best


@leaf
def nearest_primitive(forest, positions, primitives, group, p) -> tuple[float, int]:  # type: ignore[no-untyped-def]
    """Squared distance of ``p`` to the nearest primitive of a group, and its row; (inf, -1) if there is none."""
    order, box, first, length, child, roots = forest
    stack, below = local_line(STACK), local_line(STACK)  # node numbers are exact in float64
    best, nearest, top = np.inf, -1, 0
    if roots[group] >= 0:
        stack[0], below[0], top = roots[group], 0.0, 1
    while top > 0:
        top -= 1
        if below[top] >= best:
            continue
        node = int(stack[top])
        if child[node] < 0:
            for j in range(first[node], first[node] + length[node]):
                t = primitives[order[j]]
                found = triangle_distance2(p, positions[t[0]], positions[t[1]], positions[t[2]])
                if found < best:
                    best, nearest = found, order[j]
            continue
        # Put the farther child below the nearer one.
        near, far = child[node], child[node] + 1
        d_near, d_far = box_distance2(p, box[near]), box_distance2(p, box[far])
        if d_far < d_near:
            near, far, d_near, d_far = far, near, d_far, d_near
        stack[top], below[top] = far, d_far
        stack[top + 1], below[top + 1] = near, d_near
        top += 2
    return best, nearest


@kernel
def _query(forest, positions, primitives, groups, p, d2, at):  # type: ignore[no-untyped-def]
    for i in range(len(p)):
        d2[i], at[i] = nearest_primitive(forest, positions, primitives, groups[i], p[i])


class ClosestPrimitive:
    """Distances to groups of triangles, segments and points.

    Args:
        positions: (n_vertices, 3) float64, mm.
        primitives: (n, 3) rows of ``positions``; (a, b, b) is a segment and (a, a, a) a point.
        groups: (n,) group of each primitive, ascending; left out: all are group 0.
        n_groups: number of groups; needed when the last ones may be empty.
    """

    def __init__(
        self,
        positions: npt.NDArray[np.float64],
        primitives: npt.NDArray[np.int64],
        groups: npt.NDArray[np.int64] | None = None,
        n_groups: int = 1,
    ) -> None:
        self.positions = np.ascontiguousarray(positions, float)
        self.primitives = np.ascontiguousarray(primitives, np.int64).reshape(-1, 3)
        corners = self.positions[self.primitives]
        boxes = np.concatenate([corners.min(1), corners.max(1)], 1) if len(corners) else np.empty((0, 6))
        self.forest = box_forest(boxes, groups, n_groups)

    def query(
        self, points: npt.ArrayLike, groups: npt.ArrayLike = 0
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Distance (mm) of each of (m, 3) points to its group, and the nearest primitive; (inf, -1) if it is empty."""
        p = np.ascontiguousarray(points, float).reshape(-1, 3)
        of = np.ascontiguousarray(np.broadcast_to(np.asarray(groups, np.int64), len(p)))
        d2, at = np.empty(len(p)), np.empty(len(p), np.int64)
        _query(self.forest, self.positions, self.primitives, of, p, d2, at)
        return np.sqrt(d2), at


def as_primitives(
    triangles: npt.NDArray[np.integer],
    lines: npt.NDArray[np.integer] | None = None,
    points: npt.NDArray[np.integer] | None = None,
) -> npt.NDArray[np.int64]:
    """(n, 3) rows for ``ClosestPrimitive`` of (t, 3) triangles, (l, 2) lines and (p,) points, in this order."""
    rows = [np.asarray(triangles, np.int64).reshape(-1, 3)]
    if lines is not None:
        rows.append(np.asarray(lines, np.int64).reshape(-1, 2)[:, [0, 1, 1]])
    if points is not None:
        rows.append(np.repeat(np.asarray(points, np.int64).reshape(-1, 1), 3, axis=1))
    return np.concatenate(rows)
