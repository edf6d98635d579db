"""Orientation and in-circle tests on an integer lattice.

Coordinates are integers of less than 2**30 in difference, so twice the area of a triangle is exact in
64 bits: topology never depends on a tolerance. The in-circle test only chooses among valid
triangulations, so it may round; a margin keeps it from answering yes for both diagonals of a square.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper

Ints = npt.NDArray[np.int64]

LATTICE = 1 << 29  # size of the content; the enclosing box is at most twice as large
IN_CIRCLE_MARGIN = 1e-12


@helper
def orient(x: Ints, y: Ints, a: int, b: int, c: int) -> int:
    """Twice the signed area of the triangle of lattice points a, b, c; positive if counter-clockwise."""
    return (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])


@helper
def in_circle(x: Ints, y: Ints, sx: float, sy: float, a: int, b: int, c: int, d: int) -> bool:
    """Whether d lies clearly inside the circle through a, b, c (counter-clockwise), axes scaled by sx, sy."""
    ax, ay = (x[a] - x[d]) * sx, (y[a] - y[d]) * sy
    bx, by = (x[b] - x[d]) * sx, (y[b] - y[d]) * sy
    cx, cy = (x[c] - x[d]) * sx, (y[c] - y[d]) * sy
    la, lb, lc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    p, q, r = bx * cy - cx * by, ax * cy - cx * ay, ax * by - bx * ay
    return la * p - lb * q + lc * r > IN_CIRCLE_MARGIN * (la * abs(p) + lb * abs(q) + lc * abs(r))
