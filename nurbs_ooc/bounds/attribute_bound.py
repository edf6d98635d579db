"""How far a linearly interpolated attribute is from the one given as a B-spline over a surface's parameters."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.derivatives import BOXES, second_bounds
from nurbs_ooc.bounds.triangle_bound import box_radii, norm_bound, vector_bound
from nurbs_ooc.geometry.bezier_net import NET, bezier_net
from nurbs_ooc.geometry.bspline import find_span
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

MOST_SPANS = 4096
MEASURES = 3 + BOXES
LEAST = 1e-9  # of a knot span: no box is thinner


@leaf
def _span_end(g: Tables, knots: int, n: int, degree: int, low: float, high: float) -> float:
    """Where the part of [low, high] ends that lies in the span after ``low``."""
    span = find_span(g.values, knots, n, degree, low)
    end = g.values[knots + span + 1]
    return high if span == n - 1 or end <= low else min(end, high)


@leaf
def attribute_bound(g: Tables, row: int, uv: Floats, m: Floats) -> float:
    """Bound of the deviation over a triangle, in the attribute's unit.

    The attribute is continuous with its first derivatives, so that second derivatives tell all.

    Args:
        g: tables of the attributes.
        row: of the attribute.
        uv: (3, 2) corners of the triangle.
        m: (>= 3 + BOXES,) gets the second derivatives' bounds.
    """
    s = g.surfaces[row]
    u0, u1 = min(uv[0, 0], uv[1, 0], uv[2, 0]), max(uv[0, 0], uv[1, 0], uv[2, 0])
    v0, v1 = min(uv[0, 1], uv[1, 1], uv[2, 1]), max(uv[0, 1], uv[1, 1], uv[2, 1])
    u1, v1 = max(u1, u0 + LEAST * (s.u1 - s.u0)), max(v1, v0 + LEAST * (s.v1 - s.v0))
    net = local_line(NET)
    one = local_line(MEASURES)
    for k in range(3):
        m[k] = 0.0
        for c in range(3):
            m[3 + 6 * k + c], m[6 + 6 * k + c] = np.inf, -np.inf
    count = 0
    low_u = u0
    while low_u < u1:
        high_u = _span_end(g, s.knots_u, s.n_u, s.degree_u, low_u, u1)
        low_v = v0
        while low_v < v1:
            high_v = _span_end(g, s.knots_v, s.n_v, s.degree_v, low_v, v1)
            count += 1
            if count > MOST_SPANS:
                return math.inf
            dim = bezier_net(g, row, low_u, high_u, low_v, high_v, net)
            second_bounds(net, s.degree_u, s.degree_v, dim, high_u - low_u, high_v - low_v, 0.0, one)
            for k in range(3):
                m[k] = max(m[k], one[k])
                for c in range(3):
                    m[3 + 6 * k + c] = min(m[3 + 6 * k + c], one[3 + 6 * k + c])
                    m[6 + 6 * k + c] = max(m[6 + 6 * k + c], one[6 + 6 * k + c])
            low_v = high_v
        low_u = high_u
    x0, y0, x1, y1, x2, y2 = uv[0, 0], uv[0, 1], uv[1, 0], uv[1, 1], uv[2, 0], uv[2, 1]
    box_radii(m)
    return min(norm_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0), vector_bound(m, x0, y0, x1, y1, x2, y2, 0.0, 0.0))
