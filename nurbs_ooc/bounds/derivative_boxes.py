"""Boxes that hold the derivatives of a Bézier patch up to the third, polynomial or rational.

All derivatives are with respect to parameters that run from 0 to 1 over the patch. That of order (i, j) is
in row ``order(i, j)`` of a box table (see ``intervals``): S, S_u, S_v, S_uu, S_uv, S_vv, S_uuu and so on.

A derivative of a polynomial patch is a patch of differences, and lies in the box of its control points. Of
S = A / w they follow one after the other from A = w S::

    S_ij = (A_ij - sum over (k, l) != (0, 0) of C(i, k) C(j, l) w_kl S_(i-k)(j-l)) / w

Source: L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, eq. 3.7 and 4.20.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.intervals import over, times
from nurbs_ooc.geometry.tables import MAX_DEGREE

Floats = npt.NDArray[np.float64]

# Rows of a table of all derivatives, and its columns: x, y, z and the weight.
ORDERS = 10
WIDTH = 8
# Numbers of one component of the largest net, one degree higher each way.
COMPONENT = (MAX_DEGREE + 2) * (MAX_DEGREE + 2)
# Which control points count: all, or those of one side of the patch.
ALL, FIRST_U, LAST_U, FIRST_V, LAST_V = 0, 1, 2, 3, 4


@leaf
def order(i: int, j: int) -> int:
    """The row of the derivative i times along u, j times along v."""
    n = i + j
    return n * (n + 1) // 2 + j


@leaf
def choose(n: int, k: int) -> float:
    """Binomial coefficient, n <= 3."""
    return 1.0 if k == 0 or k == n else float(n)


@leaf
def _range_of(net: Floats, rows: int, columns: int, side: int, out: Floats, k: int, at: int) -> None:
    """Least and largest of a net's numbers, on one side or all, to ``out[k, at : at + 2]``."""
    r0, r1, c0, c1 = 0, rows, 0, columns
    if side == FIRST_U:
        r1 = 1
    elif side == LAST_U:
        r0 = rows - 1
    elif side == FIRST_V:
        c1 = 1
    elif side == LAST_V:
        c0 = columns - 1
    low, high = math.inf, -math.inf
    for r in range(r0, r1):
        for c in range(c0, c1):
            x = net[r * columns + c]
            low, high = min(low, x), max(high, x)
    out[k, at], out[k, at + 1] = low, high


@leaf
def component_boxes(net: Floats, p: int, q: int, side: int, out: Floats, at: int) -> None:
    """Ranges of all derivatives of one component of a net (p + 1, q + 1, flat) to columns ``at`` and ``at + 1``."""
    along = local_line(COMPONENT)
    across = local_line(COMPONENT)
    for m in range((p + 1) * (q + 1)):
        along[m] = net[m]
    for i in range(4):
        rows = p + 1 - i
        for m in range(rows * (q + 1)):
            across[m] = along[m]
        for j in range(4 - i):
            columns = q + 1 - j
            k = order(i, j)
            if rows <= 0 or columns <= 0:
                out[k, at], out[k, at + 1] = 0.0, 0.0
                continue
            _range_of(across, rows, columns, side, out, k, at)
            for r in range(rows):
                for c in range(columns - 1):
                    from_ = r * columns + c
                    across[r * (columns - 1) + c] = (q - j) * (across[from_ + 1] - across[from_])
        for m in range((rows - 1) * (q + 1)):
            along[m] = (p - i) * (along[m + q + 1] - along[m])


@leaf
def divide_by_weight(out: Floats) -> bool:
    """Turn derivatives of (A, w) into those of A / w in place; row 0 holds A / w already. False if w may be 0."""
    w0, w1 = out[0, 6], out[0, 7]
    if not w0 > 0.0:
        return False
    for n in range(1, 4):
        for j in range(n + 1):
            i = n - j
            row = order(i, j)
            for c in range(0, 6, 2):
                low, high = out[row, c], out[row, c + 1]
                for k in range(i + 1):
                    for m in range(j + 1):
                        if k + m > 0:
                            w, r = order(k, m), order(i - k, j - m)
                            x, y = times(out[w, 6], out[w, 7], out[r, c], out[r, c + 1])
                            factor = choose(i, k) * choose(j, m)
                            low, high = low - factor * y, high - factor * x
                out[row, c], out[row, c + 1] = over(low, high, w0, w1)
    return True


@leaf
def rescale(x: float, y: float, out: Floats, columns: int) -> None:
    """Derivatives with respect to parameters that run from 0 to 1 over x by y patches of this size."""
    for n in range(1, 4):
        for j in range(n + 1):
            factor = x ** (n - j) * y**j
            for c in range(columns):
                out[order(n - j, j), c] *= factor


@leaf
def restrict(net: Floats, at: int, step: int, degree: int, low: float, high: float) -> None:
    """Cut a Bézier polygon, points at ``at + i step``, to the part [low, high] of its interval [0, 1], in place."""
    for r in range(1, degree + 1):
        for i in range(degree, r - 1, -1):
            net[at + i * step] = (1.0 - high) * net[at + (i - 1) * step] + high * net[at + i * step]
    t = low / high
    for r in range(1, degree + 1):
        for i in range(degree - r + 1):
            net[at + i * step] = (1.0 - t) * net[at + i * step] + t * net[at + (i + 1) * step]
