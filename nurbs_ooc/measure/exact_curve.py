"""Points and tangents of recorded curves straight from the textbook, for judging what other code made of them.

Nothing here is shared with the tessellator: B-splines are summed from the Cox-de Boor basis, not from
Bezier pieces, so that a mistake in one way of evaluating cannot hide in the other.

Source: L. Piegl and W. Tiller, The NURBS Book, 2nd edition, 1997: algorithms A2.1 (span), A2.2 (basis),
equation 2.7 (derivative of a basis function), A4.1 (rational curve point).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import CurveKind, GeometryBatch

_ELLIPSE = int(CurveKind.ELLIPSE)
_HYPERBOLA = int(CurveKind.HYPERBOLA)
MAX_DEGREE = 64  # of any curve or surface; the scratch arrays of the kernels are this long


@leaf
def find_span(values, first, n, degree, t) -> int:  # type: ignore[no-untyped-def]
    """Index i of the non-empty span U[i] <= t < U[i+1]; the end spans take all that lies beyond them."""
    if t >= values[first + n]:
        i = n - 1
        while i > degree and values[first + i] >= values[first + n]:
            i -= 1
        return i
    low, high = degree, n
    while high - low > 1:
        middle = (low + high) // 2
        if t < values[first + middle]:
            high = middle
        else:
            low = middle
    while low < n - 1 and values[first + low + 1] <= values[first + low]:
        low += 1
    return low


@leaf
def basis(values, first, span, degree, t, out) -> None:  # type: ignore[no-untyped-def]
    """Fill ``out[0, :p+1]`` with the basis functions that live on the span and ``out[1]`` with their derivatives."""
    out[0, 0] = 1.0
    out[1, 0] = 0.0
    for j in range(1, degree + 1):
        # Keep the functions of degree p - 1: the derivatives are made of them.
        if j == degree:
            for r in range(degree):
                out[1, r] = out[0, r]
        saved = 0.0
        for r in range(j):
            right = values[first + span + r + 1]
            left = values[first + span + 1 - j + r]
            part = out[0, r] / (right - left)
            out[0, r] = saved + (right - t) * part
            saved = (t - left) * part
        out[0, j] = saved
    if degree > 0:
        before = 0.0
        for k in range(degree + 1):
            after = 0.0
            if k < degree:
                after = out[1, k] / (values[first + span + k + 1] - values[first + span - degree + k + 1])
            out[1, k] = degree * (before - after)
            before = after


@leaf
def curve_point(values, curve, t, scratch, out) -> None:  # type: ignore[no-untyped-def]
    """``out[0, :dim]`` is the point and ``out[1, :dim]`` the derivative of one curve record at ``t``."""
    dim, p0 = curve.dim, curve.points
    if curve.kind == _ELLIPSE or curve.kind == _HYPERBOLA:
        if curve.kind == _ELLIPSE:
            c, s, dc, ds = math.cos(t), math.sin(t), -math.sin(t), math.cos(t)
        else:
            c, s, dc, ds = math.cosh(t), math.sinh(t), math.sinh(t), math.cosh(t)
        for k in range(dim):
            a, b = values[p0 + dim + k], values[p0 + 2 * dim + k]
            out[0, k] = values[p0 + k] + c * a + s * b
            out[1, k] = dc * a + ds * b
        return
    degree = curve.degree
    span = find_span(values, curve.knots, curve.n, degree, t)
    basis(values, curve.knots, span, degree, t, scratch)
    width = dim + (1 if curve.rational else 0)
    for k in range(dim):
        out[0, k] = 0.0
        out[1, k] = 0.0
    w, dw = 0.0, 0.0
    for i in range(degree + 1):
        row = p0 + (span - degree + i) * width
        for k in range(dim):
            out[0, k] += scratch[0, i] * values[row + k]
            out[1, k] += scratch[1, i] * values[row + k]
        if curve.rational:
            w += scratch[0, i] * values[row + dim]
            dw += scratch[1, i] * values[row + dim]
    if curve.rational:
        for k in range(dim):
            out[0, k] /= w
            out[1, k] = (out[1, k] - dw * out[0, k]) / w


@kernel
def _curve_points(curves, values, rows, parameters, out):  # type: ignore[no-untyped-def]
    scratch = np.empty((2, MAX_DEGREE + 1))
    for i in range(len(rows)):
        curve_point(values, curves[rows[i]], parameters[i], scratch, out[i])


def evaluate_curves(
    geometry: GeometryBatch, rows: npt.ArrayLike, parameters: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Points and first derivatives of many curves.

    Args:
        geometry: holds the curves.
        rows: (n,) rows of ``geometry.curves``.
        parameters: (n,) one parameter each.

    Returns:
        Two (n, 3) float64 arrays; the third column of 2D curves is 0.
    """
    at = np.ascontiguousarray(np.broadcast_to(np.asarray(rows, np.int64), np.shape(parameters)))
    out = np.zeros((len(at), 2, 3))
    _curve_points(geometry.curves, geometry.values, at, np.asarray(parameters, float), out)
    return out[:, 0], out[:, 1]
