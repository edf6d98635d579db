"""Bounds of first and second derivatives of a Bézier net, polynomial or rational.

For a patch S of degrees p x q over a box of size h_u x h_v the derivatives are Bézier patches whose
control vectors are scaled differences of the net, so their largest norm bounds the derivative::

    |S_u|  <= p / h_u             max |d10 P|
    |S_uu| <= p (p - 1) / h_u^2   max |d20 P|
    |S_uv| <= p q / (h_u h_v)     max |d11 P|

A rational patch S = c + N / w, with N the net of w (P - c) and positive weights, has |S - c| <= r,
r = max |P - c|, and by the quotient rule ::

    |S_u|  <= (|N_u| + r |w_u|) / w_min
    |S_uu| <= (|N_uu| + 2 |w_u| |S_u| + r |w_uu|) / w_min
    |S_uv| <= (|N_uv| + |w_u| |S_v| + |w_v| |S_u| + r |w_uv|) / w_min

The linear interpolant over any triangle whose parameter box is a x b then differs from S by at most
(a^2 |S_uu| + 2 a b |S_uv| + b^2 |S_vv|) / 8.

Source: D. Filip, R. Magedson, R. Markot, "Surface algorithms using bounds on derivatives",
Computer Aided Geometric Design 3, 1986, theorem 1; for the triangle inside its parameter box see
docs/tessellation.md.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper

Floats = npt.NDArray[np.float64]

# Rows of a bounds vector.
LU, LV, MUU, MUV, MVV = 0, 1, 2, 3, 4

# Outward rounding: a bound is the end of a chain of fewer than 200 roundings.
OUTWARD = 1.0 + 2.0**-44


@helper
def _difference(net: Floats, at: int, step_a: int, step_b: int, order: int, k: int) -> float:
    """One component of a first (order 1), second (2) or mixed (3) difference of the flat net."""
    if order == 1:
        return net[at + step_a + k] - net[at + k]
    if order == 2:
        return net[at + 2 * step_a + k] - 2.0 * net[at + step_a + k] + net[at + k]
    return net[at + step_a + step_b + k] - net[at + step_a + k] - net[at + step_b + k] + net[at + k]


@helper
def _largest(net: Floats, p: int, q: int, dim: int, di: int, dj: int, center: Floats, out: Floats) -> None:
    """Largest norm of the (di, dj) difference of the spatial part, re-centred, and of the weights."""
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
    for i in range(p + 1 - di):
        for j in range(q + 1 - dj):
            at = i * step_u + j * step_v
            dw = 0.0
            if dim == 4:
                dw = _difference(net, at, step_a, step_b, order, 3)
            size = 0.0
            for k in range(3):
                d = _difference(net, at, step_a, step_b, order, k) - dw * center[k]
                size += d * d
            best = max(best, size)
            best_w = max(best_w, abs(dw))
    out[0] = math.sqrt(best)
    out[1] = best_w


@helper
def net_bounds(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float, out: Floats) -> None:
    """Write |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv| bounds of a flat net (p + 1, q + 1, dim) to ``out``."""
    center = np.zeros(3)
    r = 0.0
    w_min = 1.0
    if dim == 4:
        # Centre on the mean of the corners, so that the weights' change multiplies a small radius.
        for corner in range(4):
            at = ((corner & 1) * p * (q + 1) + (corner >> 1) * q) * 4
            for k in range(3):
                center[k] += 0.25 * net[at + k] / net[at + 3]
        w_min = net[3]
        for i in range((p + 1) * (q + 1)):
            w = net[4 * i + 3]
            w_min = min(w_min, w)
            size = 0.0
            for k in range(3):
                d = net[4 * i + k] / w - center[k]
                size += d * d
            r = max(r, math.sqrt(size))
    pair = np.empty(2)
    _largest(net, p, q, dim, 1, 0, center, pair)
    w_u = p * pair[1] / h_u
    out[LU] = (p * pair[0] / h_u + r * w_u) / w_min
    _largest(net, p, q, dim, 0, 1, center, pair)
    w_v = q * pair[1] / h_v
    out[LV] = (q * pair[0] / h_v + r * w_v) / w_min
    out[MUU] = 0.0
    out[MVV] = 0.0
    if p > 1:
        _largest(net, p, q, dim, 2, 0, center, pair)
        scale = p * (p - 1) / (h_u * h_u)
        out[MUU] = (scale * pair[0] + r * scale * pair[1]) / w_min
    if q > 1:
        _largest(net, p, q, dim, 0, 2, center, pair)
        scale = q * (q - 1) / (h_v * h_v)
        out[MVV] = (scale * pair[0] + r * scale * pair[1]) / w_min
    _largest(net, p, q, dim, 1, 1, center, pair)
    scale = p * q / (h_u * h_v)
    out[MUV] = (scale * pair[0] + r * scale * pair[1]) / w_min
    if dim == 4:
        out[MUU] += 2.0 * w_u * out[LU] / w_min
        out[MVV] += 2.0 * w_v * out[LV] / w_min
        out[MUV] += (w_u * out[LV] + w_v * out[LU]) / w_min
    for k in range(5):
        out[k] *= OUTWARD


@helper
def restrict_net(net: Floats, p: int, q: int, dim: int, box: Floats, out: Floats, line: Floats) -> None:
    """The net over the sub-box ``box`` = (s0, s1, t0, t1) of the unit square, by de Casteljau's algorithm.

    ``net`` and ``out`` are flat (p + 1, q + 1, dim); ``line`` is scratch (>= max(p, q) + 1, dim).
    """
    for i in range((p + 1) * (q + 1) * dim):
        out[i] = net[i]
    for j in range(q + 1):
        for i in range(p + 1):
            for k in range(dim):
                line[i, k] = out[(i * (q + 1) + j) * dim + k]
        _restrict_line(line, p, dim, box[0], box[1])
        for i in range(p + 1):
            for k in range(dim):
                out[(i * (q + 1) + j) * dim + k] = line[i, k]
    for i in range(p + 1):
        for j in range(q + 1):
            for k in range(dim):
                line[j, k] = out[(i * (q + 1) + j) * dim + k]
        _restrict_line(line, q, dim, box[2], box[3])
        for j in range(q + 1):
            for k in range(dim):
                out[(i * (q + 1) + j) * dim + k] = line[j, k]


@helper
def _restrict_line(line: Floats, p: int, dim: int, a: float, b: float) -> None:
    """Replace Bézier points over [0, 1] by those over [a, b], first cutting at b, then at a / b."""
    if b < 1.0:
        for r in range(1, p + 1):
            for i in range(p, r - 1, -1):
                for k in range(dim):
                    line[i, k] = (1.0 - b) * line[i - 1, k] + b * line[i, k]
    if a > 0.0:
        t = a / b
        for r in range(1, p + 1):
            for i in range(p + 1 - r):
                for k in range(dim):
                    line[i, k] = (1.0 - t) * line[i, k] + t * line[i + 1, k]
