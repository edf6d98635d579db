"""How far a linearly interpolated attribute is from the one given as a B-spline over a surface's parameters."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.derivatives import BOXES, second_bounds
from nurbs_ooc.bounds.triangle_bound import box_radii, norm_bound, vector_bound
from nurbs_ooc.geometry.bezier_net import NET, bezier_net
from nurbs_ooc.geometry.bspline import find_span
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

MOST_SPANS = 4096
MEASURES = 3 + BOXES
LEAST = 1e-9  # of the domain: no box is thinner
# Of a triangle's box: of a span that it reaches into by less, this much is looked at, for second differences over a
# sliver are roundoff over its square.
SLIVER = 0.125


@leaf
def _span_end(g: Tables, knots: int, n: int, degree: int, low: float, high: float) -> float:
    """Where the part of [low, high] ends that lies in the span after ``low``."""
    span = find_span(g.values, knots, n, degree, low)
    end = g.values[knots + span + 1]
    return high if span == n - 1 or end <= low else min(end, high)


@leaf
def _widened(g: Tables, knots: int, n: int, degree: int, low: float, high: float, least: float) -> tuple[float, float]:
    """[low, high] in one span, or as much of that span as ``least`` asks for."""
    if high - low >= least:
        return low, high
    span = find_span(g.values, knots, n, degree, 0.5 * (low + high))
    start, end = min(g.values[knots + span], low), max(g.values[knots + span + 1], high)
    low = max(start, min(low, high - least))
    return low, min(end, max(high, low + least))


@leaf
def _unite(one: Floats, m: Floats) -> None:
    """Widen the norms and boxes of ``m`` to hold those of ``one``."""
    for k in range(3):
        m[k] = max(m[k], one[k])
        for c in range(3):
            m[3 + 6 * k + c] = min(m[3 + 6 * k + c], one[3 + 6 * k + c])
            m[6 + 6 * k + c] = max(m[6 + 6 * k + c], one[6 + 6 * k + c])


@leaf
def _times(g: Tables, knots: int, n: int, degree: int, value: float) -> int:
    """How often ``value`` is an inner knot."""
    count = 0
    for i in range(degree + 1, n):
        if g.values[knots + i] == value:
            count += 1
    return count


@leaf
def _border(
    net: Floats, p: int, q: int, dim: int, along_u: bool, last: bool, width: float, j: int, out: Floats
) -> None:
    """Derivative across one side of a flat net (p + 1, q + 1, dim), control point j of it, to ``out`` (4,)."""
    n = p if along_u else q
    outer, inner = (n, n - 1) if last else (0, 1)
    step, other = ((q + 1) * dim, dim) if along_u else (dim, (q + 1) * dim)
    sign = 1.0 if last else -1.0
    for k in range(dim):
        out[k] = sign * n * (net[outer * step + j * other + k] - net[inner * step + j * other + k]) / width


@leaf
def _kink(g: Tables, row: int, along_u: bool, before: Floats, after: Floats) -> float:
    """Largest jump of the first derivative between two boxes (u0, u1, v0, v1) of knot spans, side by side."""
    s = g.surfaces[row]
    left, right = local_line(NET), local_line(NET)
    a, b = local_line(4), local_line(4)
    bezier_net(g, row, before[0], before[1], before[2], before[3], left)
    dim = bezier_net(g, row, after[0], after[1], after[2], after[3], right)
    first = 0 if along_u else 2
    count = (s.degree_v if along_u else s.degree_u) + 1
    jump, of_weight = 0.0, 0.0
    for j in range(count):
        _border(left, s.degree_u, s.degree_v, dim, along_u, True, before[first + 1] - before[first], j, a)
        _border(right, s.degree_u, s.degree_v, dim, along_u, False, after[first + 1] - after[first], j, b)
        jump = max(jump, (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
        if dim == 4:
            of_weight = max(of_weight, abs(b[3] - a[3]))
    if dim == 3:
        return math.sqrt(jump)
    # h_u = (A_u - h w_u) / w, of which A, h and w are the same on both sides.
    least, largest = math.inf, 0.0
    for k in range((s.degree_u + 1) * (s.degree_v + 1)):
        w = right[4 * k + 3]
        least = min(least, w)
        largest = max(largest, right[4 * k] ** 2 + right[4 * k + 1] ** 2 + right[4 * k + 2] ** 2)
    return (math.sqrt(jump) + of_weight * math.sqrt(largest) / least) / least


@leaf
def _kinks(g: Tables, row: int, along_u: bool, box: Floats) -> float:
    """What knots inside ``box`` (u0, u1, v0, v1) add at which the attribute has kinks, see ``creases``."""
    s = g.surfaces[row]
    knots, n, degree = (s.knots_u, s.n_u, s.degree_u) if along_u else (s.knots_v, s.n_v, s.degree_v)
    knots_2, n_2, degree_2 = (s.knots_v, s.n_v, s.degree_v) if along_u else (s.knots_u, s.n_u, s.degree_u)
    at, at_2 = (0, 2) if along_u else (2, 0)
    low, high, end_2 = box[at], box[at + 1], box[at_2 + 1]
    before, after = local_line(4), local_line(4)
    total = 0.0
    value = _span_end(g, knots, n, degree, low, high)
    while value < high:
        if _times(g, knots, n, degree, value) >= degree:
            span = find_span(g.values, knots, n, degree, value)
            span_before = span - 1
            while g.values[knots + span_before] == value:
                span_before -= 1
            before[at], before[at + 1] = g.values[knots + span_before], value
            after[at], after[at + 1] = value, g.values[knots + span + 1]
            jump = 0.0
            low_2 = box[at_2]
            while low_2 < end_2:
                span_2 = find_span(g.values, knots_2, n_2, degree_2, low_2)
                for k in range(2):
                    before[at_2 + k] = after[at_2 + k] = g.values[knots_2 + span_2 + k]
                jump = max(jump, _kink(g, row, along_u, before, after))
                low_2 = _span_end(g, knots_2, n_2, degree_2, low_2, end_2)
            total += jump * (value - low) * (high - value) / (high - low)
        value = _span_end(g, knots, n, degree, value, high)
    return total


@leaf
def attribute_bound(
    g: Tables, row: int, missed: Floats, missed_from: int, uv: Floats, m: Floats
) -> tuple[float, float]:
    """Bound of the deviation over a triangle, in the attribute's unit; infinite over more than MOST_SPANS knot spans.

    The attribute is continuous. Its second derivatives tell all but for what its kinks add, which lie at knots.

    Args:
        g: tables of the attributes.
        row: of the attribute.
        missed: by knot span, v fastest, from ``missed_from`` on, unless that is -1: a number of which the largest
            over the triangle's box is the second result, else 0.
        uv: (3, 2) corners of the triangle.
        m: (>= 3 + BOXES,) gets the second derivatives' bounds, to which in pure directions kinks are added.
    """
    s = g.surfaces[row]
    box = local_line(4)
    for k in range(2):
        box[2 * k] = min(uv[0, k], uv[1, k], uv[2, k])
        box[2 * k + 1] = max(uv[0, k], uv[1, k], uv[2, k])
    box[1], box[3] = max(box[1], box[0] + LEAST * (s.u1 - s.u0)), max(box[3], box[2] + LEAST * (s.v1 - s.v0))
    a, b = box[1] - box[0], box[3] - box[2]
    net = local_line(NET)
    one = local_line(MEASURES)
    for k in range(3):
        m[k] = 0.0
        for c in range(3):
            m[3 + 6 * k + c], m[6 + 6 * k + c] = np.inf, -np.inf
    count = 0
    off = 0.0
    low_u = box[0]
    while low_u < box[1]:
        high_u = _span_end(g, s.knots_u, s.n_u, s.degree_u, low_u, box[1])
        from_u, to_u = _widened(g, s.knots_u, s.n_u, s.degree_u, low_u, high_u, SLIVER * a)
        low_v = box[2]
        while low_v < box[3]:
            high_v = _span_end(g, s.knots_v, s.n_v, s.degree_v, low_v, box[3])
            from_v, to_v = _widened(g, s.knots_v, s.n_v, s.degree_v, low_v, high_v, SLIVER * b)
            count += 1
            if count > MOST_SPANS:
                # Halve it the longer way.
                m[0], m[1], m[2] = 8.0 / (a * a), 0.0, 8.0 / (b * b)
                return math.inf, off
            dim = bezier_net(g, row, from_u, to_u, from_v, to_v, net)
            second_bounds(net, s.degree_u, s.degree_v, dim, to_u - from_u, to_v - from_v, 0.0, one)
            _unite(one, m)
            if missed_from >= 0:
                i = find_span(g.values, s.knots_u, s.n_u, s.degree_u, 0.5 * (low_u + high_u)) - s.degree_u
                j = find_span(g.values, s.knots_v, s.n_v, s.degree_v, 0.5 * (low_v + high_v)) - s.degree_v
                off = max(off, missed[missed_from + i * (s.n_v - s.degree_v) + j])
            low_v = high_v
        low_u = high_u
    x0, y0, x1, y1, x2, y2 = uv[0, 0], uv[0, 1], uv[1, 0], uv[1, 1], uv[2, 0], uv[2, 1]
    box_radii(m)
    smooth = min(norm_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0), vector_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0))
    kinks_u, kinks_v = _kinks(g, row, True, box), _kinks(g, row, False, box)
    m[0], m[2] = m[0] + 8.0 * kinks_u / (a * a), m[2] + 8.0 * kinks_v / (b * b)
    return smooth + kinks_u + kinks_v, off
