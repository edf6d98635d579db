"""Single points of a recorded surface in any number type, for checking the checker.

Slow and plain: de Boor's triangle in a direction at a time, in the arithmetic of the numbers that are
handed in (``mpmath.mpf`` for 50 digits, ``numpy.longdouble`` for 19).

Source: L. Piegl and W. Tiller, The NURBS Book, 2nd edition, 1997, section 5.2 (knot insertion at the
parameter itself); C. de Boor, A Practical Guide to Splines, 1978, chapter X.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

Number = Any
Vector = list[Number]


@dataclass(frozen=True)
class Arithmetic:
    """The number type with the functions of its kind."""

    number: Callable[[float], Number]
    cos: Callable[[Number], Number]
    sin: Callable[[Number], Number]
    cosh: Callable[[Number], Number]
    sinh: Callable[[Number], Number]


EXTENDED = Arithmetic(np.longdouble, np.cos, np.sin, np.cosh, np.sinh)


def multiprecision(digits: int = 50) -> Arithmetic:
    """Mpmath numbers of so many decimal digits (sets mpmath's working precision)."""
    import mpmath  # type: ignore[import-untyped]

    mpmath.mp.dps = digits
    return Arithmetic(mpmath.mpf, mpmath.cos, mpmath.sin, mpmath.cosh, mpmath.sinh)


def de_boor(knots: Sequence[Number], degree: int, rows: Sequence[Vector], t: Number) -> Vector:
    """The B-spline with control points ``rows`` at ``t``."""
    n = len(rows)
    span = max(i for i in range(degree, n) if (knots[i] <= t or i == degree) and knots[i] < knots[i + 1])
    d = [list(rows[span - degree + j]) for j in range(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            i = span - degree + j
            alpha = (t - knots[i]) / (knots[i + degree - r + 1] - knots[i])
            d[j] = [(1 - alpha) * a + alpha * b for a, b in zip(d[j - 1], d[j], strict=True)]
    return d[degree]


def curve_point(geometry: GeometryBatch, row: int, t: Number, arithmetic: Arithmetic) -> Vector:
    """The curve in ``row`` at ``t``: ``dim`` numbers."""
    curve, number = geometry.curves[row], arithmetic.number
    dim, first = int(curve["dim"]), int(curve["points"])
    if curve["kind"] != CurveKind.NURBS:
        c, a, b = ([number(x) for x in geometry.values[first + k * dim : first + (k + 1) * dim]] for k in range(3))
        circle = curve["kind"] == CurveKind.ELLIPSE
        p, q = (arithmetic.cos(t), arithmetic.sin(t)) if circle else (arithmetic.cosh(t), arithmetic.sinh(t))
        return [c[k] + p * a[k] + q * b[k] for k in range(dim)]
    n, degree = int(curve["n"]), int(curve["degree"])
    width = dim + int(curve["rational"])
    knots = [number(x) for x in geometry.values[int(curve["knots"]) : int(curve["knots"]) + n + degree + 1]]
    net = geometry.values[first : first + n * width].reshape(n, width)
    point = de_boor(knots, degree, [[number(x) for x in p] for p in net], t)
    return [x / point[dim] for x in point[:dim]] if curve["rational"] else point


def surface_point(geometry: GeometryBatch, row: int, u: Number, v: Number, arithmetic: Arithmetic) -> Vector:
    """The surface in ``row`` at native (u, v): three numbers."""
    s, number = geometry.surfaces[row], arithmetic.number
    if s["kind"] == SurfaceKind.NURBS:
        return _nurbs_point(geometry, s, u, v, number)
    frame = [number(x) for x in geometry.values[int(s["frame"]) : int(s["frame"]) + 14]]
    o, x, y, z, a, b = frame[0:3], frame[3:6], frame[6:9], frame[9:12], frame[12], frame[13]
    kind = SurfaceKind(int(s["kind"]))
    if kind == SurfaceKind.PLANE:
        return [o[k] + u * x[k] + v * y[k] for k in range(3)]
    if kind == SurfaceKind.EXTRUSION:
        c = curve_point(geometry, int(s["profile"]), u, arithmetic)
        return [c[k] + v * z[k] for k in range(3)]
    cos, sin = arithmetic.cos, arithmetic.sin
    if kind == SurfaceKind.REVOLUTION:
        c = curve_point(geometry, int(s["profile"]), v, arithmetic)
        c = [c[k] - o[k] for k in range(3)]
        cross = [z[1] * c[2] - z[2] * c[1], z[2] * c[0] - z[0] * c[2], z[0] * c[1] - z[1] * c[0]]
        along = (1 - cos(u)) * sum(z[k] * c[k] for k in range(3))
        return [o[k] + cos(u) * c[k] + sin(u) * cross[k] + along * z[k] for k in range(3)]
    if kind == SurfaceKind.CYLINDER:
        r, h = number(1), v
    elif kind == SurfaceKind.CONE:
        r, h = a + v * sin(b), v * cos(b)
    elif kind == SurfaceKind.SPHERE:
        r, h = a * cos(v), a * sin(v)
    else:
        r, h = a + b * cos(v), b * sin(v)
    return [o[k] + r * (cos(u) * x[k] + sin(u) * y[k]) + h * z[k] for k in range(3)]


def _nurbs_point(geometry: GeometryBatch, s: Any, u: Number, v: Number, number: Callable[[float], Number]) -> Vector:
    n_u, n_v, p, q = (int(s[name]) for name in ("n_u", "n_v", "degree_u", "degree_v"))
    width = 3 + int(s["rational"])
    values = geometry.values
    knots_u = [number(x) for x in values[int(s["knots_u"]) : int(s["knots_u"]) + n_u + p + 1]]
    knots_v = [number(x) for x in values[int(s["knots_v"]) : int(s["knots_v"]) + n_v + q + 1]]
    net = values[int(s["points"]) : int(s["points"]) + n_u * n_v * width].reshape(n_u, n_v, width)
    rows = [de_boor(knots_v, q, [[number(x) for x in point] for point in line], v) for line in net]
    point = de_boor(knots_u, p, rows, u)
    return [x / point[3] for x in point[:3]] if s["rational"] else point
