"""Shading errors carried into space: how far one must go for an attribute of a surface to change by as much.

Let h be an attribute (normals are one), l its linear interpolant over a triangle from the values h_i at the corners
q_i, with barycentric weights l_i, and c the largest rate at which h changes on the triangle's part of the surface,
|h(x) - h(y)| / |S(x) - S(y)| over all its pairs of points. The shading error is ::

    eps_s = max |h - l| / c                     0 where nobody sees |h - l|

A bound of it takes |h - l| from above and c from below: from the triangle's edges, and from the derivatives of h
near its corners. Near an extremum of h both may vanish although c does not. But h - l = sum l_i (h - h_i), so with p_i
the corners' places, L their interpolant, E a bound of |S - L| at equal parameters and Cauchy's inequality ::

    |h - l| / c <= sum l_i |S - p_i| <= E + sum l_i |L - p_i|
                <= E + sqrt(sum l_i |L - p_i|^2) = E + sqrt(sum_{i<j} l_i l_j |p_i - p_j|^2) <= E + r

r is the radius of the smallest circle around the triangle. So no shading error exceeds the triangle's own size, and
refinement comes to an end at extrema of h too: where h = k x^2 and the triangle is d wide, max |h - l| / c is d / 4 at
most. Of normals the interpolant x is made a unit vector m: |n - m| <= |n - x| + |1 - |x|| <= 2 |n - x|, twice as much.

If h is a number, every l of the triangle is also a value that h has on it, for h is continuous and l lies between
the values at the corners: the right colour is no farther away than the triangle is large.

Source: A. Balázs, M. Guthe, R. Klein, "Appearance preserving tessellation" of trimmed NURBS (the shading error, with
the largest rate); the bound by the triangle's size is proved above.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import LV
from nurbs_ooc.bounds.triangle_bound import largest_mean
from nurbs_ooc.geometry.surface import CONE, REVOLUTION, SPHERE, TORUS, surface_point
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Normals at poles are taken up to 1e-7 of the way beside them, see ``corner_normals``.
BESIDE = 1.0 + 1e-6
# Derivatives are taken this share of the way from the corners to the middle: at corners there may be several.
INSIDE = 1.0 / 16.0


@leaf
def _apart(x: Floats, i: int, j: int) -> float:
    """Square of the distance of two rows of ``x`` (3, 3)."""
    size = 0.0
    for k in range(3):
        size += (x[i, k] - x[j, k]) ** 2
    return size


@leaf
def edge_rate(foot: Floats, what: Floats) -> float:
    """Largest change of ``what`` (3, 3) over change of place ``foot`` (3, 3) along an edge of a triangle."""
    best = 0.0
    for i in range(3):
        j = (i + 1) % 3
        way = _apart(foot, i, j)
        if way > 0.0:
            best = max(best, _apart(what, i, j) / way)
    return math.sqrt(best)


@leaf
def _quotient(value: Floats, place: Floats, at: int) -> float:
    """|h_u| / |S_u|, or of v; 0 where the surface does not move."""
    change, way = 0.0, 0.0
    for k in range(at, at + 3):
        change += value[k] * value[k]
        way += place[k] * place[k]
    return math.sqrt(change / way) if way > 0.0 else 0.0


@leaf
def inner_rate(g: Tables, attribute: Tables, row: int, uv: Floats, scratch: Floats) -> float:
    """Largest rate of an attribute along u or v at three points inside a triangle, in its unit per mm."""
    place, value = local_line(12), local_line(12)
    u, v = (uv[0, 0] + uv[1, 0] + uv[2, 0]) / 3.0, (uv[0, 1] + uv[1, 1] + uv[2, 1]) / 3.0
    best = 0.0
    for i in range(3):
        x, y = uv[i, 0] + INSIDE * (u - uv[i, 0]), uv[i, 1] + INSIDE * (v - uv[i, 1])
        surface_point(g, row, x, y, scratch, place)
        surface_point(attribute, row, x, y, scratch, value)
        best = max(best, _quotient(value, place, 3), _quotient(value, place, 6))
    return best


@leaf
def triangle_reach(g: Tables, row: int, uv: Floats, foot: Floats, distance: float) -> float:
    """E + r of a triangle of surface ``row``, mm.

    Args:
        g: the tables.
        row: of the surface.
        uv, foot: (3, 2), (3, 3) parameters and places of the corners, on the surface itself.
        distance: mm, bound of the triangle's distance from the surface, see ``deviation``. Of surfaces of
            revolution that is no bound at equal parameters until what it leaves out is added.
    """
    twist = 0.0
    kind = g.surfaces[row].kind
    if kind == CONE or kind == SPHERE or kind == TORUS or kind == REVOLUTION:
        bounds = local_line(5)
        u0, u1 = min(uv[0, 0], uv[1, 0], uv[2, 0]), max(uv[0, 0], uv[1, 0], uv[2, 0])
        v0, v1 = min(uv[0, 1], uv[1, 1], uv[2, 1]), max(uv[0, 1], uv[1, 1], uv[2, 1])
        closed_form_bounds(g, row, u0, u1, v0, v1, bounds)
        # |S_uv| is the rate at which the distance from the axis changes.
        twist = 0.25 * (u1 - u0) * (v1 - v0) * bounds[LV]
    r = math.sqrt(largest_mean(_apart(foot, 0, 1), _apart(foot, 0, 2), _apart(foot, 1, 2)))
    return (distance + twist + r) * BESIDE


@leaf
def as_length(bound: float, unseen: float, rate: float, reach: float) -> float:
    """A bound of something's deviation carried into space: 0 where nobody sees it, never more than ``reach``, mm."""
    if bound <= unseen:
        return 0.0
    return min(bound / rate, reach) if rate > 0.0 else reach
