r"""How far the interpolated normal of a triangle may turn from the surface's: a proven bound of the angle.

Let q run over the triangle with corners q_i in parameters, n(q) be the surface's unit normal and m(q) the
sum of l_i n_i, l_i the barycentric weights of q. In a frame whose third axis is n somewhere in the middle, both
have slopes (see ``slope_field``), with s_i those of n_i and c_i the third components. Then ::

    angle(n, m) <= |s(q) - s_m(q)|
                <= |s(q) - sum l_i s(q_i)| + max |s(q_i) - s_i| + |sum l_i s_i - s_m|

1. is the deviation of a linear interpolant, of s instead of S: ``triangle_bound`` holds with the second
   derivatives of s over the triangle's box, and their jumps charge as creases do (``creases``) at knots across
   which S is not twice smooth; s of a smooth surface has no jump itself.
2. is not 0 at a pole, whose limit is taken a small step beside it: the step times |s_u|, |s_v|.
3. weights of m are l_i c_i / sum l_j c_j. With D the largest |s_i - s_j|, sum l_i |s_i - s'| <= 2/3 D at s' the
   mean, and any number may be taken off all c_i: it is at most (c_max - c_min) D / (3 c_min).

Second derivatives of s shrink as triangles do to those of the curvature's own change, for the frame turns along:
on a sphere or cylinder all three parts are of third order.

Of circular cylinders and cones the worst case is known, see ``circle_turn``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.circle_turn import HAIR, circle_bound, is_circular
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.bounds.slope_field import largest_slope
from nurbs_ooc.bounds.spline_field import spline_field
from nurbs_ooc.bounds.swept_field import swept_field
from nurbs_ooc.bounds.tagged_slopes import turned_slopes
from nurbs_ooc.bounds.triangle_bound import MEASURES, box_radii, norm_bound, vector_bound
from nurbs_ooc.geometry.surface import (
    CONE,
    CYLINDER,
    EXTRUSION,
    NURBS,
    PLANE,
    REVOLUTION,
    surface_point,
    unit_cross,
)
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]

BASIS = MAX_DEGREE + 2  # room for the basis functions of a point

# A box thinner than this part of its other side, both as shares of the domain, is taken for as wide: derivatives
# across nothing are roundoff.
THINNEST = 2.0**-10
# Least cosine of a corner's normal with the middle one.
STEEPEST = 0.3
# How often a triangle without a bound is looked at a quarter as large.
SHRINKINGS = 6
# Numbers of what a bound rests on: second derivatives' norms, then boxes as ``triangle_bound`` wants them, and the
# part of the bound that no smaller triangle is free of.
NOISE = MEASURES
SIZE = MEASURES + 1


@leaf
def _frame_at(g: Tables, row: int, u: float, v: float, frame: Floats, center: Floats) -> bool:
    """A frame (9,) with the normal at (u, v) as third axis, S_u's direction as first; False at a pole."""
    scratch = local_table(4, BASIS)
    at = local_line(12)
    surface_point(g, row, u, v, scratch, at)
    normal = local_line(3)
    if not unit_cross(at, normal):
        return False
    size = math.sqrt(at[3] * at[3] + at[4] * at[4] + at[5] * at[5])
    for k in range(3):
        center[k] = at[k]
        frame[k] = at[3 + k] / size
        frame[6 + k] = normal[k]
    frame[3] = normal[1] * frame[2] - normal[2] * frame[1]
    frame[4] = normal[2] * frame[0] - normal[0] * frame[2]
    frame[5] = normal[0] * frame[1] - normal[1] * frame[0]
    return True


@leaf
def _corner_slopes(normal: Floats, frame: Floats, slope: Floats) -> float:
    """Slopes of the three corners' normals to ``slope`` (3, 2); returns part 3 of the bound, infinite if too steep."""
    least, most = 1.0, 0.0
    for i in range(3):
        c = 0.0
        for k in range(3):
            c += normal[i, k] * frame[6 + k]
        if not c > STEEPEST:
            return math.inf
        least, most = min(least, c), max(most, c)
        for e in range(2):
            x = 0.0
            for k in range(3):
                x += normal[i, k] * frame[3 * e + k]
            slope[i, e] = x / c
    widest = 0.0
    for i in range(3):
        j = (i + 1) % 3
        widest = max(widest, (slope[i, 0] - slope[j, 0]) ** 2 + (slope[i, 1] - slope[j, 1]) ** 2)
    return (most - least) * math.sqrt(widest) / (3.0 * least)


@leaf
def _slope_field(
    g: Tables, p: Pieces, row: int, box: Floats, sides: int, frame: Floats, center: Floats, field: Floats, noise: Floats
) -> float:
    """As ``spline_field`` for all kinds."""
    kind = g.surfaces[row].kind
    if kind == NURBS:
        return spline_field(g, p, row, box, sides, frame, center, field, noise)
    if kind == REVOLUTION or kind == EXTRUSION:
        return swept_field(g, row, box, frame, center, field, noise)
    noise[0] = 0.0
    return turned_slopes(g, row, box, frame, box[1] - box[0], box[3] - box[2], field)


@leaf
def _fill_second(field: Floats, a: float, b: float, m: Floats) -> None:
    """Norms and boxes of second derivatives as ``triangle_bound`` wants them, in parameters, to ``m`` (SIZE,)."""
    for k in range(3):
        scale = 1.0 / (a * a if k == 0 else (a * b if k == 1 else b * b))
        m[k] = largest_slope(field, 3 + k) * scale
        for e in range(2):
            low, high = field[3 + k, 2 * e], field[3 + k, 2 * e + 1]
            m[3 + 6 * k + e] = low * scale if low <= high else 0.0
            m[6 + 6 * k + e] = high * scale if low <= high else 0.0
        m[5 + 6 * k], m[8 + 6 * k] = 0.0, 0.0


@leaf
def _parameter_box(g: Tables, row: int, uv: Floats, box: Floats) -> None:
    """The box (u0, u1, v0, v1) of a triangle's corners, not too thin either way, inside the surface's domain."""
    s = g.surfaces[row]
    for k in range(2):
        box[2 * k] = min(uv[0, k], uv[1, k], uv[2, k])
        box[2 * k + 1] = max(uv[0, k], uv[1, k], uv[2, k])
    size_u, size_v = s.u1 - s.u0, s.v1 - s.v0
    share_u, share_v = (box[1] - box[0]) / size_u, (box[3] - box[2]) / size_v
    least_u, least_v = max(THINNEST * share_v, 1e-14) * size_u, max(THINNEST * share_u, 1e-14) * size_v
    if box[1] - box[0] < least_u:
        box[0] = max(min(box[0], s.u1 - least_u), min(box[0], s.u0))
        box[1] = max(box[0] + least_u, box[1])
    if box[3] - box[2] < least_v:
        box[2] = max(min(box[2], s.v1 - least_v), min(box[2], s.v0))
        box[3] = max(box[2] + least_v, box[3])


@leaf
def normal_bound(
    g: Tables, p: Pieces, row: int, sides: int, uv: Floats, normal: Floats, step: Floats, m: Floats
) -> float:
    """Bound of the angle between interpolated and true normal over a triangle, radians; infinite if there is none.

    Args:
        g: the tables.
        p: pieces, made for an error of 0: no strips are taken for creases.
        row: of the surface, whose creases the triangle does not cross.
        sides: see ``pole_sides``; 0 for tagged surfaces.
        uv: (3, 2) corners.
        normal: (3, 3) their unit normals, in the sense of S_u x S_v.
        step: (3, 2) how far from ``uv`` each was taken.
        m: (SIZE,) gets what the bound rests on: second derivatives in parameters, as for ``triangle_bound``.
    """
    kind = g.surfaces[row].kind
    for k in range(SIZE):
        m[k] = 0.0
    if kind == PLANE:
        return 0.0
    box = local_line(4)
    _parameter_box(g, row, uv, box)
    a, b = box[1] - box[0], box[3] - box[2]
    if kind == CONE or (kind == CYLINDER and is_circular(g, row)):
        bound = circle_bound(g, row, a)
        m[0] = 8.0 * bound / (a * a)
        return bound
    frame, center = local_line(9), local_line(3)
    slope = local_table(3, 2)
    u, v = (uv[0, 0] + uv[1, 0] + uv[2, 0]) / 3.0, (uv[0, 1] + uv[1, 1] + uv[2, 1]) / 3.0
    if not _frame_at(g, row, u, v, frame, center):
        return math.inf
    uneven = _corner_slopes(normal, frame, slope)
    if uneven == math.inf:
        return math.inf
    field = local_table(6, 4)
    noise = local_line(1)
    more = _slope_field(g, p, row, box, sides, frame, center, field, noise)
    if not more < math.inf:
        return math.inf
    _fill_second(field, a, b, m)
    box_radii(m)
    x0, y0, x1, y1, x2, y2 = uv[0, 0], uv[0, 1], uv[1, 0], uv[1, 1], uv[2, 0], uv[2, 1]
    linear = min(norm_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0), vector_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0))
    beside = 0.0
    for i in range(3):
        beside = max(beside, largest_slope(field, 1) * step[i, 0] / a + largest_slope(field, 2) * step[i, 1] / b)
    m[NOISE] = noise[0]
    bound = (linear + uneven) * (1.0 + HAIR) + beside + more + HAIR
    return bound if bound < math.pi else math.inf


@leaf
def _shrunk_turn(
    g: Tables, p: Pieces, row: int, sides: int, uv: Floats, share_u: float, share_v: float, along_u: bool
) -> float:
    """How far normals turn along one direction over a triangle's box shrunk about its middle; infinite if unknown."""
    box, frame, center = local_line(4), local_line(9), local_line(3)
    _parameter_box(g, row, uv, box)
    u, v = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])
    a, b = share_u * (box[1] - box[0]), share_v * (box[3] - box[2])
    if not _frame_at(g, row, u, v, frame, center):
        return math.inf
    box[0], box[1], box[2], box[3] = u - 0.5 * a, u + 0.5 * a, v - 0.5 * b, v + 0.5 * b
    field, noise = local_table(6, 4), local_line(1)
    if _slope_field(g, p, row, box, sides, frame, center, field, noise) == math.inf:
        return math.inf
    return largest_slope(field, 1) / share_u if along_u else largest_slope(field, 2) / share_v


@leaf
def unbounded_metric(g: Tables, p: Pieces, row: int, sides: int, uv: Floats, m: Floats) -> None:
    """Which way to halve a triangle that has no bound, as second derivatives for lengths, to ``m`` (3,).

    It is the direction in which less of the triangle is needed for a bound.
    """
    box = local_line(4)
    _parameter_box(g, row, uv, box)
    a, b = box[1] - box[0], box[3] - box[2]
    turn_u, turn_v = 0.0, 0.0
    share = 0.5
    for _ in range(SHRINKINGS):
        turn_u = _shrunk_turn(g, p, row, sides, uv, share, 1.0, True)
        turn_v = _shrunk_turn(g, p, row, sides, uv, 1.0, share, False)
        if turn_u < math.inf or turn_v < math.inf:
            break
        share *= 0.25
    m[0], m[1], m[2] = 32.0 / (a * a), 0.0, 32.0 / (b * b)
    if turn_u < math.inf and (turn_v == math.inf or turn_u > turn_v):
        m[2] = 0.0
    elif turn_v < math.inf:
        m[0] = 0.0
