"""Slopes of the normals of a swept surface over a parameter box, span by span of its profile."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.curve_bounds import NURBS as NURBS_CURVE
from nurbs_ooc.bounds.derivative_boxes import ALL, FIRST_U, LAST_U
from nurbs_ooc.bounds.slope_field import no_slopes, unite_slopes
from nurbs_ooc.bounds.tagged_slopes import swept_slopes
from nurbs_ooc.geometry.bspline import find_span
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.surface import EXTRUSION, VANISHING
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]

BASIS = MAX_DEGREE + 2  # room for the basis functions of a point

MOST_SPANS = 256
# Of a span at least this part of the box is looked at: derivatives over less would be differences of roundoff.
SLIVER = 0.125


@leaf
def on_axis(g: Tables, row: int, t: float) -> bool:
    """Whether the profile of a surface of revolution meets the axis at ``t``."""
    s = g.surfaces[row]
    if s.kind == EXTRUSION:
        return False
    at = local_line(6)
    curve_point(g, s.profile, t, local_table(2, BASIS), at)
    along = 0.0
    size = 0.0
    for k in range(3):
        along += (at[k] - g.values[s.frame + k]) * g.values[s.frame + 9 + k]
        size += at[k] * at[k] + g.values[s.frame + k] ** 2
    off = 0.0
    for k in range(3):
        off += (at[k] - g.values[s.frame + k] - along * g.values[s.frame + 9 + k]) ** 2
    return off <= VANISHING * VANISHING * size


@leaf
def _span_of(g: Tables, row: int, t: float, span: Floats) -> None:
    """The profile's knot span that holds ``t``, or the range of a conic in use, to ``span`` (2,)."""
    s = g.surfaces[row]
    c = g.curves[s.profile]
    if c.kind == NURBS_CURVE:
        i = find_span(g.values, c.knots, c.n, c.degree, t)
        span[0], span[1] = g.values[c.knots + i], g.values[c.knots + i + 1]
    else:
        span[0], span[1] = (s.u0, s.u1) if s.kind == EXTRUSION else (s.v0, s.v1)


@leaf
def _pole_of_span(g: Tables, row: int, span: Floats, low: float, high: float) -> int:
    """-1 or 1 if the profile reaches the axis at that end of a span, the nearer one to [low, high]; else 0."""
    at_start, at_end = on_axis(g, row, span[0]), on_axis(g, row, span[1])
    if at_start and (not at_end or low - span[0] <= span[1] - high):
        return -1
    return 1 if at_end else 0


@leaf
def _part_slopes(
    g: Tables, row: int, box: Floats, low: float, high: float, side: int, frame: Floats, center: Floats, out: Floats
) -> float:
    """Slopes over the part [low, high] of the profile's range that lies in one span."""
    s = g.surfaces[row]
    span, part = local_line(2), local_line(4)
    _span_of(g, row, 0.5 * (low + high), span)
    least = SLIVER * ((box[1] - box[0]) if s.kind == EXTRUSION else (box[3] - box[2]))
    if high - low < least:
        low = max(min(low, high - least), span[0])
        high = min(max(high, low + least), span[1])
    part[0], part[1], part[2], part[3] = box[0], box[1], box[2], box[3]
    if s.kind == EXTRUSION:
        part[0], part[1] = low, high
    else:
        part[2], part[3] = low, high
    pole = _pole_of_span(g, row, span, low, high)
    return swept_slopes(g, row, part, span, pole, side, frame, center, box[1] - box[0], box[3] - box[2], out)


@leaf
def _multiplicity(g: Tables, row: int, value: float) -> int:
    c = g.curves[g.surfaces[row].profile]
    count = 0
    for i in range(c.n + c.degree + 1):
        if g.values[c.knots + i] == value:
            count += 1
    return count


@leaf
def swept_field(g: Tables, row: int, box: Floats, frame: Floats, center: Floats, field: Floats, noise: Floats) -> float:
    """Slopes and their derivatives over a box to ``field`` (SECONDS, 4); returns what is to be added to a bound.

    That is roundoff, which goes to ``noise`` (1,) too, and what jumps of the slopes' derivative at knots of the
    profile charge; infinite if there are no slopes in this frame.
    """
    s = g.surfaces[row]
    c = g.curves[s.profile]
    along_u = s.kind == EXTRUSION
    start, end = (box[0], box[1]) if along_u else (box[2], box[3])
    one, left, right = local_table(6, 4), local_table(6, 4), local_table(6, 4)
    span = local_line(2)
    no_slopes(field)
    worst, charge = 0.0, 0.0
    low = start
    for _ in range(MOST_SPANS):
        high = end
        if c.kind == NURBS_CURVE:
            for i in range(c.degree + 1, c.n):
                if g.values[c.knots + i] > low:
                    high = min(high, g.values[c.knots + i])
                    break
        hair = _part_slopes(g, row, box, low, high, ALL, frame, center, one)
        if hair == math.inf:
            return math.inf
        worst = max(worst, hair)
        unite_slopes(one, False, False, field)
        if high >= end:
            noise[0] = worst
            return worst + charge
        if _multiplicity(g, row, high) > c.degree - 2:
            # Only conics and splines of a single span have no such knots, so the sides of nets are meant.
            _span_of(g, row, high, span)
            after = min(span[1], end)
            if _part_slopes(g, row, box, low, high, LAST_U, frame, center, left) == math.inf:
                return math.inf
            if _part_slopes(g, row, box, high, after, FIRST_U, frame, center, right) == math.inf:
                return math.inf
            k = 1 if along_u else 2
            jump = 0.0
            for e in range(0, 4, 2):
                jump += max(left[k, e + 1] - right[k, e], right[k, e + 1] - left[k, e]) ** 2
            x, y = high - start, end - high
            charge += math.sqrt(jump) * x * y / ((x + y) * (end - start))
        low = high
    return math.inf
