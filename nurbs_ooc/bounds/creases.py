"""Creases: where the first derivative of a B-spline surface jumps, or turns within a sliver of its domain.

Surfaces that sweep a B-spline profile have creases where the profile has kinks.

At a knot of full multiplicity no second derivative bounds an interpolant across it, so the jump of the
first derivative is kept and charged instead. Files also have knots so close together that the second
derivative between them is huge while it hardly turns the surface: bounded by its largest value it would
call for cells as narrow. Such a strip is taken for a crease that reaches from its first knot to its last,
whose jump is the integral of the second derivative and the jumps inside.

Let the slope jump by at most J within [c0, c1]. In Taylor's formula for the remainder at q (see
``triangle_bound``) the strip adds to corner p_i across it at most J times the distance of p_i from the
strip's far side, so with x and y the distances of the far sides from the ends of the triangle's box ::

    |S - L| <= ... + J max sum_i l_i |u_i - c| <= ... + J x y / (x + y)

The jump of a polynomial surface is a Bézier curve along the break, whose control vectors bound it. Of a
rational one S = N / w the products N and w have jumps dN = sum B_j dN_j and dw alike, and with any point c
and any number k, for N - c w and its jumps in place of N and dN ::

    S_u+ - S_u- = (dN - S dw) / w = sum_j B_j (dN_j - k N_j - (S - c)(dw_j - k w_j)) / sum_j B_j w_j
    |S_u+ - S_u-| <= max_j |dN_j - k N_j| / w_j + max_j |P_j - c| max_j |dw_j / w_j - k|

A circle's weights have kinks where the circle has none: k takes them off, wholly if weights separate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.curve_bounds import curve_net
from nurbs_ooc.bounds.derivatives import MUU, MVV
from nurbs_ooc.geometry.bezier_net import LINE, bezier_net
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


class Ends(NamedTuple):
    """Where the points of a flat net lie that face a break: the first on it, the first one line before it."""

    near: int
    far: int
    step: int  # from one of them to the next
    scale: float  # from differences to derivatives


@leaf
def _end_slope(net: Floats, near: int, far: int, scale: float, out: Floats) -> None:
    """Derivative control vector of a flat net across its end, from point ``far`` to the end's point ``near``."""
    for k in range(3):
        out[k] = scale * (net[near + k] - net[far + k])


@leaf
def _polynomial_jump(left: Floats, right: Floats, a: Ends, b: Ends, n: int, out: Floats) -> None:
    """Raise ``out`` (2,), the jump and the slopes' size, by what the nets beside a break say at n control points."""
    slope_left = local_line(3)
    slope_right = local_line(3)
    for k in range(n):
        _end_slope(left, a.near + k * a.step, a.far + k * a.step, a.scale, slope_left)
        _end_slope(right, b.near + k * b.step, b.far + k * b.step, b.scale, slope_right)
        size = 0.0
        for m in range(3):
            size += (slope_left[m] - slope_right[m]) ** 2
            out[1] = max(out[1], abs(slope_left[m]) + abs(slope_right[m]))
        out[0] = max(out[0], math.sqrt(size))


@leaf
def _rational_jump(left: Floats, right: Floats, a: Ends, b: Ends, n: int, out: Floats) -> None:
    """The same of homogeneous nets: the module's bound, with c in the middle of the break's control points."""
    center = local_line(3)
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(n):
            x = left[a.near + i * a.step + k] / left[a.near + i * a.step + 3]
            low, high = min(low, x), max(high, x)
        center[k] = 0.5 * (low + high)
    low, high, reach = np.inf, -np.inf, 0.0
    for i in range(n):
        here = a.near + i * a.step
        w = left[here + 3]
        turn_left = a.scale * (w - left[a.far + i * a.step + 3]) / w
        turn_right = b.scale * (right[b.near + i * b.step + 3] - right[b.far + i * b.step + 3]) / w
        low, high = min(low, turn_left - turn_right), max(high, turn_left - turn_right)
        size = 0.0
        for k in range(3):
            size += (left[here + k] / w - center[k]) ** 2
        reach = max(reach, math.sqrt(size))
    kappa = 0.5 * (low + high)
    spread = 0.5 * (high - low) * reach
    for i in range(n):
        here, there = a.near + i * a.step, b.near + i * b.step
        before, after = a.far + i * a.step, b.far + i * b.step
        w = left[here + 3]
        size = 0.0
        for k in range(3):
            # Of w (S - c), which is what the shift of c leaves.
            x = left[here + k] - center[k] * w
            x_left = a.scale * (x - (left[before + k] - center[k] * left[before + 3]))
            x_right = b.scale * (right[there + k] - center[k] * right[there + 3])
            x_right -= b.scale * (right[after + k] - center[k] * right[after + 3])
            size += ((x_left - x_right - kappa * x) / w) ** 2
            out[1] = max(out[1], (abs(x_left) + abs(x_right)) / w)
        out[0] = max(out[0], math.sqrt(size) + spread)


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
    dim = 4 if s.rational else 3
    degree, points = (p, q + 1) if along_u else (q, p + 1)
    line, step = ((q + 1) * dim, dim) if along_u else (dim, (q + 1) * dim)
    end_left = Ends(degree * line, (degree - 1) * line, step, degree / (t - t0))
    end_right = Ends(0, line, step, -degree / (t1 - t))
    found = local_line(2)
    found[0], found[1] = 0.0, 0.0
    for j in range(n):
        a, b = across[j, 0], across[j + 1, 0]
        if along_u:
            bezier_net(g, row, t0, t, a, b, left)
            bezier_net(g, row, t, t1, a, b, right)
        else:
            bezier_net(g, row, a, b, t0, t, left)
            bezier_net(g, row, a, b, t, t1, right)
        if s.rational:
            _rational_jump(left, right, end_left, end_right, points, found)
        else:
            _polynomial_jump(left, right, end_left, end_right, points, found)
    return 0.0 if found[0] <= SMOOTH * found[1] else found[0]


@leaf
def profile_jump(g: Tables, curve: int, t0: float, t: float, t1: float) -> float:
    """Jump of the first derivative of a B-spline curve in space at the knot ``t`` between neighbouring knots t0, t1."""
    p = int(g.curves[curve].degree)
    left = local_table(LINE, 4)
    right = local_table(LINE, 4)
    dim = curve_net(g, curve, t0, t, left)
    curve_net(g, curve, t, t1, right)
    jump = 0.0
    scale = 0.0
    for k in range(3):
        if dim == 4:
            slope_left = (left[p, k] / left[p, 3] - left[p - 1, k] / left[p - 1, 3]) * left[p - 1, 3] / left[p, 3]
            slope_right = (right[1, k] / right[1, 3] - right[0, k] / right[0, 3]) * right[1, 3] / right[0, 3]
        else:
            slope_left, slope_right = left[p, k] - left[p - 1, k], right[1, k] - right[0, k]
        slope_left, slope_right = p * slope_left / (t - t0), p * slope_right / (t1 - t)
        jump += (slope_right - slope_left) ** 2
        scale = max(scale, abs(slope_left) + abs(slope_right))
    return 0.0 if math.sqrt(jump) <= SMOOTH * scale else math.sqrt(jump)


@leaf
def has_strips(breaks: Floats, n: int) -> bool:
    """Whether any of the ``n`` spans of one direction is thin beside the one before it: else no error marks any."""
    for i in range(1, n - 1):
        if breaks[i + 1, VALUE] - breaks[i, VALUE] < THIN * (breaks[i, VALUE] - breaks[i - 1, VALUE]):
            return True
    return False


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
        jump = breaks[i, JUMP]
        while end < n - 1 and end - i < MAX_STRIP and breaks[end + 1, 0] - breaks[i, 0] < limit:
            largest = 0.0
            for k in range(others):
                largest = max(largest, bounds[end * others + k if along_u else k * n + end, which])
            jump += largest * (breaks[end + 1, 0] - breaks[end, 0]) + breaks[end + 1, JUMP]
            end += 1
        width = breaks[end, 0] - breaks[i, 0]
        if end == i or width >= THIN * (breaks[end + 1, 0] - breaks[end, 0]) or jump * width > STRIP_SHARE * error:
            i += 1
            continue
        breaks[i, JUMP], breaks[i, REACH] = jump, width
        for m in range(i, end):
            # Creases inside it are part of it.
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
