"""Bounds of first and second derivatives of a Bézier net, polynomial or rational.

For a patch S of degrees p x q over a box of size h_u x h_v the derivatives are Bézier patches whose
control vectors are scaled differences of the net, so their largest norm bounds the derivative::

    |S_u|  <= p / h_u             max |d10 P|
    |S_uu| <= p (p - 1) / h_u^2   max |d20 P|
    |S_uv| <= p q / (h_u h_v)     max |d11 P|

A rational patch is measured from an affine map A of its parameters, through its corners in the mean:
T = S - A has the same second derivatives but is small, so the weights' change multiplies a small
radius r >= |T|, which also shrinks when the patch is long one way and curved the other. N = w T is a
polynomial patch of one degree more each way, and by the quotient rule ::

    |T_u|  <= (|N_u| + r |w_u|) / w_min                       |S_u| <= |T_u| + |A_u|
    |S_uu| <= (|N_uu| + 2 |w_u| |T_u| + r |w_uu|) / w_min
    |S_uv| <= (|N_uv| + |w_u| |T_v| + |w_v| |T_u| + r |w_uv|) / w_min

Each box of the second derivatives holds the vector at every point of the patch; of a rational one it is
that of N_uu / w, widened by the other terms. What follows for triangles: ``triangle_bound``.

Source: D. Filip, R. Magedson, R. Markot, "Surface algorithms using bounds on derivatives",
Computer Aided Geometric Design 3, 1986, theorem 1; for the triangle inside its parameter box see
docs/tessellation.md.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.quotient_bounds import pays, quotient_bounds
from nurbs_ooc.geometry.tables import MAX_DEGREE

Floats = npt.NDArray[np.float64]

# Rows of a bounds vector.
LU, LV, MUU, MUV, MVV = 0, 1, 2, 3, 4
# Numbers of the boxes of S_uu, S_uv and S_vv.
BOXES = 18

# Numbers of the largest homogeneous net, one degree higher each way.
LIFTED_SIZE = 4 * (MAX_DEGREE + 2) * (MAX_DEGREE + 2)

# Where triangle inequalities may have widened a rational patch's bounds by this share, its quotients are looked at.
PAYS = 0.1
# But not if weights are further apart: roundoff of the quotients grows with the third power of that.
WIDEST_SPREAD = 16.0

# Outward rounding: a bound is the end of a chain of fewer than 200 roundings.
OUTWARD = 1.0 + 2.0**-44


@leaf
def _subtract(values: Floats, n: int, step: int, out: Floats) -> None:
    """``out[m]`` = values[m + step] - values[m], m < n."""
    for m in range(n):
        out[m] = values[m + step] - values[m]


@leaf
def _largest(net: Floats, rows: int, columns: int, stride: int, dim: int, scale: float, out: Floats) -> None:
    """Largest norm of the spatial part and largest weight of rows x columns points of a flat net, times ``scale`` >= 0.

    They go to ``out`` (2,); a row begins ``stride`` numbers after the one before.
    """
    best = 0.0
    best_w = 0.0
    for i in range(rows):
        for at in range(i * stride, i * stride + columns * dim, dim):
            best = max(best, net[at] * net[at] + net[at + 1] * net[at + 1] + net[at + 2] * net[at + 2])
            if dim == 4:
                best_w = max(best_w, abs(net[at + 3]))
    out[0] = scale * math.sqrt(best)
    out[1] = scale * best_w


@leaf
def _box(net: Floats, rows: int, columns: int, stride: int, dim: int, scale: float, box: Floats) -> None:
    """The box of the spatial parts of the same points, to ``box`` (6,): three lows, three highs; 0 of none."""
    low_x, low_y, low_z = np.inf, np.inf, np.inf
    high_x, high_y, high_z = -np.inf, -np.inf, -np.inf
    for i in range(rows):
        for at in range(i * stride, i * stride + columns * dim, dim):
            x, y, z = net[at], net[at + 1], net[at + 2]
            low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
            high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    if rows <= 0 or columns <= 0:
        low_x, low_y, low_z, high_x, high_y, high_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    box[0], box[1], box[2] = scale * low_x, scale * low_y, scale * low_z
    box[3], box[4], box[5] = scale * high_x, scale * high_y, scale * high_z


@leaf
def _sizes(
    net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, first: bool, out: Floats, boxes: Floats
) -> None:
    """Bounds of the derivatives of a flat net to ``out`` (5, 2): of its spatial part and of its weights.

    ``boxes`` (BOXES,) gets the boxes of the second ones; without ``first`` those are all.
    """
    width = (q + 1) * dim
    once, twice = local_line(LIFTED_SIZE), local_line(LIFTED_SIZE)
    # Differences of all numbers alike; what they make of the ends of rows is not looked at.
    _subtract(net, p * width, width, once)
    if first:
        _largest(once, p, q + 1, width, dim, p / h_u, out[LU])
    _subtract(once, (p - 1) * width, width, twice)
    scale = p * (p - 1) / (h_u * h_u)
    _largest(twice, p - 1, q + 1, width, dim, scale, out[MUU])
    _box(twice, p - 1, q + 1, width, dim, scale, boxes[0:6])
    _subtract(net, (p + 1) * width - dim, dim, once)
    if first:
        _largest(once, p + 1, q, width, dim, q / h_v, out[LV])
    _subtract(once, p * width - dim, width, twice)
    scale = p * q / (h_u * h_v)
    _largest(twice, p, q, width, dim, scale, out[MUV])
    _box(twice, p, q, width, dim, scale, boxes[6:12])
    _subtract(once, (p + 1) * width - 2 * dim, dim, twice)
    scale = q * (q - 1) / (h_v * h_v)
    _largest(twice, p + 1, q - 1, width, dim, scale, out[MVV])
    _box(twice, p + 1, q - 1, width, dim, scale, boxes[12:18])


@leaf
def _divide(box: Floats, w_min: float, w_max: float, spread: float) -> None:
    """Divide a box (6,) by all numbers in [w_min, w_max], both > 0, and widen it by ``spread``."""
    for k in range(3):
        low, high = box[k], box[3 + k]
        box[k] = (low / w_min if low < 0.0 else low / w_max) - spread
        box[3 + k] = (high / w_min if high > 0.0 else high / w_max) + spread


@leaf
def affine_map(net: Floats, p: int, q: int, a: Floats) -> None:
    """Rows of ``a`` (3, 3): A at (0, 0), and its change over the box along u and along v."""
    for k in range(3):
        a[0, k], a[1, k], a[2, k] = 0.0, 0.0, 0.0
    for i in range(2):
        for j in range(2):
            at = (i * p * (q + 1) + j * q) * 4
            for k in range(3):
                x = net[at + k] / net[at + 3]
                a[1, k] += (i - 0.5) * x
                a[2, k] += (j - 0.5) * x
                a[0, k] += 0.25 * x
    for k in range(3):
        a[0, k] -= 0.5 * (a[1, k] + a[2, k])


@leaf
def less_affine(net: Floats, p: int, q: int, a: Floats, out: Floats) -> None:
    """The flat net of (w (S - A), w), of degrees (p + 1) x (q + 1): degree elevation with A taken off on the way."""
    a0, a1, a2 = a[0, 0], a[0, 1], a[0, 2]
    u0, u1, u2 = a[1, 0], a[1, 1], a[1, 2]
    v0, v1, v2 = a[2, 0], a[2, 1], a[2, 2]
    for m in range(4 * (p + 2) * (q + 2)):
        out[m] = 0.0
    for i in range(p + 1):
        for j in range(q + 1):
            at = 4 * (i * (q + 1) + j)
            x, y, z, w = net[at], net[at + 1], net[at + 2], net[at + 3]
            # A point goes to four, those further along u or v with A further on.
            for di in range(2):
                share_u = (i + 1.0) / (p + 1.0) if di == 1 else (p + 1.0 - i) / (p + 1.0)
                for dj in range(2):
                    share = share_u * ((j + 1.0) / (q + 1.0) if dj == 1 else (q + 1.0 - j) / (q + 1.0))
                    to = 4 * ((i + di) * (q + 2) + j + dj)
                    out[to] += share * (x - w * (a0 + di * u0 + dj * v0))
                    out[to + 1] += share * (y - w * (a1 + di * u1 + dj * v1))
                    out[to + 2] += share * (z - w * (a2 + di * u2 + dj * v2))
                    out[to + 3] += share * w


@leaf
def _keep_quotients(
    net: Floats, p: int, q: int, h_u: float, h_v: float, a: Floats, first: bool, out: Floats, boxes: Floats
) -> None:
    """Let the bounds of a rational patch be no wider than those of its quotients, around the middle of A."""
    center = local_line(3)
    for k in range(3):
        center[k] = a[0, k] + 0.5 * (a[1, k] + a[2, k])
    finer, finer_boxes = local_line(5), local_line(BOXES)
    quotient_bounds(net, p, q, h_u, h_v, center, first, finer, finer_boxes)
    for k in range(0 if first else 2, 5):
        out[k] = min(out[k], finer[k])
    for m in range(0, BOXES, 6):
        for k in range(m, m + 3):
            low, high = max(boxes[k], finer_boxes[k]), min(boxes[3 + k], finer_boxes[3 + k])
            if low <= high:
                boxes[k], boxes[3 + k] = low, high


@leaf
def _rational_bounds(
    net: Floats, p: int, q: int, h_u: float, h_v: float, first: bool, enough: float, sizes: Floats,
    out: Floats, boxes: Floats,
) -> None:  # fmt: skip
    """Bounds of a rational patch to ``out`` and ``boxes``; ``sizes`` (5, 2) is scratch."""
    a = local_table(3, 3)
    affine_map(net, p, q, a)
    lifted = local_line(LIFTED_SIZE)
    less_affine(net, p, q, a, lifted)
    r = 0.0
    w_min = lifted[3]
    w_max = w_min
    for i in range((p + 2) * (q + 2)):
        at = 4 * i
        w = lifted[at + 3]
        w_min, w_max = min(w_min, w), max(w_max, w)
        r = max(r, math.sqrt(lifted[at] ** 2 + lifted[at + 1] ** 2 + lifted[at + 2] ** 2) / w)
    _sizes(lifted, p + 1, q + 1, 4, h_u, h_v, True, sizes, boxes)
    w_u, w_v = sizes[LU, 1], sizes[LV, 1]
    t_u = (sizes[LU, 0] + r * w_u) / w_min
    t_v = (sizes[LV, 0] + r * w_v) / w_min
    out[LU] = t_u + math.sqrt(a[1, 0] ** 2 + a[1, 1] ** 2 + a[1, 2] ** 2) / h_u
    out[LV] = t_v + math.sqrt(a[2, 0] ** 2 + a[2, 1] ** 2 + a[2, 2] ** 2) / h_v
    more_uu = (2.0 * w_u * t_u + r * sizes[MUU, 1]) / w_min
    more_uv = (w_u * t_v + w_v * t_u + r * sizes[MUV, 1]) / w_min
    more_vv = (2.0 * w_v * t_v + r * sizes[MVV, 1]) / w_min
    out[MUU] = sizes[MUU, 0] / w_min + more_uu
    out[MUV] = sizes[MUV, 0] / w_min + more_uv
    out[MVV] = sizes[MVV, 0] / w_min + more_vv
    _divide(boxes[0:6], w_min, w_max, more_uu)
    _divide(boxes[6:12], w_min, w_max, more_uv)
    _divide(boxes[12:18], w_min, w_max, more_vv)
    more = h_u * h_u * more_uu + 2.0 * h_u * h_v * more_uv + h_v * h_v * more_vv
    whole = h_u * h_u * out[MUU] + 2.0 * h_u * h_v * out[MUV] + h_v * h_v * out[MVV]
    wide = more > PAYS * whole and whole > 8.0 * enough
    if wide and w_max <= WIDEST_SPREAD * w_min and pays(net, p, q):
        _keep_quotients(net, p, q, h_u, h_v, a, first, out, boxes)


@leaf
def weight_spread(net: Floats, n: int) -> float:
    """Largest over smallest weight of a flat net of ``n`` homogeneous points, all weights > 0."""
    low = net[3]
    high = low
    for i in range(n):
        low, high = min(low, net[4 * i + 3]), max(high, net[4 * i + 3])
    return high / low


@leaf
def net_bounds(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, out: Floats, boxes: Floats) -> None:
    """Bounds of the derivatives of a flat net (p + 1, q + 1, dim) over a box of size h_u x h_v.

    |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv| go to ``out`` (5,); to ``boxes`` (BOXES,) the boxes that hold the
    vectors S_uu, S_uv and S_vv, each three lows and three highs.
    """
    sizes = local_table(5, 2)
    if dim == 4:
        _rational_bounds(net, p, q, h_u, h_v, True, 0.0, sizes, out, boxes)
    else:
        _sizes(net, p, q, dim, h_u, h_v, True, sizes, boxes)
        for k in range(5):
            out[k] = sizes[k, 0]
    for k in range(5):
        out[k] *= OUTWARD


@leaf
def second_bounds(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, enough: float, out: Floats) -> None:
    """As ``net_bounds``, for the second derivatives alone: three norms to ``out`` (3 + BOXES,), then their boxes.

    They need to be no better than a deviation of ``enough`` mm of a box halved by its diagonal.
    """
    sizes = local_table(5, 2)
    if dim == 4:
        bounds = local_line(5)
        _rational_bounds(net, p, q, h_u, h_v, False, enough, sizes, bounds, out[3:])
        for k in range(3):
            out[k] = bounds[MUU + k] * OUTWARD
        return
    _sizes(net, p, q, dim, h_u, h_v, False, sizes, out[3:])
    for k in range(3):
        out[k] = sizes[MUU + k, 0] * OUTWARD
