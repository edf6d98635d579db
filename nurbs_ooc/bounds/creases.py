"""Creases: where the first derivative of a B-spline surface jumps, or turns within a sliver of its domain.

At a knot of full multiplicity no second derivative bounds an interpolant across it, so the jump of the
first derivative is kept and charged instead. Files also have knots so close together that the second
derivative between them is huge while it hardly turns the surface: bounded by its largest value it would
call for cells as narrow. Such a strip is taken for a crease that reaches from its first knot to its last,
whose jump is the integral of the second derivative.

Let the slope jump by at most J within [c0, c1]. In Taylor's formula for the remainder at q (see
``triangle_bound``) the strip adds to corner p_i across it at most J times the distance of p_i from the
strip's far side, so with x and y the distances of the far sides from the ends of the triangle's box ::

    |S - L| <= ... + J max sum_i l_i |u_i - c| <= ... + J x y / (x + y)
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.derivatives import MUU, MVV
from nurbs_ooc.geometry.bezier_net import bezier_net
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Columns of breaks: value, jump of the first derivative, width of the strip that is taken for a crease, and
# 1 where a break lies in such a strip or ends it.
VALUE, JUMP, REACH, HIDDEN = 0, 1, 2, 3
# A strip is narrower than this part of the spans beside it, of at most so many spans, and moves a surface by less
# than this share of the error.
THIN = 0.1
MAX_STRIP = 8
STRIP_SHARE = 0.1
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

    ``across`` (n + 1, 4) are the breaks of the other direction; ``left`` and ``right`` are scratch nets.
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
def mark_strips(
    breaks: Floats, n: int, error: float, bounds: Floats, boxes: Floats, along_u: bool, others: int
) -> None:
    """Turn strips among the ``n`` spans of one direction into creases, where the error does not look into them.

    ``bounds`` (n_u * n_v, 5) and ``boxes`` (n_u * n_v, BOXES) lose the second derivative across a strip;
    ``others`` is the number of spans of the other direction.
    """
    which = MUU if along_u else MVV
    box = 0 if along_u else 12
    i = 1
    while i < n - 1:
        limit = THIN * (breaks[i, 0] - breaks[i - 1, 0])
        end = i
        jump = 0.0
        while end < n - 1 and end - i < MAX_STRIP and breaks[end + 1, 0] - breaks[i, 0] < limit:
            largest = 0.0
            for k in range(others):
                largest = max(largest, bounds[end * others + k if along_u else k * n + end, which])
            jump += largest * (breaks[end + 1, 0] - breaks[end, 0])
            end += 1
        width = breaks[end, 0] - breaks[i, 0]
        if end == i or width >= THIN * (breaks[end + 1, 0] - breaks[end, 0]) or jump * width > STRIP_SHARE * error:
            i += 1
            continue
        breaks[i, JUMP], breaks[i, REACH] = max(breaks[i, JUMP], jump), width
        for m in range(i, end):
            # Creases inside it are part of it.
            breaks[i, JUMP] += breaks[m + 1, JUMP]
            breaks[m + 1, JUMP], breaks[m + 1, HIDDEN] = 0.0, 1.0
            for k in range(others):
                row = m * others + k if along_u else k * n + m
                bounds[row, which] = 0.0
                for d in range(6):
                    boxes[row, box + d] = 0.0
        i = end + 1


@leaf
def crease_charge(breaks: Floats, n: int, i: int, low: float, high: float) -> float:
    """What creases of one direction add to the deviation of a linear interpolant over [low, high], mm.

    ``breaks`` are those of the direction's ``n`` spans, of which span ``i`` holds ``low``.
    """
    charge = 0.0
    k = max(i + 1 - MAX_STRIP, 1)
    while k < n and breaks[k, 0] < high:
        jump = breaks[k, JUMP]
        if jump > 0.0:
            x = breaks[k, 0] + breaks[k, REACH] - low
            y = high - breaks[k, 0]
            if x > 0.0 and y > 0.0:
                charge += jump * x * y / (x + y)
        k += 1
    return charge


@leaf
def is_multiple(g: Tables, knots: int, n: int, degree: int, value: float) -> bool:
    """Whether ``value`` is an inner knot of multiplicity >= degree."""
    count = 0
    for i in range(degree + 1, n):
        if g.values[knots + i] == value:
            count += 1
    return count >= degree
