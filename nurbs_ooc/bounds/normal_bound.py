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

Of a circular cylinder the worst case is known: x_i, the angles from their mean, make a turn of
atan(sum l_i sin x_i / sum l_i cos x_i), which for given l_i x_i of sum 0 is largest for two corners only (a
linear functional on a polygon of weights has its largest value at a corner), so with h = a / 2, t = tan h ::

    f(a) = max over w of |atan(w t) - w h| = atan(x) - h x / t      x = sqrt(t / h - 1)

A cone's normals make an angle b with the plane across the axis, the horizontal part of m shrinks to cos(a / 2)
at worst, so m is steeper by at most atan(tan b / cos(a / 2)) - b, and turned about the axis by f(a).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.derivative_boxes import ALL, FIRST_U, FIRST_V, LAST_U, LAST_V
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces, find_break
from nurbs_ooc.bounds.slope_field import no_slopes, unite_slopes
from nurbs_ooc.bounds.spline_slopes import AT_U0, AT_U1, AT_V0, AT_V1, spline_slopes
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
# A triangle over more knot spans than that is not looked at.
MOST_SPANS = 256
# What roundoff of a few hundred operations on numbers of size 1 may add to an angle.
HAIR = 2.0**-40
# A span narrower than this part of the box is charged like a crease instead of with its second derivative.
THIN = 0.125
# How often a triangle without a bound is looked at a quarter as large.
SHRINKINGS = 6
# Of a span at least this part of the box is looked at.
SLIVER = 0.125
# Numbers of what a bound rests on: second derivatives' norms, then boxes as ``triangle_bound`` wants them, and the
# part of the bound that no smaller triangle is free of.
NOISE = MEASURES
SIZE = MEASURES + 1


@leaf
def turn_of_circle(a: float) -> float:
    """f(a) of the module: the largest error of interpolating normals on an arc of ``a`` radians, a < pi."""
    h = 0.5 * a
    if h < 1e-4:
        # 2 h^3 / (9 sqrt(3)), and a little for the next term.
        return 0.1284 * h * h * h
    t = math.tan(h)
    x = math.sqrt(max(t / h - 1.0, 0.0))
    return math.atan(x) - h * x / t


@leaf
def _is_circular(g: Tables, row: int) -> bool:
    """Whether a cylinder is a circular, straight one."""
    f = g.surfaces[row].frame
    xx, yy, xy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        x, y, z = g.values[f + 3 + k], g.values[f + 6 + k], g.values[f + 9 + k]
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    hair = 1e-13
    return (
        abs(xx - yy) <= hair * xx and abs(xy) <= hair * xx
        and xz * xz <= hair * hair * xx * zz and yz * yz <= hair * hair * yy * zz
    )  # fmt: skip


@leaf
def _circle_bound(g: Tables, row: int, a: float) -> float:
    """Bound for a circular cylinder or a cone over an angle ``a``."""
    if not a < 2.5:
        return math.inf
    turn = turn_of_circle(a)
    if g.surfaces[row].kind == CYLINDER:
        return turn + HAIR
    b = abs(g.values[g.surfaces[row].frame + 13])
    steeper = math.atan2(math.sin(b), math.cos(b) * math.cos(0.5 * a)) - b
    return math.cos(b) * turn + steeper + HAIR


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
def _norm_of(field: Floats, k: int) -> float:
    x = max(-field[k, 0], field[k, 1], 0.0)
    y = max(-field[k, 2], field[k, 3], 0.0)
    return math.sqrt(x * x + y * y)


@leaf
def _apart(left: Floats, right: Floats, k: int) -> float:
    """Largest difference between a vector in one box and one in the other."""
    size = 0.0
    for c in range(0, 4, 2):
        size += max(left[k, c + 1] - right[k, c], right[k, c + 1] - left[k, c]) ** 2
    return math.sqrt(size)


@leaf
def _is_twice_smooth(g: Tables, knots: int, n: int, degree: int, value: float) -> bool:
    """Whether ``value`` is a knot of multiplicity at most degree - 2."""
    count = 0
    for i in range(degree + 1, n):
        if g.values[knots + i] == value:
            count += 1
    return count <= degree - 2


@leaf
def _span_box(p: Pieces, row: int, i: int, j: int, box: Floats, span: Floats, part: Floats) -> bool:
    """Knot span (i, j) to ``span`` and what the box has of it to ``part``; False if that is nothing."""
    at_u, at_v = p.table[row, BREAK_U] + i, p.table[row, BREAK_V] + j
    span[0], span[1] = p.breaks[at_u, 0], p.breaks[at_u + 1, 0]
    span[2], span[3] = p.breaks[at_v, 0], p.breaks[at_v + 1, 0]
    part[0], part[1] = max(box[0], span[0]), min(box[1], span[1])
    part[2], part[3] = max(box[2], span[2]), min(box[3], span[3])
    # Derivatives over a sliver of a span would be differences of roundoff: more of the span is looked at.
    least_u, least_v = SLIVER * (box[1] - box[0]), SLIVER * (box[3] - box[2])
    if part[0] < part[1] < part[0] + least_u:
        part[0] = max(min(part[0], part[1] - least_u), span[0])
        part[1] = min(max(part[1], part[0] + least_u), span[1])
    if part[2] < part[3] < part[2] + least_v:
        part[2] = max(min(part[2], part[3] - least_v), span[2])
        part[3] = min(max(part[3], part[2] + least_v), span[3])
    # Domains end a few units of roundoff beyond knots: what lies there is left to the span beside.
    if i == 0:
        part[0] = min(part[0], box[0])
    if i == p.table[row, N_U] - 1:
        part[1] = max(part[1], box[1])
    if j == 0:
        part[2] = min(part[2], box[2])
    if j == p.table[row, N_V] - 1:
        part[3] = max(part[3], box[3])
    return part[0] < part[1] and part[2] < part[3]


@leaf
def _poles_of_span(p: Pieces, row: int, i: int, j: int, sides: int) -> int:
    """Which poles of a surface are sides of its span (i, j)."""
    bits = 0
    if i == 0:
        bits |= sides & AT_U0
    if i == p.table[row, N_U] - 1:
        bits |= sides & AT_U1
    if j == 0:
        bits |= sides & AT_V0
    if j == p.table[row, N_V] - 1:
        bits |= sides & AT_V1
    return bits


@leaf
def _jump_charge(jump: float, start: float, end: float, low: float, high: float) -> float:
    """What a jump of the first derivative within [start, end] adds over [low, high], see ``creases``."""
    x, y = end - low, high - start
    return jump * x * y / (x + y) if x > 0.0 and y > 0.0 else 0.0


@leaf
def _jump(
    g: Tables, p: Pieces, row: int, k: int, j: int, along_u: bool, box: Floats, sides: int, frame: Floats,
    center: Floats, a: float, b: float,
) -> float:  # fmt: skip
    """How much s_u (s_v) may jump at the break before span ``k`` of one direction, beside span ``j`` of the other."""
    left, right, noise = local_table(6, 4), local_table(6, 4), local_line(2)
    span, part = local_line(4), local_line(4)
    for side in range(2):
        i = k - 1 + side
        m, n = (i, j) if along_u else (j, i)
        if not _span_box(p, row, m, n, box, span, part):
            return 0.0
        poles = _poles_of_span(p, row, m, n, sides)
        rows = (LAST_U if side == 0 else FIRST_U) if along_u else (LAST_V if side == 0 else FIRST_V)
        out = left if side == 0 else right
        if not spline_slopes(g, row, part, span, poles, rows, frame, center, a, b, out, noise):
            return math.inf
    return _apart(left, right, 1 if along_u else 2)


@leaf
def _charge_jumps(
    g: Tables, p: Pieces, row: int, i0: int, i1: int, j0: int, j1: int, along_u: bool, box: Floats, sides: int,
    frame: Floats, center: Floats, a: float, b: float,
) -> float:  # fmt: skip
    """What knots inside a box add across which the surface is not twice smooth."""
    s = g.surfaces[row]
    knots, n, degree = (s.knots_u, s.n_u, s.degree_u) if along_u else (s.knots_v, s.n_v, s.degree_v)
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    low, high = (box[0], box[1]) if along_u else (box[2], box[3])
    first, end = (i0, i1) if along_u else (j0, j1)
    other, last = (j0, j1) if along_u else (i0, i1)
    total = 0.0
    for k in range(first + 1, end):
        value = p.breaks[at + k, 0]
        if value <= low or value >= high or _is_twice_smooth(g, knots, n, degree, value):
            continue
        jump = 0.0
        for j in range(other, last):
            jump = max(jump, _jump(g, p, row, k, j, along_u, box, sides, frame, center, a, b))
        total += _jump_charge(jump, value, value, low, high) / (high - low)
    return total


@leaf
def _spline_field(
    g: Tables, p: Pieces, row: int, box: Floats, sides: int, frame: Floats, center: Floats, field: Floats, noise: Floats
) -> float:
    """Slopes of a B-spline surface over a box, united over its spans, to ``field``; returns what is to be added.

    ``noise`` (1,) gets the part of it that is roundoff.
    """
    a, b = box[1] - box[0], box[3] - box[2]
    n_u, n_v = p.table[row, N_U], p.table[row, N_V]
    i0 = find_break(p, p.table[row, BREAK_U], n_u, box[0])
    j0 = find_break(p, p.table[row, BREAK_V], n_v, box[2])
    i1, j1 = i0 + 1, j0 + 1
    while i1 < n_u and p.breaks[p.table[row, BREAK_U] + i1, 0] < box[1]:
        i1 += 1
    while j1 < n_v and p.breaks[p.table[row, BREAK_V] + j1, 0] < box[3]:
        j1 += 1
    if (i1 - i0) * (j1 - j0) > MOST_SPANS:
        return math.inf
    one, hair = local_table(6, 4), local_line(2)
    span, part = local_line(4), local_line(4)
    no_slopes(field)
    found = False
    worst = 0.0
    charge = 0.0
    thin_v = 0.0
    for i in range(i0, i1):
        thin_u = 0.0
        for j in range(j0, j1):
            if not _span_box(p, row, i, j, box, span, part):
                continue
            poles = _poles_of_span(p, row, i, j, sides)
            if not spline_slopes(g, row, part, span, poles, ALL, frame, center, a, b, one, hair):
                return math.inf
            found = True
            skip_u = i0 < i < i1 - 1 and part[1] - part[0] < THIN * a
            skip_v = j0 < j < j1 - 1 and part[3] - part[2] < THIN * b
            hair[0] *= (part[1] - part[0]) / a if skip_u else 1.0
            hair[1] *= (part[3] - part[2]) / b if skip_v else 1.0
            worst = max(worst, hair[0] + hair[1])
            if skip_u:
                jump = _norm_of(one, 3) * (part[1] - part[0]) / a
                thin_u = max(thin_u, _jump_charge(jump, part[0], part[1], box[0], box[1]) / a)
            if skip_v:
                jump = _norm_of(one, 5) * (part[3] - part[2]) / b
                thin_v += _jump_charge(jump, part[2], part[3], box[2], box[3]) / b
            unite_slopes(one, skip_u, skip_v, field)
        charge += thin_u
    if not found:
        return math.inf
    if i1 - i0 > 1:
        charge += _charge_jumps(g, p, row, i0, i1, j0, j1, True, box, sides, frame, center, a, b)
    if j1 - j0 > 1:
        charge += _charge_jumps(g, p, row, i0, i1, j0, j1, False, box, sides, frame, center, a, b)
    noise[0] = worst
    return worst + charge + thin_v


@leaf
def _slope_field(
    g: Tables, p: Pieces, row: int, box: Floats, sides: int, frame: Floats, center: Floats, field: Floats, noise: Floats
) -> float:
    """As ``_spline_field`` for all kinds."""
    kind = g.surfaces[row].kind
    if kind == NURBS:
        return _spline_field(g, p, row, box, sides, frame, center, field, noise)
    if kind == REVOLUTION or kind == EXTRUSION:
        return swept_field(g, row, box, frame, center, field, noise)
    noise[0] = 0.0
    return turned_slopes(g, row, box, frame, box[1] - box[0], box[3] - box[2], field)


@leaf
def _fill_second(field: Floats, a: float, b: float, m: Floats) -> None:
    """Norms and boxes of second derivatives as ``triangle_bound`` wants them, in parameters, to ``m`` (SIZE,)."""
    for k in range(3):
        scale = 1.0 / (a * a if k == 0 else (a * b if k == 1 else b * b))
        m[k] = _norm_of(field, 3 + k) * scale
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
    if kind == CONE or (kind == CYLINDER and _is_circular(g, row)):
        bound = _circle_bound(g, row, a)
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
        beside = max(beside, _norm_of(field, 1) * step[i, 0] / a + _norm_of(field, 2) * step[i, 1] / b)
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
    return _norm_of(field, 1) / share_u if along_u else _norm_of(field, 2) / share_v


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
