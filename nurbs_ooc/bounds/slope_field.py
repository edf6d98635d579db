r"""Boxes of the normal's slopes over a part of a surface, from boxes of the surface's derivatives.

In a frame whose third axis is near the normals around, a normal N = S_u x S_v has the slopes
s = (N_1, N_2) / N_3: where its line through the origin meets the plane one step along that axis.
The length of N, and with it the parametrisation, has dropped out; directions differ by no more than slopes,
for the map from the plane back to the unit sphere shortens all ways.

At a pole one side of the patch is a point c, all derivatives along it vanish and N = 0. There S = c + r R
with r linear and zero at the pole, and the direction of N is that of X x Y, which is not zero::

    pole at an end of v:  X = R_u            Y = r R_v + r' R
    pole at an end of u:  X = r R_u + r' R   Y = R_v
    elsewhere:            X = R_u            Y = R_v          R = S - c for any c

Rows of tables are those of ``derivative_boxes.order``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.derivative_boxes import choose, order
from nurbs_ooc.bounds.intervals import add_cross, add_scaled, over, set_zero, times

Floats = npt.NDArray[np.float64]

# Sides on which a pole may lie.
NO_POLE, POLE_U, POLE_V = 0, 1, 2
# Rows of a table of second derivatives and below.
SECONDS = 6


@leaf
def _factor(r: Floats, pole: int, along_u: bool, low: float, high: float, slope: float, out: Floats) -> None:
    """X, or with ``along_u`` False Y, and their derivatives, to ``out`` (SECONDS, 6)."""
    divided = pole == (POLE_U if along_u else POLE_V)
    for n in range(3):
        for j in range(n + 1):
            i = n - j
            k = order(i, j)
            set_zero(out, k)
            derived = order(i + 1, j) if along_u else order(i, j + 1)
            if not divided:
                add_scaled(1.0, 1.0, r, derived, out, k)
            else:
                steps = slope * ((i if along_u else j) + 1)
                add_scaled(low, high, r, derived, out, k)
                add_scaled(steps, steps, r, k, out, k)


@leaf
def normal_boxes(
    r: Floats, pole: int, low: float, high: float, slope: float, x: Floats, y: Floats, out: Floats
) -> None:
    """Boxes of N = X x Y and its derivatives to ``out`` (SECONDS, 6), those of X and Y to ``x`` and ``y``.

    Args:
        r: derivatives of R.
        pole: which side is a pole.
        low, high: range of the linear factor, >= 0.
        slope: its derivative.
        x, y, out: (SECONDS, 6).
    """
    _factor(r, pole, True, low, high, slope, x)
    _factor(r, pole, False, low, high, slope, y)
    for n in range(3):
        for j in range(n + 1):
            i = n - j
            k = order(i, j)
            set_zero(out, k)
            for a in range(i + 1):
                for b in range(j + 1):
                    add_cross(choose(i, a) * choose(j, b), x, order(a, b), y, order(i - a, j - b), out, k)


@leaf
def turn_up(n: Floats) -> None:
    """Reverse the normals in ``n`` if they point down."""
    if n[0, 5] < 0.0:
        for k in range(SECONDS):
            for c in range(0, 6, 2):
                n[k, c], n[k, c + 1] = -n[k, c + 1], -n[k, c]


@leaf
def slope_boxes(n: Floats, out: Floats) -> bool:
    """Boxes of s = (N_1, N_2) / N_3 and its derivatives to ``out`` (SECONDS, 4); False if N_3 may be 0 or less."""
    low, high = n[0, 4], n[0, 5]
    if not low > 0.0:
        return False
    for m in range(3):
        for j in range(m + 1):
            i = m - j
            k = order(i, j)
            for c in range(0, 4, 2):
                a, b = n[k, c], n[k, c + 1]
                for e in range(i + 1):
                    for f in range(j + 1):
                        if e + f > 0:
                            w, s = order(e, f), order(i - e, j - f)
                            p, q = times(n[w, 4], n[w, 5], out[s, c], out[s, c + 1])
                            times_so_often = choose(i, e) * choose(j, f)
                            a, b = a - times_so_often * q, b - times_so_often * p
                out[k, c], out[k, c + 1] = over(a, b, low, high)
    return True


@leaf
def no_slopes(out: Floats) -> None:
    """The boxes of nothing, to be united with others."""
    for k in range(SECONDS):
        for c in range(0, 4, 2):
            out[k, c], out[k, c + 1] = np.inf, -np.inf


@leaf
def unite_slopes(s: Floats, skip_uu: bool, skip_vv: bool, out: Floats) -> None:
    """Grow ``out`` so that it holds ``s``, but for pure second derivatives that are charged otherwise."""
    for k in range(SECONDS):
        if (k == 3 and skip_uu) or (k == 5 and skip_vv):
            continue
        for c in range(0, 4, 2):
            out[k, c] = min(out[k, c], s[k, c])
            out[k, c + 1] = max(out[k, c + 1], s[k, c + 1])


@leaf
def largest_slope(field: Floats, k: int) -> float:
    """Largest norm of a vector in box ``k`` of ``field``."""
    x = max(-field[k, 0], field[k, 1], 0.0)
    y = max(-field[k, 2], field[k, 3], 0.0)
    return math.sqrt(x * x + y * y)
