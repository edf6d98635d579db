r"""Triangles that rounding to float32 left without an area, removed without opening the mesh.

Two equal corners: the triangle is dropped; its two other edges are one edge after welding, so its
neighbours now meet there. Three distinct corners on a line: dropping it would leave the long edge of one
neighbour facing two short edges. Its long edge is flipped instead, which covers the same points::

        d                     d
       / \                   /|\
      /   \        -->      / | \
    p ----- q             p - m - q
      `-m-'
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Ids = npt.NDArray[np.int64]

MAX_ROUNDS = 16  # a flip may leave its neighbour on the line in turn; chains are as long as such runs


def triangle_areas(points: npt.NDArray[np.float64], triangles: Ids) -> npt.NDArray[np.float64]:
    """(t,) areas of ``triangles`` in the square of the unit of ``points``."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def flip_collinear(points: npt.NDArray[np.float64], triangles: Ids) -> Ids:
    """Flip the long edge of every triangle of no area whose neighbour across it uses the same vertex rows.

    Args:
        points: (n, 3) positions, already rounded.
        triangles: (t, 3) rows; each has three distinct positions.

    Returns:
        (t, 3): the same triangles in the same order but for the flipped pairs. A triangle of no area whose
        long edge is a boundary of its face stays: without it the mesh would be open there.
    """
    flat = np.flatnonzero(triangle_areas(points, triangles) == 0.0)
    if len(flat) == 0:
        return triangles
    result = triangles.copy()
    for _ in range(MAX_ROUNDS):
        flipped = _flip_round(points, result, flat)
        if len(flipped) == 0:
            break
        touched = np.union1d(flat, flipped)
        flat = touched[triangle_areas(points, result[touched]) == 0.0]
    return result


def _flip_round(points: npt.NDArray[np.float64], triangles: Ids, flat: Ids) -> Ids:
    """Flip what can be flipped at once; returns the rows of all triangles that changed."""
    n = len(points)
    starts = triangles.ravel()
    keys = starts * n + np.roll(triangles, -1, axis=1).ravel()
    order = np.argsort(keys, kind="stable")
    changed: set[int] = set()
    for row in flat.tolist():
        p, q, m = _long_edge_first(points, triangles[row])
        at = int(np.searchsorted(keys, q * n + p, sorter=order))
        if row in changed or at == len(order) or keys[order[at]] != q * n + p:
            continue
        neighbour = int(order[at]) // 3
        if neighbour == row or neighbour in changed:
            continue
        d = int(triangles[neighbour, (int(order[at]) + 2) % 3])
        triangles[row] = m, p, d
        triangles[neighbour] = m, d, q
        changed |= {row, neighbour}
    return np.array(sorted(changed), dtype=np.int64)


def _long_edge_first(points: npt.NDArray[np.float64], triangle: Ids) -> tuple[int, int, int]:
    """The triangle turned so that its longest edge comes first."""
    corners = points[triangle]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    p, q, m = np.roll(triangle, -int(np.argmax(lengths))).tolist()
    return p, q, m
