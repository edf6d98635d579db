"""Exact distance from points to sets of triangles, segments and points, by a forest of bounding-box trees.

A segment is the triangle (a, b, b) and a point (a, a, a); each *group* of primitives (the mesh of a
face, the tile of a node) has a tree of its own, so one call answers questions about many faces.

Distances err to the safe side where a triangle is a needle: its three edges are always measured, its
inside only where the triangle has one to speak of.

Source: C. Ericson, Real-Time Collision Detection, 2005, 5.1.2 (segment) and 4.2 (boxes).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel

LEAF = 4  # primitives a leaf: measuring four triangles costs about as much as two more boxes
STACK = 128  # twice the depth of a halving tree over 2**60 primitives


@helper
def _segment_distance2(p, a, b):  # type: ignore[no-untyped-def]
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


@helper
def _triangle_distance2(p, a, b, c):  # type: ignore[no-untyped-def]
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


@helper
def _box_distance2(p, box):  # type: ignore[no-untyped-def]
    d2 = 0.0
    for k in range(3):
        d = max(box[k] - p[k], 0.0, p[k] - box[3 + k])
        d2 += d * d
    return d2


@kernel
def _build(boxes, group_start, order, node_box, node_first, node_count, node_child, roots):  # type: ignore[no-untyped-def]
    """Split each group at the median centre along its longest side until a leaf holds ``LEAF`` or fewer."""
    n_nodes = 0
    centre = np.empty(len(order))
    for group in range(len(roots)):
        first, last = group_start[group], group_start[group + 1]
        roots[group] = -1
        if first == last:
            continue
        roots[group] = n_nodes
        node_first[n_nodes], node_count[n_nodes] = first, last - first
        pending = n_nodes
        n_nodes += 1
        while pending < n_nodes:
            start, count = node_first[pending], node_count[pending]
            box = node_box[pending]
            box[:3], box[3:] = np.inf, -np.inf
            for i in range(start, start + count):
                for k in range(3):
                    box[k] = min(box[k], boxes[order[i], k])
                    box[3 + k] = max(box[3 + k], boxes[order[i], 3 + k])
            node_child[pending] = -1
            if count > LEAF:
                axis = np.argmax(box[3:] - box[:3])
                for i in range(start, start + count):
                    centre[i] = boxes[order[i], axis] + boxes[order[i], 3 + axis]
                sort = np.argsort(centre[start : start + count])
                order[start : start + count] = order[start : start + count][sort]
                node_child[pending] = n_nodes
                half = count // 2
                node_first[n_nodes], node_count[n_nodes] = start, half
                node_first[n_nodes + 1], node_count[n_nodes + 1] = start + half, count - half
                n_nodes += 2
            pending += 1
    return n_nodes


@kernel
def _query(positions, primitives, order, node_box, node_first, node_count, node_child, roots, groups, p, d2, at):  # type: ignore[no-untyped-def]
    stack = np.empty(STACK, np.int64)
    below = np.empty(STACK)
    for i in range(len(p)):
        best, nearest = np.inf, -1
        top = 0
        if roots[groups[i]] >= 0:
            stack[0], below[0], top = roots[groups[i]], 0.0, 1
        while top > 0:
            top -= 1
            if below[top] >= best:
                continue
            node = stack[top]
            child = node_child[node]
            if child < 0:
                for j in range(node_first[node], node_first[node] + node_count[node]):
                    t = primitives[order[j]]
                    found = _triangle_distance2(p[i], positions[t[0]], positions[t[1]], positions[t[2]])
                    if found < best:
                        best, nearest = found, order[j]
                continue
            # Put the farther child below the nearer one.
            left, right = _box_distance2(p[i], node_box[child]), _box_distance2(p[i], node_box[child + 1])
            swap = right < left
            stack[top], below[top] = (child, left) if swap else (child + 1, right)
            stack[top + 1], below[top + 1] = (child + 1, right) if swap else (child, left)
            top += 2
        d2[i], at[i] = best, nearest


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
        self._positions = np.ascontiguousarray(positions, float)
        self._primitives = np.ascontiguousarray(primitives, np.int64).reshape(-1, 3)
        n = len(self._primitives)
        of = np.zeros(n, np.int64) if groups is None else np.asarray(groups, np.int64)
        corners = self._positions[self._primitives]
        boxes = np.concatenate([corners.min(1), corners.max(1)], 1) if n else np.empty((0, 6))
        self._order = np.arange(n)
        self._roots = np.empty(n_groups, np.int64)
        self._box = np.empty((2 * n, 6))
        self._first, self._count, self._child = (np.empty(2 * n, np.int64) for _ in range(3))
        start = np.searchsorted(of, np.arange(n_groups + 1))
        _build(boxes, start, self._order, self._box, self._first, self._count, self._child, self._roots)

    def query(
        self, points: npt.ArrayLike, groups: npt.ArrayLike = 0
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Distance (mm) of each of (m, 3) points to its group, and the nearest primitive; (inf, -1) if it is empty."""
        p = np.ascontiguousarray(points, float).reshape(-1, 3)
        of = np.ascontiguousarray(np.broadcast_to(np.asarray(groups, np.int64), len(p)))
        d2, at = np.empty(len(p)), np.empty(len(p), np.int64)
        tree = (self._order, self._box, self._first, self._count, self._child, self._roots)
        _query(self._positions, self._primitives, *tree, of, p, d2, at)
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
