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
def bezier_net(g: Tables, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> int:
    """Write the flat net (degree_u + 1, degree_v + 1, 3 or 4) over a box to ``out``.

    The box lies in the knot span that holds its middle, or reaches a little beyond (the polynomial is
    continued). Homogeneous coordinates if the surface is rational; returns how many per point.
    """
    s = g.surfaces[row]
    p, q = s.degree_u, s.degree_v
    dim = 4 if s.rational else 3
    span_u = find_span(g.values, s.knots_u, s.n_u, p, 0.5 * (u0 + u1))
    span_v = find_span(g.values, s.knots_v, s.n_v, q, 0.5 * (v0 + v1))
    along_u = local_table(LINE, LINE)
    along_v = local_table(LINE, LINE)
    line = local_line(ROW)
    bezier_weights(g.values, s.knots_u, span_u, p, u0, u1, along_u)
    bezier_weights(g.values, s.knots_v, span_v, q, v0, v1, along_v)
    width = (q + 1) * dim
    for k in range(p + 1):
        for m in range(width):
            line[m] = 0.0
        for i in range(p + 1):
            weight = along_u[k, i]
            at = s.points + ((span_u - p + i) * s.n_v + span_v - q) * dim
            for m in range(width):
                line[m] += weight * g.values[at + m]
        for j in range(q + 1):
            # Sums in registers: this is where most time of a cell goes.
            x, y, z, w = 0.0, 0.0, 0.0, 0.0
            for i in range(q + 1):
                weight = along_v[j, i]
                x += weight * line[i * dim]
                y += weight * line[i * dim + 1]
                z += weight * line[i * dim + 2]
                if dim == 4:
                    w += weight * line[i * dim + 3]
            to = k * width + j * dim
            out[to], out[to + 1], out[to + 2] = x, y, z
            if dim == 4:
                out[to + 3] = w
    return dim
