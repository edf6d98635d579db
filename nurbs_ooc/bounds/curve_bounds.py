"""Bounds of a curve over a parameter interval: derivatives by norm and component, and a box.

The interval must lie within one knot span (up to roundoff); the Bézier net over exactly that
interval is built from its weights, so bounds tighten as intervals shrink.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_cache.surface_record import CurveKind
from nurbs_ooc.bounds.derivatives import BOXES, OUTWARD
from nurbs_ooc.bounds.quotient_bounds import HIGHEST, quotient_bounds
from nurbs_ooc.geometry.bezier_net import LINE
from nurbs_ooc.geometry.bspline import bezier_weights, find_span
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

NURBS = int(CurveKind.NURBS)
ELLIPSE = int(CurveKind.ELLIPSE)

# Numbers of a homogeneous net of ``HIGHEST`` degree.
POINTS = 4 * (HIGHEST + 1)
# Rows of the result.
D1, D2 = 0, 1  # norms of the first and second derivative
D1_X, D2_X = 2, 5  # three components each
LOW, HIGH = 8, 11  # box, three components each
SIZE = 14


@leaf
def curve_net(g: Tables, row: int, a: float, b: float, net: Floats) -> int:
    """Bézier points over [a, b] inside one span; returns their dimension (homogeneous if rational)."""
    c = g.curves[row]
    dim = int(c.dim) + int(c.rational)
    span = find_span(g.values, c.knots, c.n, c.degree, 0.5 * (a + b))
    weights = local_table(LINE, LINE)
    bezier_weights(g.values, c.knots, span, c.degree, a, b, weights)
    at = c.points + (span - c.degree) * dim
    for k in range(c.degree + 1):
        for m in range(dim):
            net[k, m] = 0.0
        for i in range(c.degree + 1):
            for m in range(dim):
                net[k, m] += weights[k, i] * g.values[at + i * dim + m]
    return dim


@leaf
def _conic_bounds(g: Tables, row: int, a: float, b: float, out: Floats) -> None:
    """Ellipse and hyperbola: amplitudes bound the derivatives, chord and deviation the box."""
    c = g.curves[row]
    dim = int(c.dim)
    grow = 1.0
    if c.kind != ELLIPSE:
        grow = math.cosh(max(abs(a), abs(b)))
    start = local_line(6)
    end = local_line(6)
    scratch = local_table(2, 1)  # conics need none
    curve_point(g, row, a, scratch, start)
    curve_point(g, row, b, scratch, end)
    size_a = 0.0
    size_b = 0.0
    for k in range(dim):
        x = g.values[c.points + dim + k]
        y = g.values[c.points + 2 * dim + k]
        size_a += x * x
        size_b += y * y
        amplitude = math.sqrt(x * x + y * y) * (1.0 if c.kind == ELLIPSE else 1.5 * grow)
        out[D1_X + k] = amplitude * OUTWARD
        out[D2_X + k] = amplitude * OUTWARD
        swing = amplitude * (b - a) * (b - a) / 8.0
        out[LOW + k] = min(start[k], end[k]) - swing
        out[HIGH + k] = max(start[k], end[k]) + swing
    # |A cos + B sin| <= max(|A|, |B|) only for orthogonal A, B: true of conics in the record up to shear.
    norm = math.sqrt(size_a + size_b)
    dot = 0.0
    for k in range(dim):
        dot += g.values[c.points + dim + k] * g.values[c.points + 2 * dim + k]
    if c.kind == ELLIPSE:
        # Largest singular value of the dim x 2 matrix (A B).
        half = 0.5 * (size_a + size_b)
        norm = math.sqrt(half + math.sqrt(0.25 * (size_a - size_b) ** 2 + dot * dot))
    else:
        norm *= 1.5 * grow
    out[D1] = norm * OUTWARD
    out[D2] = norm * OUTWARD


@leaf
def _straight_bounds(g: Tables, row: int, a: float, b: float, out: Floats) -> None:
    """A piece of a polygon: constant derivative, a box from its ends, no second derivative."""
    c = g.curves[row]
    n = int(c.dim)
    span = find_span(g.values, c.knots, c.n, 1, 0.5 * (a + b))
    low, high = g.values[c.knots + span], g.values[c.knots + span + 1]
    size = 0.0
    for k in range(n):
        x = g.values[c.points + (span - 1) * n + k]
        slope = (g.values[c.points + span * n + k] - x) / (high - low)
        start, end = x + slope * (a - low), x + slope * (b - low)
        out[LOW + k], out[HIGH + k] = min(start, end), max(start, end)
        out[D1_X + k] = abs(slope) * OUTWARD
        size += slope * slope
    out[D1] = math.sqrt(size) * OUTWARD


@leaf
def _weights(net: Floats, p: int, n: int, h: float, center: Floats) -> tuple[float, float, float]:
    """Least weight of a rational net and bounds of the weight's two derivatives; the ends' middle to ``center``."""
    least = net[0, n]
    first = 0.0
    second = 0.0
    for i in range(p + 1):
        least = min(least, net[i, n])
    for i in range(p):
        first = max(first, p * abs(net[i + 1, n] - net[i, n]) / h)
    for i in range(p - 1):
        second = max(second, p * (p - 1) * abs(net[i + 2, n] - 2.0 * net[i + 1, n] + net[i, n]) / (h * h))
    for k in range(n):
        center[k] = 0.5 * (net[0, k] / net[0, n] + net[p, k] / net[p, n])
    return least, first, second


@leaf
def _box(net: Floats, p: int, n: int, rational: bool, center: Floats, radius: Floats, out: Floats) -> float:
    """The net's box to ``out``, its reach from ``center`` by component to ``radius``; returns the largest distance."""
    farthest = 0.0
    for k in range(n):
        radius[k] = 0.0
        out[LOW + k], out[HIGH + k] = np.inf, -np.inf
    for i in range(p + 1):
        size = 0.0
        for k in range(n):
            x = net[i, k] / net[i, n] if rational else net[i, k]
            out[LOW + k], out[HIGH + k] = min(out[LOW + k], x), max(out[HIGH + k], x)
            radius[k] = max(radius[k], abs(x - center[k]))
            size += (x - center[k]) ** 2
        farthest = max(farthest, math.sqrt(size))
    return farthest


@leaf
def _differences(net: Floats, p: int, n: int, rational: bool, h: float, center: Floats, out: Floats) -> None:
    """Largest first and second differences of the net, less ``center`` times its weights if rational, to ``out``."""
    for i in range(p):
        first = 0.0
        second = 0.0
        for k in range(n):
            d = net[i + 1, k] - net[i, k]
            if rational:
                d -= (net[i + 1, n] - net[i, n]) * center[k]
            d *= p / h
            out[D1_X + k] = max(out[D1_X + k], abs(d))
            first += d * d
            if i < p - 1:
                d = net[i + 2, k] - 2.0 * net[i + 1, k] + net[i, k]
                if rational:
                    d -= (net[i + 2, n] - 2.0 * net[i + 1, n] + net[i, n]) * center[k]
                d *= p * (p - 1) / (h * h)
                out[D2_X + k] = max(out[D2_X + k], abs(d))
                second += d * d
        out[D1] = max(out[D1], math.sqrt(first))
        out[D2] = max(out[D2], math.sqrt(second))


@leaf
def _keep_quotients(net: Floats, p: int, n: int, h: float, center: Floats, out: Floats) -> None:
    """Let the bounds of a rational curve be no larger than those of its quotients."""
    points = local_line(POINTS)
    for i in range(p + 1):
        points[4 * i + 2] = 0.0
        for k in range(n):
            points[4 * i + k] = net[i, k]
        points[4 * i + 3] = net[i, n]
    norms, boxes = local_line(5), local_line(BOXES)
    quotient_bounds(points, p, 0, h, 1.0, center, True, norms, boxes)
    out[D1], out[D2] = min(out[D1], norms[0]), min(out[D2], norms[2])
    for k in range(n):
        out[D1_X + k] = min(out[D1_X + k], norms[0])
        out[D2_X + k] = min(out[D2_X + k], max(-boxes[k], boxes[3 + k]))


@leaf
def curve_bounds(g: Tables, row: int, a: float, b: float, out: Floats) -> None:
    """Write the bounds of curve ``row`` over [a, b], a < b inside one knot span, to ``out`` (SIZE,)."""
    c = g.curves[row]
    for k in range(SIZE):
        out[k] = 0.0
    if c.kind != NURBS:
        _conic_bounds(g, row, a, b, out)
        return
    if c.degree == 1 and c.rational == 0:
        _straight_bounds(g, row, a, b, out)
        return
    n = int(c.dim)
    rational = c.rational != 0
    net = local_table(LINE, 4)
    curve_net(g, row, a, b, net)
    radius = local_line(3)
    center = local_line(3)
    for k in range(3):
        center[k] = 0.0
    w_min, w1, w2 = _weights(net, c.degree, n, b - a, center) if rational else (1.0, 0.0, 0.0)
    r = _box(net, c.degree, n, rational, center, radius, out)
    _differences(net, c.degree, n, rational, b - a, center, out)
    if rational:
        # Quotient rule, by norm and by component.
        out[D1] = (out[D1] + r * w1) / w_min
        out[D2] = (out[D2] + 2.0 * w1 * out[D1] + r * w2) / w_min
        for k in range(n):
            out[D1_X + k] = (out[D1_X + k] + radius[k] * w1) / w_min
            out[D2_X + k] = (out[D2_X + k] + 2.0 * w1 * out[D1_X + k] + radius[k] * w2) / w_min
        if c.degree <= HIGHEST:
            _keep_quotients(net, c.degree, n, b - a, center, out)
    for k in range(LOW):
        out[k] *= OUTWARD


@leaf
def axis_distance(g: Tables, row: int, a: float, b: float, axis: int) -> float:
    """Largest distance of the curve over [a, b] from the axis of the frame at ``axis`` (offset in values)."""
    c = g.curves[row]
    best = 0.0
    count = 2
    extra = 0.0
    net = local_table(LINE, 4)
    n = 3
    if c.kind == NURBS:
        curve_net(g, row, a, b, net)
        count = c.degree + 1
    else:
        bounds = local_line(SIZE)
        _conic_bounds(g, row, a, b, bounds)
        extra = bounds[D2] * (b - a) * (b - a) / 8.0
        end = local_line(6)
        scratch = local_table(2, 1)
        for i in range(2):
            curve_point(g, row, a if i == 0 else b, scratch, end)
            for k in range(3):
                net[i, k] = end[k]
    for i in range(count):
        d2 = 0.0
        h = 0.0
        for k in range(3):
            x = net[i, k] / net[i, n] if (c.kind == NURBS and c.rational) else net[i, k]
            d = x - g.values[axis + k]
            d2 += d * d
            h += d * g.values[axis + 9 + k]
        best = max(best, math.sqrt(max(d2 - h * h, 0.0)))
    return (best + extra) * OUTWARD
