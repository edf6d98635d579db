"""B-spline basis: spans, values and first derivatives, and the Bézier net of a part of a span.

Knot vectors are clamped and non-decreasing, ``values[knots : knots + n + degree + 1]``.

Source: L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, eq. 2.5 and 2.7 (basis and derivative);
L. Ramshaw, "Blossoming: a connect-the-dots approach to splines", 1987 (Bézier points as blossoms).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line

Floats = npt.NDArray[np.float64]

MAX_DEGREE = 30  # scratch arrays are sized by it; the reader refuses more
INVERSES = MAX_DEGREE * (MAX_DEGREE + 1) // 2


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
    slope[0] = 0.0
    for d in range(1, degree + 1):
        saved = 0.0
        before = 0.0
        for r in range(d):
            high, low = values[knots + span + r + 1], values[knots + span + 1 - d + r]
            gap = high - low
            part = out[r] / gap if gap > 0.0 else 0.0
            out[r] = saved + (high - t) * part
            saved = (t - low) * part
            if d == degree:
                # The quotients of one degree less are those of the derivatives (eq. 2.7).
                slope[r] = degree * (before - part)
                before = part
        out[d] = saved
        if d == degree:
            slope[d] = degree * before


@leaf
def bezier_weights(values: Floats, knots: int, span: int, degree: int, a: float, b: float, out: Floats) -> None:
    """Rows ``out[k]`` (degree + 1): weights of the span's control points in the k-th Bézier point over [a, b].

    The k-th Bézier point is the polar form at (degree - k) times ``a`` and k times ``b``; its weights follow
    the recurrence of the basis functions with one of the arguments per level.
    """
    if values[knots + span + 1 - degree] == a and values[knots + span + degree] == b:
        # A Bézier piece already.
        for k in range(degree + 1):
            for i in range(degree + 1):
                out[k, i] = 1.0 if i == k else 0.0
        return
    inverse = local_line(INVERSES)
    n = 0
    for d in range(1, degree + 1):
        for r in range(d):
            inverse[n] = 1.0 / (values[knots + span + r + 1] - values[knots + span + 1 - d + r])
            n += 1
    for k in range(degree + 1):
        out[k, 0] = 1.0
        n = 0
        for d in range(1, degree + 1):
            t = b if d <= k else a
            saved = 0.0
            for r in range(d):
                part = out[k, r] * inverse[n]
                n += 1
                out[k, r] = saved + (values[knots + span + r + 1] - t) * part
                saved = (t - values[knots + span + 1 - d + r]) * part
            out[k, d] = saved
