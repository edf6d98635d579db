"""The Bézier net of a B-spline surface over any box inside one knot span."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.geometry.bspline import bezier_weights, find_span
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]

LINE = MAX_DEGREE + 1
ROW = 4 * LINE
# Numbers of the largest net.
NET = ROW * LINE


@leaf
def _combine(lines: Floats, weights: Floats, n: int, width: int, out: Floats) -> None:
    """Write n sums of n lines of ``width`` numbers: ``out[k] = sum_i weights[k, i] lines[i]``."""
    for k in range(n):
        weight = weights[k, 0]
        for m in range(width):
            out[k * width + m] = weight * lines[m]
        for i in range(1, n):
            weight = weights[k, i]
            for m in range(width):
                out[k * width + m] += weight * lines[i * width + m]


@leaf
def net_of_span(g: Tables, row: int, span_u: int, span_v: int, along_u: Floats, along_v: Floats, out: Floats) -> int:
    """Write the flat net (degree_u + 1, degree_v + 1, 3 or 4) of a part of a knot span to ``out``.

    ``along_u`` and ``along_v`` are the part's ``bezier_weights``. Homogeneous coordinates if the surface is
    rational; returns how many per point.
    """
    s = g.surfaces[row]
    p, q = s.degree_u, s.degree_v
    dim = 4 if s.rational else 3
    # Each direction in turn has the other one's numbers side by side, so that they are added up in lanes.
    columns = local_line(NET)
    rows = local_line(NET)
    for i in range(p + 1):
        at = s.points + ((span_u - p + i) * s.n_v + span_v - q) * dim
        for j in range(q + 1):
            for k in range(dim):
                columns[(j * (p + 1) + i) * dim + k] = g.values[at + j * dim + k]
    _combine(columns, along_v, q + 1, (p + 1) * dim, rows)
    for i in range(p + 1):
        for j in range(q + 1):
            for k in range(dim):
                columns[(i * (q + 1) + j) * dim + k] = rows[(j * (p + 1) + i) * dim + k]
    _combine(columns, along_u, p + 1, (q + 1) * dim, out)
    return dim


@leaf
def bezier_net(g: Tables, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> int:
    """Write the flat net over a box to ``out``, see ``net_of_span``.

    The box lies in the knot span that holds its middle, or reaches a little beyond (the polynomial is
    continued).
    """
    s = g.surfaces[row]
    span_u = find_span(g.values, s.knots_u, s.n_u, s.degree_u, 0.5 * (u0 + u1))
    span_v = find_span(g.values, s.knots_v, s.n_v, s.degree_v, 0.5 * (v0 + v1))
    along_u = local_table(LINE, LINE)
    along_v = local_table(LINE, LINE)
    bezier_weights(g.values, s.knots_u, span_u, s.degree_u, u0, u1, along_u)
    bezier_weights(g.values, s.knots_v, span_v, s.degree_v, v0, v1, along_v)
    return net_of_span(g, row, span_u, span_v, along_u, along_v, out)


@leaf
def split_net(net: Floats, p: int, q: int, dim: int, along_u: bool, t: float, low: Floats, high: Floats) -> None:
    """Cut a flat net (p + 1, q + 1, dim) at ``t`` of its unit interval into the nets of both sides.

    Source: P. de Casteljau's subdivision; L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, ch. 1.3.
    """
    lines, degree, width = (1, p, (q + 1) * dim) if along_u else (p + 1, q, dim)
    for m in range((p + 1) * (q + 1) * dim):
        high[m] = net[m]
    for i in range(lines):
        at = i * (degree + 1) * width
        for r in range(degree):
            for m in range(width):
                low[at + r * width + m] = high[at + m]
            for m in range((degree - r) * width):
                high[at + m] = (1.0 - t) * high[at + m] + t * high[at + m + width]
        for m in range(width):
            low[at + degree * width + m] = high[at + m]
