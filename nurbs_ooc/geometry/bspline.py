"""B-spline basis: spans, values and first derivatives, and the Bézier net of a part of a span.

Knot vectors are clamped and non-decreasing, ``values[knots : knots + n + degree + 1]``.

Source: L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, eq. 2.5 and 2.7 (basis and derivative);
L. Ramshaw, "Blossoming: a connect-the-dots approach to splines", 1987 (Bézier points as blossoms).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf

Floats = npt.NDArray[np.float64]


@leaf
def find_span(values: Floats, knots: int, n: int, degree: int, t: float) -> int:
    """The i in [degree, n - 1] with U[i] <= t < U[i + 1], clamped to the ends and never an empty span."""
    low = degree
    high = n
    while high - low > 1:
        middle = (low + high) // 2
        if values[knots + middle] <= t:
            low = middle
        else:
            high = middle
    while low > degree and values[knots + low] == values[knots + low + 1]:
        low -= 1
    while low < n - 1 and values[knots + low] == values[knots + low + 1]:
        low += 1
    return low


@leaf
def basis(values: Floats, knots: int, span: int, degree: int, t: float, out: Floats, slope: Floats) -> None:
    """Write the degree + 1 non-zero basis functions at ``t`` to ``out`` and their derivatives to ``slope``."""
    out[0] = 1.0
    for k in range(degree + 1):
        slope[k] = 0.0
    for d in range(1, degree + 1):
        if d == degree:
            # Differentiate while the functions of one degree less are at hand (eq. 2.7).
            for k in range(degree + 1):
                i = knots + span - degree + k
                if k > 0:
                    gap = values[i + degree] - values[i]
                    if gap > 0.0:
                        slope[k] += degree * out[k - 1] / gap
                if k < degree:
                    gap = values[i + degree + 1] - values[i + 1]
                    if gap > 0.0:
                        slope[k] -= degree * out[k] / gap
        saved = 0.0
        for r in range(d):
            right = values[knots + span + r + 1] - t
            left = t - values[knots + span + 1 - d + r]
            gap = right + left
            part = out[r] / gap if gap > 0.0 else 0.0
            out[r] = saved + right * part
            saved = left * part
        out[d] = saved


@leaf
def blossom(
    values: Floats, knots: int, span: int, degree: int, points: Floats, a: float, b: float, n_b: int, out: Floats
) -> None:
    """The polar form of the span's polynomial at (degree - n_b) times ``a`` and ``n_b`` times ``b``.

    ``points`` (degree + 1, dim) are the span's control points and are overwritten; ``out`` is (dim,).
    """
    dim = points.shape[1]
    for r in range(1, degree + 1):
        t = b if r <= n_b else a
        for j in range(degree, r - 1, -1):
            low = values[knots + span - degree + j]
            high = values[knots + span + 1 + j - r]
            w = (t - low) / (high - low)
            for k in range(dim):
                points[j, k] = (1.0 - w) * points[j - 1, k] + w * points[j, k]
    for k in range(dim):
        out[k] = points[degree, k]
