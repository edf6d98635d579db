"""Creases: knots of full multiplicity, where the first derivative of a B-spline surface may jump.

No second derivative bounds an interpolant across a crease, so the jump is kept and charged instead.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.geometry.bezier_net import bezier_net
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Slopes that differ by less than this part of their size are one: smooth up to roundoff is smooth.
SMOOTH = 1e-9
# Of a rational surface the slopes along the break are mixed with weights: their spread is charged.
RATIONAL_SPREAD = 2.0


@leaf
def _end_slope(
    net: Floats, p: int, q: int, dim: int, along_u: bool, at_end: bool, other: int, h: float, out: Floats
) -> None:
    """Derivative control vector (affine) of a flat net's end row across a break; ``other`` runs along it."""
    degree = p if along_u else q
    step = (q + 1) * dim if along_u else dim
    base = other * dim if along_u else other * (q + 1) * dim
    near = base + (degree * step if at_end else 0)
    far = base + ((degree - 1) * step if at_end else step)
    sign = 1.0 if at_end else -1.0
    for k in range(3):
        if dim == 4:
            w0, w1 = net[near + 3], net[far + 3]
            out[k] = sign * degree * (w1 / w0) * (net[near + k] / w0 - net[far + k] / w1) / h
        else:
            out[k] = sign * degree * (net[near + k] - net[far + k]) / h


@leaf
def slope_jump(
    g: Tables, row: int, along_u: bool, t0: float, t: float, t1: float, across: Floats, n: int,
    left: Floats, right: Floats,
) -> float:  # fmt: skip
    """Bound of the jump of the first derivative at the break ``t`` between neighbouring breaks t0 and t1.

    ``across`` (n + 1, 2) are the breaks of the other direction; ``left`` and ``right`` are scratch nets.
    """
    s = g.surfaces[row]
    p, q = s.degree_u, s.degree_v
    slope_left = local_line(3)
    slope_right = local_line(3)
    worst = 0.0
    scale = 0.0
    for j in range(n):
        a, b = across[j, 0], across[j + 1, 0]
        if along_u:
            dim = bezier_net(g, row, t0, t, a, b, left)
            bezier_net(g, row, t, t1, a, b, right)
        else:
            dim = bezier_net(g, row, a, b, t0, t, left)
            bezier_net(g, row, a, b, t, t1, right)
        for k in range((q if along_u else p) + 1):
            _end_slope(left, p, q, dim, along_u, True, k, t - t0, slope_left)
            _end_slope(right, p, q, dim, along_u, False, k, t1 - t, slope_right)
            size = 0.0
            for m in range(3):
                size += (slope_left[m] - slope_right[m]) ** 2
                scale = max(scale, abs(slope_left[m]) + abs(slope_right[m]))
            worst = max(worst, math.sqrt(size))
    if worst <= SMOOTH * scale:
        return 0.0
    return worst * (1.0 if s.rational == 0 else RATIONAL_SPREAD)


@leaf
def is_multiple(g: Tables, knots: int, n: int, degree: int, value: float) -> bool:
    """Whether ``value`` is an inner knot of multiplicity >= degree."""
    count = 0
    for i in range(degree + 1, n):
        if g.values[knots + i] == value:
            count += 1
    return count >= degree
