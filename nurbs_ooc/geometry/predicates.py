"""Orientation and in-circle tests on an integer lattice.

Coordinates are integers of less than 2**30 in difference, so twice the area of a triangle is exact in
64 bits: topology never depends on a tolerance. The in-circle test only chooses among valid
triangulations, so it may round; a margin keeps it from answering yes for both diagonals of a square.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

LATTICE = 1 << 29  # size of the content; the enclosing box is at most twice as large
IN_CIRCLE_MARGIN = 1e-12


@leaf
def orient(points: Ints, a: int, b: int, c: int) -> int:
    """Twice the signed area of the triangle of rows a, b, c of ``points``; positive if counter-clockwise."""
    x, y = points[a, 0], points[a, 1]
    return (points[b, 0] - x) * (points[c, 1] - y) - (points[b, 1] - y) * (points[c, 0] - x)


@leaf
def in_circle(points: Ints, scale: Floats, a: int, b: int, c: int, d: int) -> bool:
    """Whether d lies clearly inside the circle through a, b, c (counter-clockwise), axes scaled by ``scale`` (2,)."""
    x, y = points[d, 0], points[d, 1]
    sx, sy = scale[0], scale[1]
    ax, ay = (points[a, 0] - x) * sx, (points[a, 1] - y) * sy
    bx, by = (points[b, 0] - x) * sx, (points[b, 1] - y) * sy
    cx, cy = (points[c, 0] - x) * sx, (points[c, 1] - y) * sy
    la, lb, lc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    p, q, r = bx * cy - cx * by, ax * cy - cx * ay, ax * by - bx * ay
    return la * p - lb * q + lc * r > IN_CIRCLE_MARGIN * (la * abs(p) + lb * abs(q) + lc * abs(r))
