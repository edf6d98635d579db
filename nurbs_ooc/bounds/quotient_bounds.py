"""Bounds of derivatives of a rational Bézier net that lose little to triangle inequalities: by quotients of nets.

Let S = P / w. Since (f / w^k)' = (f' w - k f w') / w^(k + 1), every second derivative is E / w^3 with a polynomial
E, found in two such steps. With E and w^3 written in one Bernstein basis, coefficients e_i and c_i > 0 ::

    E / w^3 = sum_i B_i c_i (e_i / c_i) / sum_i B_i c_i

is a mean of the vectors e_i / c_i, so it lies in their box and is no longer than the longest of them. On a quarter
circle that is 1.21 of the truth, where bounding numerator and denominator each for itself gives 2.56.

Coefficients are kept times their binomials: then products are convolutions, the constant 1 of degree one is 1, 1
(to raise a degree is to add neighbours), and with x = t / (1 - t), f of degree n, w of degree m ::

    f' w - k f w'  =  (1 - t)^(n + m - 1)  sum_ij f_i w_j ((i - k j) x^(i + j - 1) + (i - k j - (n - k m)) x^(i + j))

where for n = k m both terms are equal, and the degree is one less than it seems. Weights that are the same all along
a direction have degree 0 in it, exactly.

Source: T. W. Sederberg, X. Wang, "Rational hodographs", Computer Aided Geometric Design 4, 1987 (the first step of
a curve); the rest is shown above.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line

Floats = npt.NDArray[np.float64]

# Nets of higher degree are left to the quotient rule: the work grows with the fourth power.
HIGHEST = 5
# Of weights that are no products it grows with the sixth.
HIGHEST_MIXED = 2
# Coefficients of a net, and of the largest numerator or denominator, of degree 3 HIGHEST each way; vectors have three.
NET = (HIGHEST + 1) * (HIGHEST + 1)
NET_VECTORS = 3 * NET
LARGEST = (3 * HIGHEST + 1) * (3 * HIGHEST + 1)
LARGEST_VECTORS = 3 * LARGEST
# Coefficients of one direction.
LINE = 3 * HIGHEST + 1
# What roundings of a quotient may take, in units of p^4 (largest / smallest weight)^3 radius. In such units the sum of
# magnitudes of a numerator's terms is below 12; each has fewer than 32 roundings.
ROUNDOFF = 2.0**-43
# The same of the net's own points, by their distance from the origin: each is a mean of others with 8 roundings.
NET_ROUNDOFF = 2.0**-46
# Weights that are products but for this part of them are taken for products: two of each numerator's factors and
# three or four of its denominator change by as much, which is 24 roundings more.
SAME_WEIGHT = 2.0**-51


@leaf
def _product(a: Floats, rows_a: int, columns_a: int, b: Floats, rows_b: int, columns_b: int, out: Floats) -> None:
    """The product of two tables of coefficients."""
    width = columns_a + columns_b - 1
    for m in range((rows_a + rows_b - 1) * width):
        out[m] = 0.0
    for i in range(rows_a):
        for j in range(rows_b):
            for k in range(columns_a):
                x = a[i * columns_a + k]
                to = (i + j) * width + k
                for m in range(columns_b):
                    out[to + m] += x * b[j * columns_b + m]


@leaf
def _numerator(
    f: Floats, rows: int, columns: int, w: Floats, w_rows: int, w_columns: int, k: int, along_u: bool, out: Floats
) -> tuple[int, int]:
    """Coefficients of f' w - k f w' (see the module) to ``out``: how many rows and columns of vectors; 0: it is 0."""
    n, m = (rows - 1, w_rows - 1) if along_u else (columns - 1, w_columns - 1)
    gap = n - k * m
    fewer = 2 if gap == 0 else 1
    out_rows, out_columns = rows + w_rows - 1, columns + w_columns - 1
    if rows <= 0 or columns <= 0:
        return 0, 0
    if along_u:
        out_rows = n + m - fewer + 1
    else:
        out_columns = n + m - fewer + 1
    if out_rows <= 0 or out_columns <= 0:
        return 0, 0
    for i in range(3 * out_rows * out_columns):
        out[i] = 0.0
    width = 3 * out_columns
    back = width if along_u else 3
    for i in range(rows):
        for j in range(w_rows):
            for a in range(columns):
                at = 3 * (i * columns + a)
                x, y, z = f[at], f[at + 1], f[at + 2]
                for b in range(w_columns):
                    share = i - k * j if along_u else a - k * b
                    to = (i + j) * width + 3 * (a + b)
                    c = share * w[j * w_columns + b]
                    if share != 0:
                        out[to - back] += c * x
                        out[to - back + 1] += c * y
                        out[to - back + 2] += c * z
                    if gap != 0 and share != gap:
                        c -= gap * w[j * w_columns + b]
                        out[to] += c * x
                        out[to + 1] += c * y
                        out[to + 2] += c * z
    return out_rows, out_columns


@leaf
def _raise(e: Floats, rows: int, columns: int, to_rows: int, to_columns: int, out: Floats) -> None:
    """Coefficients of vectors in a basis of higher degrees, to ``out``."""
    for i in range(3 * to_rows * to_columns):
        out[i] = 0.0
    width = 3 * to_columns
    for i in range(rows):
        for m in range(3 * columns):
            out[i * width + m] = e[i * 3 * columns + m]
        for _ in range(to_columns - columns):
            for m in range(width - 1, 2, -1):
                out[i * width + m] += out[i * width + m - 3]
    for _ in range(to_rows - rows):
        for m in range(to_rows * width - 1, width - 1, -1):
            out[m] += out[m - width]


@leaf
def _hull(e: Floats, rows: int, columns: int, c: Floats, c_rows: int, c_columns: int, box: Floats) -> float:
    """Bound of |E / C| from vectors e and numbers c > 0, with a box of E / C to ``box`` (6,); 0 without rows.

    Along a direction C has one coefficient, or no lower degree than E.
    """
    for k in range(3):
        box[k], box[3 + k] = (np.inf, -np.inf) if rows > 0 else (0.0, 0.0)
    if rows <= 0:
        return 0.0
    largest = 0.0
    to_rows, to_columns = max(rows, c_rows), max(columns, c_columns)
    raised = local_line(LARGEST_VECTORS)
    _raise(e, rows, columns, to_rows, to_columns, raised)
    choose_u = 1.0
    for i in range(to_rows):
        choose = choose_u
        for j in range(to_columns):
            at = 3 * (i * to_columns + j)
            share = 1.0 / (choose * c[(i if c_rows > 1 else 0) * c_columns + (j if c_columns > 1 else 0)])
            x, y, z = share * raised[at], share * raised[at + 1], share * raised[at + 2]
            largest = max(largest, x * x + y * y + z * z)
            box[0], box[1], box[2] = min(box[0], x), min(box[1], y), min(box[2], z)
            box[3], box[4], box[5] = max(box[3], x), max(box[4], y), max(box[5], z)
            if c_columns == 1:
                # The binomials of E's own degree, which one coefficient of C does not hold.
                choose *= (to_columns - 1.0 - j) / (j + 1.0)
        if c_rows == 1:
            choose_u *= (to_rows - 1.0 - i) / (i + 1.0)
    return math.sqrt(largest)


@leaf
def _apart(net: Floats, p: int, q: int) -> bool:
    """Whether the weights of a flat homogeneous net are products of numbers by row and by column, but for roundoff."""
    for i in range(1, p + 1):
        for j in range(1, q + 1):
            at = 4 * (i * (q + 1) + j) + 3
            product = net[4 * i * (q + 1) + 3] * net[4 * j + 3] / net[3]
            if abs(net[at] - product) > SAME_WEIGHT * net[at]:
                return False
    return True


@leaf
def pays(net: Floats, p: int, q: int) -> bool:
    """Whether ``quotient_bounds`` of a flat homogeneous net costs little beside the triangles that it may save."""
    most = max(p, q)
    return most <= HIGHEST_MIXED or (most <= HIGHEST and _apart(net, p, q))


@leaf
def _factor(net: Floats, n: int, step: int, first: float, out: Floats) -> int:
    """Weights of n points ``step`` numbers apart, over ``first`` and times their binomials, to ``out``; how many.

    One does for all if they are the same.
    """
    same = True
    choose = 1.0
    for i in range(n):
        out[i] = choose * (net[step * i + 3] / first)
        choose *= (n - 1.0 - i) / (i + 1.0)
        same = same and net[step * i + 3] == net[3]
    return 1 if same else n


@leaf
def _scaled(net: Floats, p: int, q: int, center: Floats, f: Floats, w: Floats) -> float:
    """Coefficients of P - ``center`` w and of w of a flat homogeneous net, times their binomials, to ``f`` and ``w``.

    Returns what roundoff of a second derivative over a box of size 1 may be.
    """
    low, high = net[3], net[3]
    reach, far = 0.0, 0.0
    choose_u = 1.0
    for i in range(p + 1):
        choose = choose_u
        for j in range(q + 1):
            at = i * (q + 1) + j
            weight = net[4 * at + 3]
            low, high = min(low, weight), max(high, weight)
            near, size = 0.0, 0.0
            for k in range(3):
                x = net[4 * at + k] - center[k] * weight
                f[3 * at + k] = choose * x
                near += x * x
                size += net[4 * at + k] * net[4 * at + k]
            reach, far = max(reach, near), max(far, size)
            w[at] = choose * weight
            choose *= (q - j) / (j + 1.0)
        choose_u *= (p - i) / (i + 1.0)
    spread, degree = high / low, float(max(p, q))
    return degree**4 * spread**3 * (ROUNDOFF * math.sqrt(reach) + NET_ROUNDOFF * math.sqrt(far)) / low


@leaf
def _over_product(
    f: Floats, p: int, q: int, a: Floats, n: int, b: Floats, m: int, first: bool, norms: Floats, boxes: Floats
) -> None:
    """Bounds for weights that are products of ``a`` (n,) by row and ``b`` (m,) by column, over a box of size 1.

    Then a derivative along u sees ``a`` alone: S_uu = E / (a^3 b), S_uv = E / (a^2 b^2), S_vv = E / (a b^3).
    """
    a2, a3, b2, b3 = local_line(LINE), local_line(LINE), local_line(LINE), local_line(LINE)
    _product(a, n, 1, a, n, 1, a2)
    _product(a2, 2 * n - 1, 1, a, n, 1, a3)
    _product(b, 1, m, b, 1, m, b2)
    _product(b2, 1, 2 * m - 1, b, 1, m, b3)
    e, e2, c = local_line(LARGEST_VECTORS), local_line(LARGEST_VECTORS), local_line(LARGEST)
    rows, columns = _numerator(f, p + 1, q + 1, a, n, 1, 1, True, e)
    if first:
        _product(a2, 2 * n - 1, 1, b, 1, m, c)
        norms[0] = _hull(e, rows, columns, c, 2 * n - 1, m, boxes[0:6])
    i, j = _numerator(e, rows, columns, a, n, 1, 2, True, e2)
    _product(a3, 3 * n - 2, 1, b, 1, m, c)
    norms[2] = _hull(e2, i, j, c, 3 * n - 2, m, boxes[0:6])
    i, j = _numerator(e, rows, columns, b, 1, m, 1, False, e2)
    _product(a2, 2 * n - 1, 1, b2, 1, 2 * m - 1, c)
    norms[3] = _hull(e2, i, j, c, 2 * n - 1, 2 * m - 1, boxes[6:12])
    rows, columns = _numerator(f, p + 1, q + 1, b, 1, m, 1, False, e)
    if first:
        _product(a, n, 1, b2, 1, 2 * m - 1, c)
        norms[1] = _hull(e, rows, columns, c, n, 2 * m - 1, boxes[12:18])
    i, j = _numerator(e, rows, columns, b, 1, m, 2, False, e2)
    _product(a, n, 1, b3, 1, 3 * m - 2, c)
    norms[4] = _hull(e2, i, j, c, n, 3 * m - 2, boxes[12:18])


@leaf
def _over_weights(f: Floats, p: int, q: int, w: Floats, first: bool, norms: Floats, boxes: Floats) -> None:
    """The same for any weights ``w``, of which every second derivative has the third power below it."""
    w2, w3 = local_line(LARGEST), local_line(LARGEST)
    _product(w, p + 1, q + 1, w, p + 1, q + 1, w2)
    _product(w2, 2 * p + 1, 2 * q + 1, w, p + 1, q + 1, w3)
    e, e2 = local_line(LARGEST_VECTORS), local_line(LARGEST_VECTORS)
    rows, columns = _numerator(f, p + 1, q + 1, w, p + 1, q + 1, 1, True, e)
    if first:
        norms[0] = _hull(e, rows, columns, w2, 2 * p + 1, 2 * q + 1, boxes[0:6])
    i, j = _numerator(e, rows, columns, w, p + 1, q + 1, 2, True, e2)
    norms[2] = _hull(e2, i, j, w3, 3 * p + 1, 3 * q + 1, boxes[0:6])
    i, j = _numerator(e, rows, columns, w, p + 1, q + 1, 2, False, e2)
    norms[3] = _hull(e2, i, j, w3, 3 * p + 1, 3 * q + 1, boxes[6:12])
    rows, columns = _numerator(f, p + 1, q + 1, w, p + 1, q + 1, 1, False, e)
    if first:
        norms[1] = _hull(e, rows, columns, w2, 2 * p + 1, 2 * q + 1, boxes[12:18])
    i, j = _numerator(e, rows, columns, w, p + 1, q + 1, 2, False, e2)
    norms[4] = _hull(e2, i, j, w3, 3 * p + 1, 3 * q + 1, boxes[12:18])


@leaf
def quotient_bounds(
    net: Floats, p: int, q: int, h_u: float, h_v: float, center: Floats, first: bool, norms: Floats, boxes: Floats
) -> None:
    """Bounds of a flat rational net (p + 1, q + 1, 4) of degrees up to ``HIGHEST`` over a box of size h_u x h_v.

    |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv| go to ``norms`` (5,), the boxes of the last three to ``boxes`` (18,).
    Without ``first`` the first two mean nothing. ``center`` (3,) is a point in the middle of the net. A curve is a
    net with q = 0.
    """
    f, w = local_line(NET_VECTORS), local_line(NET)
    norms[0], norms[1] = 0.0, 0.0
    rounding = _scaled(net, p, q, center, f, w)
    if _apart(net, p, q):
        a, b = local_line(LINE), local_line(LINE)
        n, m = _factor(net, p + 1, 4 * (q + 1), net[3], a), _factor(net, q + 1, 4, 1.0, b)
        _over_product(f, p, q, a, n, b, m, first, norms, boxes)
    else:
        _over_weights(f, p, q, w, first, norms, boxes)
    norms[0], norms[1] = (norms[0] + rounding) / h_u, (norms[1] + rounding) / h_v
    for k in range(3):
        scale = 1.0 / ((h_u if k < 2 else h_v) * (h_u if k == 0 else h_v))
        norms[2 + k] = (norms[2 + k] + rounding) * scale
        for m in range(6 * k, 6 * k + 3):
            boxes[m], boxes[3 + m] = (boxes[m] - rounding) * scale, (boxes[3 + m] + rounding) * scale
