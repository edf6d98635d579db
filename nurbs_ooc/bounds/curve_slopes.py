"""Boxes of the derivatives of a profile curve up to the third, or of R in C = c + r R where it begins at a pole."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.curve_bounds import ELLIPSE, curve_net
from nurbs_ooc.bounds.curve_bounds import NURBS as NURBS_CURVE
from nurbs_ooc.bounds.derivative_boxes import component_boxes, divide_by_weight, order, restrict
from nurbs_ooc.bounds.intervals import cosines, over, sines, times
from nurbs_ooc.geometry.bezier_net import LINE
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]


@leaf
def _conic_factors(kind: int, k: int, t0: float, t1: float, out: Floats) -> None:
    """Ranges over [t0, t1] of what A and B are multiplied with in the k-th derivative of a conic, to ``out`` (4,)."""
    if kind == ELLIPSE:
        out[0], out[1] = cosines(t0 + 0.5 * k * math.pi, t1 + 0.5 * k * math.pi)
        out[2], out[3] = sines(t0 + 0.5 * k * math.pi, t1 + 0.5 * k * math.pi)
        return
    x, y = math.cosh(t0), math.cosh(t1)
    low = 1.0 if t0 <= 0.0 <= t1 else min(x, y)
    if k % 2 == 0:
        out[0], out[1], out[2], out[3] = low, max(x, y), math.sinh(t0), math.sinh(t1)
    else:
        out[0], out[1], out[2], out[3] = math.sinh(t0), math.sinh(t1), low, max(x, y)


@leaf
def _conic_derivatives(
    g: Tables, curve: int, t0: float, t1: float, origin: Floats, frame: Floats, first: int, out: Floats
) -> None:
    """Boxes of the derivatives ``first`` to ``first`` + 3 of a conic less ``origin``, along u in ``out``."""
    c = g.curves[curve]
    factors = local_line(4)
    for k in range(4):
        row = order(k, 0)
        _conic_factors(int(c.kind), k + first, t0, t1, factors)
        for e in range(3):
            f, x, y = 0.0, 0.0, 0.0
            for m in range(3):
                if k + first == 0:
                    f += frame[3 * e + m] * (g.values[c.points + m] - origin[m])
                x += frame[3 * e + m] * g.values[c.points + 3 + m]
                y += frame[3 * e + m] * g.values[c.points + 6 + m]
            low, high = times(factors[0], factors[1], x, x)
            more, most = times(factors[2], factors[3], y, y)
            out[row, 2 * e], out[row, 2 * e + 1] = f + low + more, f + high + most


@leaf
def _spline_derivatives(
    g: Tables, curve: int, t0: float, t1: float, span: Floats, pole: int, origin: Floats, frame: Floats, side: int,
    out: Floats,
) -> None:  # fmt: skip
    """The same of a B-spline curve inside its ``span`` (2,), with respect to a parameter from 0 to 1 over [t0, t1]."""
    c = g.curves[curve]
    p = int(c.degree)
    net = local_table(LINE, 4)
    one = local_line(LINE)
    dim = curve_net(g, curve, span[0] if pole else t0, span[1] if pole else t1, net)
    for e in range(dim):
        for i in range(p + 1):
            w = net[i, 3] if dim == 4 else 1.0
            one[i] = w
            if e < 3:
                one[i] = 0.0
                for m in range(3):
                    one[i] += frame[3 * e + m] * (net[i, m] - origin[m] * w)
        degree = p
        if pole:
            if e < 3:
                degree = p - 1
                for i in range(p):
                    one[i] = one[i + 1] * p / (i + 1.0) if pole < 0 else one[i] * p / (p - i)
            wide = span[1] - span[0]
            restrict(one, 0, 1, degree, (t0 - span[0]) / wide, (t1 - span[0]) / wide)
        component_boxes(one, degree, 0, side, out, 2 * e)
    if dim == 4:
        for e in range(0, 6, 2):
            out[0, e], out[0, e + 1] = over(out[0, e], out[0, e + 1], out[0, 6], out[0, 7])
        divide_by_weight(out)


@leaf
def curve_derivatives(
    g: Tables, curve: int, t0: float, t1: float, span: Floats, pole: int, origin: Floats, frame: Floats, side: int,
    a: float, out: Floats,
) -> None:  # fmt: skip
    """Boxes of C - origin and its derivatives to rows ``order(k, 0)`` of ``out`` (ORDERS, WIDTH), others untouched.

    Args:
        g: the tables.
        curve: its row.
        t0, t1: inside one knot span.
        span: that span, or the whole range of a conic.
        pole: -1 or 1 if C starts or ends at ``origin`` there, at that end of ``span``: R instead of C - origin,
            with a factor r that runs from 0 to 1 over the span.
        origin: a point.
        frame: axes of the boxes.
        side: ALL, or FIRST_U or LAST_U for one end of [t0, t1] alone (no conics).
        a: what counts as 1 in derivatives.
        out: (ORDERS, WIDTH).
    """
    c = g.curves[curve]
    if c.kind == NURBS_CURVE:
        _spline_derivatives(g, curve, t0, t1, span, pole, origin, frame, side, out)
        unit = a / (t1 - t0)
    elif not pole:
        _conic_derivatives(g, curve, t0, t1, origin, frame, 0, out)
        unit = a
    else:
        # (C(t) - C(e)) / (t - e) is the mean of C' between e and t, and its k-th derivative that of x^k C^(k+1),
        # x the way from e to t in [0, 1]: within [least, largest] / (k + 1).
        start, end = (span[0], t1) if pole < 0 else (t0, span[1])
        _conic_derivatives(g, curve, start, end, origin, frame, 1, out)
        sign = (span[1] - span[0]) if pole < 0 else (span[0] - span[1])
        for k in range(4):
            row = order(k, 0)
            for e in range(0, 6, 2):
                low, high = out[row, e] / (k + 1.0), out[row, e + 1] / (k + 1.0)
                out[row, e], out[row, e + 1] = (low * sign, high * sign) if sign > 0.0 else (high * sign, low * sign)
        unit = a
    for k in range(1, 4):
        for e in range(6):
            out[order(k, 0), e] *= unit**k
