"""Pieces of all curves of a part between their knots, each with its bounds: computed once, looked up often.

The derivatives of a polynomial B-spline curve are B-splines whose control points are differences of its
own (see ``spline_bounds``), so one pass over the curve bounds them on all its spans; a p-curve's box on a
piece is that of the ends, widened by what the second derivative allows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.curve_bounds import D1, D1_X, D2, D2_X, HIGH, LOW, NURBS, SIZE, curve_bounds
from nurbs_ooc.bounds.derivatives import OUTWARD
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.ranges import Run, at_once
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Pieces shorter than this part of the curve's range are left to their neighbours.
SHORTEST = 1e-12


class CurvePieces(NamedTuple):
    """Pieces ``first[c]:first[c + 1]`` of curve c follow one another along its used range."""

    first: Ints  # (n_curves + 1,)
    start: Floats  # (n_pieces,) parameter at which a piece begins
    bounds: Floats  # (n_pieces, SIZE), see ``curve_bounds``; the box of a spline in space may be all of it


@leaf
def _next_break(g: Tables, row: int, at: float, i: int) -> tuple[float, int]:
    """The first knot of curve ``row``, from number ``i`` on, clearly beyond ``at``, and the next number.

    The end of the curve's range if there is none.
    """
    c = g.curves[row]
    if c.kind == NURBS:
        clear = SHORTEST * (c.t1 - c.t0)
        while i < c.n:
            knot = g.values[c.knots + i]
            i += 1
            if knot > at + clear and knot < c.t1 - clear:
                return float(knot), i
    return float(c.t1), i


@kernel
def _count(g: Tables, counts: Ints) -> None:
    for row in range(len(g.curves)):
        c = g.curves[row]
        # What ``sound_tables`` refuses has no pieces: faces along it are FAILED, and nobody asks.
        if not c.t0 < c.t1 or (c.kind == NURBS and not 0 < c.degree <= min(MAX_DEGREE, c.n - 1)):
            continue
        at = c.t0
        i = c.degree + 1
        while at < c.t1:
            at, i = _next_break(g, row, at, i)
            counts[row] += 1


@leaf
def _differentiate(g: Tables, row: int, first: Floats, second: Floats) -> None:
    """Control points (n - 1, dim) and (n - 2, dim) of the first and second derivative of a polynomial B-spline curve.

    Those whose basis function has no support are 0.
    """
    c = g.curves[row]
    dim, d = int(c.dim), int(c.degree)
    for i in range(c.n - 1):
        gap = g.values[c.knots + i + d + 1] - g.values[c.knots + i + 1]
        scale = d / gap if gap > 0.0 else 0.0
        at = c.points + i * dim
        for k in range(dim):
            first[i, k] = (g.values[at + dim + k] - g.values[at + k]) * scale
    for i in range(c.n - 2):
        gap = g.values[c.knots + i + d + 1] - g.values[c.knots + i + 2]
        scale = (d - 1) / gap if gap > 0.0 else 0.0
        for k in range(dim):
            second[i, k] = (first[i + 1, k] - first[i, k]) * scale


@leaf
def _largest(net: Floats, low: int, high: int, dim: int, out: Floats, norm: int, component: int) -> None:
    """Raise ``out[norm]`` and ``out[component:]`` to the largest norm and components of rows low..high - 1."""
    for i in range(low, high):
        size = 0.0
        for k in range(dim):
            out[component + k] = max(out[component + k], abs(net[i, k]))
            size += net[i, k] * net[i, k]
        out[norm] = max(out[norm], size)


@leaf
def _spline_bounds(g: Tables, row: int, p: CurvePieces, first: Floats, second: Floats, scratch: Floats) -> None:
    """Starts and bounds of all pieces of a polynomial B-spline curve of degree two or more.

    ``first`` and ``second`` (>= n, 3) and ``scratch`` (2, MAX_DEGREE + 2) are room to work in.
    """
    c = g.curves[row]
    dim, d = int(c.dim), int(c.degree)
    _differentiate(g, row, first, second)
    clear = SHORTEST * (c.t1 - c.t0)
    at = c.t0
    i = d + 1
    span = d
    start = local_line(6)
    end = local_line(6)
    if dim == 2:
        curve_point(g, row, at, scratch, start)
    for k in range(p.first[row], p.first[row + 1]):
        low = at
        at, i = _next_break(g, row, low, i)
        p.start[k] = low
        out = p.bounds[k]
        # The spans that meet the piece, but those too short for one of their own.
        while span < c.n - 1 and g.values[c.knots + span + 1] <= low:
            span += 1
        s = span
        while s < c.n and (s == span or g.values[c.knots + s] < at):
            if at - low <= clear or g.values[c.knots + s + 1] - g.values[c.knots + s] > clear:
                _largest(first, s - d, s, dim, out, D1, D1_X)
                _largest(second, s - d, s - 1, dim, out, D2, D2_X)
            s += 1
        out[D1], out[D2] = math.sqrt(out[D1]), math.sqrt(out[D2])
        for m in range(LOW):
            out[m] *= OUTWARD
        if dim > 2:
            # Only the boxes of p-curves are ever asked for.
            for m in range(dim):
                out[LOW + m], out[HIGH + m] = -math.inf, math.inf
            continue
        curve_point(g, row, at, scratch, end)
        for m in range(dim):
            swing = out[D2_X + m] * (at - low) * (at - low) / 8.0
            out[LOW + m], out[HIGH + m] = min(start[m], end[m]) - swing, max(start[m], end[m]) + swing
            start[m] = end[m]


@kernel
def _fill(g: Tables, p: CurvePieces, low: int, high: int) -> None:
    """Starts and bounds of the pieces of curves low..high - 1."""
    most = 2
    for row in range(low, high):
        if p.first[row + 1] > p.first[row] and g.curves[row].kind == NURBS:
            most = max(most, g.curves[row].n)
    net = np.empty((2, most, 3))
    scratch = np.empty((2, MAX_DEGREE + 2))
    for row in range(low, high):
        c = g.curves[row]
        if p.first[row + 1] == p.first[row]:
            continue
        p.bounds[p.first[row] : p.first[row + 1]] = 0.0
        if c.kind == NURBS and c.rational == 0 and c.degree > 1:
            _spline_bounds(g, row, p, net[0], net[1], scratch)
            continue
        at = c.t0
        i = c.degree + 1
        for k in range(p.first[row], p.first[row + 1]):
            end, i = _next_break(g, row, at, i)
            p.start[k] = at
            curve_bounds(g, row, at, end, p.bounds[k])
            at = end


def curve_pieces(g: Tables, run: Run = at_once) -> CurvePieces:
    """Bounds of every piece of every curve of a part.

    Args:
        g: the part's tables, sound (see ``sound_tables``).
        run: maps a kernel over ranges of curves.

    Returns:
        The pieces; a curve of which none can be made has none.
    """
    first = np.zeros(len(g.curves) + 1, np.int64)
    _count(g, first[1:])
    np.cumsum(first, out=first)
    pieces = CurvePieces(first, np.empty(first[-1]), np.empty((first[-1], SIZE)))
    run(lambda low, high: _fill(g, pieces, low, high), len(g.curves))
    return pieces


@leaf
def piece_at(p: CurvePieces, row: int, t: float) -> int:
    """The piece of curve ``row`` that holds ``t``; the curve has one at least."""
    low = p.first[row]
    high = p.first[row + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if p.start[middle] <= t:
            low = middle
        else:
            high = middle
    return low
