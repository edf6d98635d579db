"""A triangle's bound from its exact deviation at a few points and what may lie between them.

Cut the sides of a triangle in n. On each of the n^2 small triangles E = S - L differs from the linear interpolant of
its values at the corners by no more than the bound of the small triangle, for L is linear; and that is 1 / n^2 of the
large one's, for all of its terms are squares of lengths. So ::

    |E|  <=  max |E| at the points  +  bound / n^2

Where second derivatives are the same all over the triangle this is no better than the bound itself; where they point
different ways, or are large in one place only, it comes close to the truth, at the price of a few evaluations.

Roundoff: sums over basis functions, which are positive and of sum 1, are off by some hundred units of the largest
control point at most; and a rounded parameter moves a point by what the surface moves in so much.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.geometry.surface import surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]

BASIS = MAX_DEGREE + 2  # room for the basis functions of a point
# Of the largest coordinate: two points and what is between them, of degree 25 both ways, rational.
ROUNDOFF = 2.0**-42
# Of a parameter: a rounded sum of three.
PARAMETER = 2.0**-49


@leaf
def evaluation_error(g: Tables, row: int) -> float:
    """By how many mm the deviation at a point of B-spline surface ``row`` may come out wrong."""
    s = g.surfaces[row]
    dim = 4 if s.rational else 3
    largest = 0.0
    for i in range(s.n_u * s.n_v):
        at = s.points + i * dim
        w = g.values[at + 3] if dim == 4 else 1.0
        largest = max(largest, (abs(g.values[at]) + abs(g.values[at + 1]) + abs(g.values[at + 2])) / w)
    return largest * ROUNDOFF


@leaf
def _corner(g: Tables, row: int, u: float, v: float, scratch: Floats, out: Floats) -> None:
    """S at a corner to ``out`` (3,)."""
    point = local_line(9)
    surface_point(g, row, u, v, scratch, point)
    out[0], out[1], out[2] = point[0], point[1], point[2]


@leaf
def _off(g: Tables, row: int, u: float, v: float, x: float, y: float, z: float, scratch: Floats) -> float:
    """Distance of S(u, v) from (x, y, z), and what the roundoff of its parameters may hide."""
    point = local_line(9)
    surface_point(g, row, u, v, scratch, point)
    off = math.sqrt((point[0] - x) ** 2 + (point[1] - y) ** 2 + (point[2] - z) ** 2)
    along_u = abs(point[3]) + abs(point[4]) + abs(point[5])
    along_v = abs(point[6]) + abs(point[7]) + abs(point[8])
    return off + PARAMETER * (abs(u) * along_u + abs(v) * along_v)


@leaf
def largest_deviation(
    g: Tables, row: int, u0: float, v0: float, u1: float, v1: float, u2: float, v2: float, n: int, most: float
) -> float:
    """Largest |S - L| at the points of a triangle whose sides are cut in ``n``, mm, without ``evaluation_error``.

    Infinite if it is above ``most``: the search ends there. It begins at the side opposite to the first corner.
    """
    scratch = local_table(4, BASIS)
    a, b, c = local_line(3), local_line(3), local_line(3)
    _corner(g, row, u1, v1, scratch, b)
    _corner(g, row, u2, v2, scratch, c)
    a[0], a[1], a[2] = 0.0, 0.0, 0.0
    worst = 0.0
    for i in range(n):
        if i == 1:
            _corner(g, row, u0, v0, scratch, a)
        for j in range(n - i + 1):
            k = n - i - j
            if j < n and k < n:
                p, q, r = i / n, j / n, k / n
                x, y, z = p * a[0] + q * b[0] + r * c[0], p * a[1] + q * b[1] + r * c[1], p * a[2] + q * b[2] + r * c[2]
                off = _off(g, row, p * u0 + q * u1 + r * u2, p * v0 + q * v1 + r * v2, x, y, z, scratch)
                worst = max(worst, off)
                if worst > most:
                    return math.inf
    return worst
