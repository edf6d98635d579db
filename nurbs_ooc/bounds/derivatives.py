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
from nurbs_ooc.geometry.tables import MAX_DEGREE

Floats = npt.NDArray[np.float64]

# Rows of a bounds vector.
LU, LV, MUU, MUV, MVV = 0, 1, 2, 3, 4
# Numbers of the boxes of S_uu, S_uv and S_vv.
BOXES = 18

# Numbers of the largest homogeneous net, one degree higher each way.
LIFTED_SIZE = 4 * (MAX_DEGREE + 2) * (MAX_DEGREE + 2)

# Outward rounding: a bound is the end of a chain of fewer than 200 roundings.
OUTWARD = 1.0 + 2.0**-44


@leaf
def _difference(net: Floats, at: int, step_a: int, step_b: int, order: int, k: int) -> float:
    """One component of a first (order 1), second (2) or mixed (3) difference of the flat net."""
    if order == 1:
        return net[at + step_a + k] - net[at + k]
    if order == 2:
        return net[at + 2 * step_a + k] - 2.0 * net[at + step_a + k] + net[at + k]
    return net[at + step_a + step_b + k] - net[at + step_a + k] - net[at + step_b + k] + net[at + k]


@leaf
def _largest(net: Floats, p: int, q: int, dim: int, di: int, dj: int, scale: float, out: Floats, box: Floats) -> None:
    """``scale`` times the (di, dj) differences of a flat net: largest norms of the spatial part and of the weights.

    They go to ``out`` (2,), the box of the spatial part to ``box`` (6,): three lows, three highs.
    """
    step_u = (q + 1) * dim
    step_v = dim
    order = 3
    step_a, step_b = step_u, step_v
    if dj == 0:
        order = di
    elif di == 0:
        order = dj
        step_a = step_v
    best = 0.0
    best_w = 0.0
    for k in range(3):
        box[k], box[3 + k] = np.inf, -np.inf
    for i in range(p + 1 - di):
        for j in range(q + 1 - dj):
            at = i * step_u + j * step_v
            if dim == 4:
                best_w = max(best_w, abs(_difference(net, at, step_a, step_b, order, 3)))
            size = 0.0
            for k in range(3):
                d = scale * _difference(net, at, step_a, step_b, order, k)
                box[k], box[3 + k] = min(box[k], d), max(box[3 + k], d)
                size += d * d
            best = max(best, size)
    if p < di or q < dj:
        for k in range(6):
            box[k] = 0.0
    out[0] = math.sqrt(best)
    out[1] = scale * best_w


@leaf
def _second_sizes(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, out: Floats, boxes: Floats) -> None:
    """Bounds of the second derivatives of a flat net to ``out[MUU:]`` (5, 2): of its spatial part and of its weights.

    ``boxes`` (BOXES,) gets their boxes.
    """
    _largest(net, p, q, dim, 2, 0, p * (p - 1) / (h_u * h_u), out[MUU], boxes[0:6])
    _largest(net, p, q, dim, 1, 1, p * q / (h_u * h_v), out[MUV], boxes[6:12])
    _largest(net, p, q, dim, 0, 2, q * (q - 1) / (h_v * h_v), out[MVV], boxes[12:18])


@leaf
def _sizes(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, out: Floats, boxes: Floats) -> None:
    """As ``_second_sizes``, for all five derivatives."""
    _largest(net, p, q, dim, 1, 0, p / h_u, out[LU], boxes[0:6])
    _largest(net, p, q, dim, 0, 1, q / h_v, out[LV], boxes[0:6])
    _second_sizes(net, p, q, dim, h_u, h_v, out, boxes)


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
    for i in range(p + 2):
        for j in range(q + 2):
            to = (i * (q + 2) + j) * 4
            for k in range(4):
                out[to + k] = 0.0
            for di in range(2):
                share_u = i / (p + 1.0) if di == 1 else 1.0 - i / (p + 1.0)
                for dj in range(2):
                    share = share_u * (j / (q + 1.0) if dj == 1 else 1.0 - j / (q + 1.0))
                    if share > 0.0:
                        at = ((i - di) * (q + 1) + j - dj) * 4
                        w = net[at + 3]
                        out[to + 3] += share * w
                        for k in range(3):
                            out[to + k] += share * (net[at + k] - w * (a[0, k] + di * a[1, k] + dj * a[2, k]))


@leaf
def _rational_bounds(
    net: Floats, p: int, q: int, h_u: float, h_v: float, sizes: Floats, out: Floats, boxes: Floats
) -> None:
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
    _sizes(lifted, p + 1, q + 1, 4, h_u, h_v, sizes, boxes)
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
        _rational_bounds(net, p, q, h_u, h_v, sizes, out, boxes)
    else:
        _sizes(net, p, q, dim, h_u, h_v, sizes, boxes)
        for k in range(5):
            out[k] = sizes[k, 0]
    for k in range(5):
        out[k] *= OUTWARD


@leaf
def second_bounds(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, out: Floats) -> None:
    """As ``net_bounds``, for the second derivatives alone: three norms to ``out`` (3 + BOXES,), then their boxes."""
    if dim == 4:
        bounds = local_line(5)
        net_bounds(net, p, q, dim, h_u, h_v, bounds, out[3:])
        out[0], out[1], out[2] = bounds[MUU], bounds[MUV], bounds[MVV]
        return
    sizes = local_table(5, 2)
    _second_sizes(net, p, q, dim, h_u, h_v, sizes, out[3:])
    for k in range(3):
        out[k] = sizes[MUU + k, 0] * OUTWARD
