"""Rational surfaces and curves in mpmath, 60 digits: de Boor's recurrence and the quotient rule, nothing shared."""

from __future__ import annotations

from collections.abc import Sequence

import mpmath as mp
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
DIGITS = 60


def _basis(knots: Sequence[float], degree: int, t: mp.mpf, order: int, from_left: bool) -> list[mp.mpf]:
    """Derivatives of all basis functions at ``t``; at a knot those of the span before it, if ``from_left``."""
    u = [mp.mpf(float(k)) for k in knots]
    n = len(u) - degree - 1

    def value(i: int, p: int, k: int) -> mp.mpf:
        if k > 0:
            low, high = u[i + p] - u[i], u[i + p + 1] - u[i + 1]
            first = value(i, p - 1, k - 1) / low if low else mp.mpf(0)
            second = value(i + 1, p - 1, k - 1) / high if high else mp.mpf(0)
            return p * (first - second)
        if p == 0:
            inside = u[i] < t <= u[i + 1] if from_left else u[i] <= t < u[i + 1]
            return mp.mpf(1) if inside else mp.mpf(0)
        low, high = u[i + p] - u[i], u[i + p + 1] - u[i + 1]
        first = (t - u[i]) / low * value(i, p - 1, 0) if low else mp.mpf(0)
        second = (u[i + p + 1] - t) / high * value(i + 1, p - 1, 0) if high else mp.mpf(0)
        return first + second

    return [value(i, degree, order) for i in range(n)]


def surface_derivatives(
    degrees: tuple[int, int], knots: tuple[Array, Array], net: Array, u: float, v: float, from_left: bool = False
) -> Array:
    """(5, 3) S_u, S_v, S_uu, S_uv, S_vv of the homogeneous net (n_u, n_v, 4); ``from_left``: of the span before u."""
    with mp.workdps(DIGITS):
        in_u = [_basis(knots[0], degrees[0], mp.mpf(u), k, from_left) for k in range(3)]
        in_v = [_basis(knots[1], degrees[1], mp.mpf(v), k, False) for k in range(3)]

        def at(i: int, j: int) -> list[mp.mpf]:
            total = [mp.mpf(0)] * 4
            for a, x in enumerate(in_u[i]):
                for b, y in enumerate(in_v[j]):
                    if x and y:
                        total = [t + x * y * mp.mpf(float(c)) for t, c in zip(total, net[a, b], strict=True)]
            return total

        h, hu, hv, huu, huv, hvv = at(0, 0), at(1, 0), at(0, 1), at(2, 0), at(1, 1), at(0, 2)
        w = h[3]
        out = []
        for k in range(3):
            s = h[k] / w
            su, sv = (hu[k] - hu[3] * s) / w, (hv[k] - hv[3] * s) / w
            suu = (huu[k] - 2 * hu[3] * su - huu[3] * s) / w
            suv = (huv[k] - hu[3] * sv - hv[3] * su - huv[3] * s) / w
            svv = (hvv[k] - 2 * hv[3] * sv - hvv[3] * s) / w
            out.append([float(x) for x in (su, sv, suu, suv, svv)])
    return np.array(out).T
