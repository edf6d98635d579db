"""Slopes of a B-spline surface over a parameter box, united over its knot spans (see ``slope_field``).

Where the surface is not twice smooth across a knot, the slopes' first derivatives jump; a jump, and a span too narrow
for its second derivatives, is charged as creases are (see ``creases``).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.derivative_boxes import ALL, FIRST_U, FIRST_V, LAST_U, LAST_V
from nurbs_ooc.bounds.piece_boxes import find_break
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces
from nurbs_ooc.bounds.slope_field import largest_slope, no_slopes, unite_slopes
from nurbs_ooc.bounds.spline_slopes import AT_U0, AT_U1, AT_V0, AT_V1, spline_slopes
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# A triangle over more knot spans than that is not looked at.
MOST_SPANS = 256
# A span narrower than this part of the box is charged like a crease instead of with its second derivative.
THIN = 0.125
# Of a span at least this part of the box is looked at.
SLIVER = 0.125


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
def spline_field(
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
                jump = largest_slope(one, 3) * (part[1] - part[0]) / a
                thin_u = max(thin_u, _jump_charge(jump, part[0], part[1], box[0], box[1]) / a)
            if skip_v:
                jump = largest_slope(one, 5) * (part[3] - part[2]) / b
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
