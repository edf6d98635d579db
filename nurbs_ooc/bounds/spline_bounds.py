"""Derivative bounds of a polynomial B-spline surface on all its knot spans, without cutting it up.

The derivatives of a B-spline are B-splines whose control points are differences of its own::

    Q1_i = p (P_i+1 - P_i) / (U_i+p+1 - U_i+1)          S_u  on span s: Q1 of s - p .. s - 1
    Q2_i = (p - 1)(Q1_i+1 - Q1_i) / (U_i+p+1 - U_i+2)   S_uu on span s: Q2 of s - p .. s - 2

so on each span a derivative is bounded by the largest of the few control points that reach it. On the
finely cut surfaces of CAD files this is nearly what the Bézier nets of all pieces would give.

Source: L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, eq. 3.7 and 3.8.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.derivatives import BOXES, LU, LV, MUU, MUV, MVV, OUTWARD
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Spans(NamedTuple):
    """The non-empty knot spans of a surface that are used, and its degrees."""

    u: Ints  # >= n_u span numbers
    n_u: int
    v: Ints
    n_v: int
    p: int
    q: int


@leaf
def _differentiate(
    values: Floats,
    knots: int,
    degree: int,
    order: int,
    net: Floats,
    rows: int,
    columns: int,
    along_u: bool,
    out: Floats,
) -> None:
    """Control points (rows - 1, columns, 3), or (rows, columns - 1, 3) along v, of a net's next derivative.

    ``net`` (rows, columns, 3) has been derived ``order`` times along this direction, whose full degree
    and knots (offset in ``values``) are given. Control points whose basis function has no support are 0.
    """
    n = rows - 1 if along_u else columns - 1
    others = columns if along_u else rows
    for i in range(n):
        gap = values[knots + i + degree + 1] - values[knots + i + 1 + order]
        scale = (degree - order) / gap if gap > 0.0 else 0.0
        for j in range(others):
            if along_u:
                low, high, to = (i * columns + j) * 3, ((i + 1) * columns + j) * 3, (i * columns + j) * 3
            else:
                low, high, to = (j * columns + i) * 3, (j * columns + i + 1) * 3, (j * n + i) * 3
            for k in range(3):
                out[to + k] = (net[high + k] - net[low + k]) * scale


@leaf
def _largest_per_span(
    net: Floats, columns: int, count: int, spans: Spans, reach_u: int, reach_v: int, size: Floats, bounds: Floats,
    which: int,
) -> None:  # fmt: skip
    """Largest norm of the ``reach_u`` x ``reach_v`` control points of each span, to ``bounds[:, which]``.

    ``net`` has ``count`` points, ``columns`` per row; ``size`` is scratch.
    """
    for i in range(count):
        size[i] = net[3 * i] ** 2 + net[3 * i + 1] ** 2 + net[3 * i + 2] ** 2
    for i in range(spans.n_u):
        for j in range(spans.n_v):
            best = 0.0
            for a in range(spans.u[i] - spans.p, spans.u[i] - spans.p + reach_u):
                for b in range(spans.v[j] - spans.q, spans.v[j] - spans.q + reach_v):
                    best = max(best, size[a * columns + b])
            bounds[i * spans.n_v + j, which] = math.sqrt(best) * OUTWARD


@leaf
def _box_per_span(net: Floats, columns: int, spans: Spans, reach_u: int, reach_v: int, boxes: Floats, at: int) -> None:
    """Box of the same control points of each span, to ``boxes[:, at : at + 6]``: three lows, three highs."""
    for i in range(spans.n_u):
        for j in range(spans.n_v):
            row = i * spans.n_v + j
            for k in range(3):
                low, high = np.inf, -np.inf
                for a in range(spans.u[i] - spans.p, spans.u[i] - spans.p + reach_u):
                    for b in range(spans.v[j] - spans.q, spans.v[j] - spans.q + reach_v):
                        x = net[3 * (a * columns + b) + k]
                        low, high = min(low, x), max(high, x)
                boxes[row, at + k], boxes[row, at + 3 + k] = low, high


@leaf
def spline_bounds(g: Tables, row: int, spans: Spans, scratch: Floats, bounds: Floats, boxes: Floats) -> None:
    """|S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv| of a polynomial surface on its spans, to ``bounds`` (n_u * n_v, 5).

    The boxes of S_uu, S_uv and S_vv go to ``boxes`` (n_u * n_v, BOXES), see ``net_bounds``;
    ``scratch`` (3, >= 3 n) where n is the number of control points.
    """
    s = g.surfaces[row]
    p, q = s.degree_u, s.degree_v
    net = g.values[s.points : s.points + 3 * s.n_u * s.n_v]
    one, two, size = scratch[0], scratch[1], scratch[2]
    a, b = s.n_u, s.n_v
    for k in range(spans.n_u * spans.n_v):
        for m in range(5):
            bounds[k, m] = 0.0
        for m in range(BOXES):
            boxes[k, m] = 0.0
    _differentiate(g.values, s.knots_u, p, 0, net, a, b, True, one)
    _largest_per_span(one, b, (a - 1) * b, spans, p, q + 1, size, bounds, LU)
    if p > 1:
        _differentiate(g.values, s.knots_u, p, 1, one, a - 1, b, True, two)
        _largest_per_span(two, b, (a - 2) * b, spans, p - 1, q + 1, size, bounds, MUU)
        _box_per_span(two, b, spans, p - 1, q + 1, boxes, 0)
    _differentiate(g.values, s.knots_v, q, 0, one, a - 1, b, False, two)
    _largest_per_span(two, b - 1, (a - 1) * (b - 1), spans, p, q, size, bounds, MUV)
    _box_per_span(two, b - 1, spans, p, q, boxes, 6)
    _differentiate(g.values, s.knots_v, q, 0, net, a, b, False, one)
    _largest_per_span(one, b - 1, a * (b - 1), spans, p + 1, q, size, bounds, LV)
    if q > 1:
        _differentiate(g.values, s.knots_v, q, 1, one, a, b - 1, False, two)
        _largest_per_span(two, b - 2, a * (b - 2), spans, p + 1, q - 1, size, bounds, MVV)
        _box_per_span(two, b - 2, spans, p + 1, q - 1, boxes, 12)
