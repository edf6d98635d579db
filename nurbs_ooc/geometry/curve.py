"""Evaluation of curves of every kind, in two and three dimensions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import CurveKind, GeometryBatch
from nurbs_ooc.geometry.bspline import basis, find_span
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables

Floats = npt.NDArray[np.float64]

NURBS = int(CurveKind.NURBS)
ELLIPSE = int(CurveKind.ELLIPSE)


@leaf
def curve_point(g: Tables, row: int, t: float, scratch: Floats, out: Floats) -> None:
    """Write C(t) to ``out[:dim]`` and C'(t) to ``out[3:3 + dim]``; ``scratch`` is (>= 2, MAX_DEGREE + 2)."""
    c = g.curves[row]
    dim = int(c.dim)
    p = c.points
    if c.kind != NURBS:
        if c.kind == ELLIPSE:
            f, h = math.cos(t), math.sin(t)
            df, dh = -h, f
        else:
            f, h = math.cosh(t), math.sinh(t)
            df, dh = h, f
        for k in range(dim):
            out[k] = g.values[p + k] + f * g.values[p + dim + k] + h * g.values[p + 2 * dim + k]
            out[3 + k] = df * g.values[p + dim + k] + dh * g.values[p + 2 * dim + k]
        return
    span = find_span(g.values, c.knots, c.n, c.degree, t)
    basis(g.values, c.knots, span, c.degree, t, scratch[0], scratch[1])
    step = dim + (1 if c.rational else 0)
    w = 1.0
    dw = 0.0
    if c.rational:
        w = 0.0
        for i in range(c.degree + 1):
            weight = g.values[p + (span - c.degree + i) * step + dim]
            w += scratch[0, i] * weight
            dw += scratch[1, i] * weight
    for k in range(dim):
        x = 0.0
        dx = 0.0
        for i in range(c.degree + 1):
            value = g.values[p + (span - c.degree + i) * step + k]
            x += scratch[0, i] * value
            dx += scratch[1, i] * value
        if c.rational:
            x /= w
            dx = (dx - dw * x) / w
        out[k] = x
        out[3 + k] = dx


@kernel
def _curve_points(g: Tables, row: int, t: Floats, out: Floats) -> None:
    scratch = np.empty((2, MAX_DEGREE + 2))
    for i in range(len(t)):
        curve_point(g, row, t[i], scratch, out[i])


def evaluate_curve(geometry: GeometryBatch, row: int, t: Floats) -> tuple[Floats, Floats]:
    """Points and first derivatives of the curve in ``row`` at parameters ``t`` (n,).

    Returns:
        (n, dim) points and (n, dim) derivatives; dim is 2 for p-curves, 3 otherwise.
    """
    t = np.ascontiguousarray(t, dtype=np.float64)
    out = np.zeros((len(t), 6))
    _curve_points(tables(geometry), row, t, out)
    dim = int(geometry.curves[row]["dim"])
    return out[:, :dim].copy(), out[:, 3 : 3 + dim].copy()
