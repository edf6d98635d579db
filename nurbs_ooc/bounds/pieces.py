"""Bézier pieces of all B-spline surfaces of a part, each with its derivative bounds and creases.

The pieces of a surface are its non-empty knot spans inside the used domain, cut to that domain, so
the bounds speak of what can be seen. Where a knot has the multiplicity of the degree the surface
may have a crease: no second derivative bounds an interpolant across it, so the jump of the first
derivative is kept and charged instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import net_bounds
from nurbs_ooc.geometry.bspline import blossom
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Pieces(NamedTuple):
    """Piece (i, j) of surface ``s`` is row ``first[s] + i * n_v[s] + j``; its box lies between breaks."""

    first: Ints  # (n_surfaces + 1,)
    n_u: Ints  # (n_surfaces,), 0 for tagged surfaces
    n_v: Ints
    break_u: Ints  # offset of the n_u + 1 break values in ``breaks``
    break_v: Ints
    breaks: Floats
    net: Ints  # (n_pieces + 1,) offset of the flat net in ``nets``
    nets: Floats
    bounds: Floats  # (n_pieces, 5): |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv|
    crease_u: Floats  # like the breaks of u: jump of |S_u| across that break, 0 where smooth or at the ends
    crease_v: Floats


@kernel
def _count(g: Tables, n_u: Ints, n_v: Ints) -> None:
    """Pieces per direction of each surface."""
    for row in range(len(g.surfaces)):
        s = g.surfaces[row]
        n_u[row] = 0
        n_v[row] = 0
        if s.kind != NURBS or s.status == 3:
            continue
        for i in range(s.degree_u, s.n_u):
            a, b = g.values[s.knots_u + i], g.values[s.knots_u + i + 1]
            if a < b and b > s.u0 and a < s.u1:
                n_u[row] += 1
        for i in range(s.degree_v, s.n_v):
            a, b = g.values[s.knots_v + i], g.values[s.knots_v + i + 1]
            if a < b and b > s.v0 and a < s.v1:
                n_v[row] += 1


@helper
def _list_spans(
    g: Tables, knots: int, n: int, degree: int, low: float, high: float, breaks: Floats, spans: Ints
) -> None:
    """Breaks (cut to [low, high]) and span numbers of one direction."""
    at = 0
    for i in range(degree, n):
        a, b = g.values[knots + i], g.values[knots + i + 1]
        if a < b and b > low and a < high:
            breaks[at] = max(a, low)
            breaks[at + 1] = min(b, high)
            spans[at] = i
            at += 1


@helper
def _piece_net(g: Tables, row: int, span_u: int, span_v: int, box: Floats, work: Floats, out: Floats) -> None:
    """Bézier net over ``box`` inside one span, by blossoming along u, then along v."""
    s = g.surfaces[row]
    p, q = s.degree_u, s.degree_v
    dim = 4 if s.rational else 3
    line = work[0]
    for j in range(q + 1):
        for k in range(p + 1):
            for i in range(p + 1):
                at = s.points + ((span_u - p + i) * s.n_v + span_v - q + j) * dim
                for m in range(dim):
                    line[i, m] = g.values[at + m]
            at = (k * (q + 1) + j) * dim
            blossom(g.values, s.knots_u, span_u, p, line[: p + 1, :dim], box[0], box[1], k, out[at : at + dim])
    for i in range(p + 1):
        for j in range(q + 1):
            for m in range(dim):
                work[1, j, m] = out[(i * (q + 1) + j) * dim + m]
        for k in range(q + 1):
            for j in range(q + 1):
                for m in range(dim):
                    line[j, m] = work[1, j, m]
            at = (i * (q + 1) + k) * dim
            blossom(g.values, s.knots_v, span_v, q, line[: q + 1, :dim], box[2], box[3], k, out[at : at + dim])


@helper
def _end_slope(p: Pieces, g: Tables, row: int, piece: int, along_u: bool, at_end: bool, other: int, h: float, out: Floats) -> None:
    """Derivative control vector (affine) of a net's end row across a break; ``other`` runs along it."""
    s = g.surfaces[row]
    dim = 4 if s.rational else 3
    degree = s.degree_u if along_u else s.degree_v
    step = (s.degree_v + 1) * dim if along_u else dim
    base = p.net[piece] + (other * dim if along_u else other * (s.degree_v + 1) * dim)
    near = base + (degree * step if at_end else 0)
    far = base + ((degree - 1) * step if at_end else step)
    sign = 1.0 if at_end else -1.0
    for k in range(3):
        if dim == 4:
            w0, w1 = p.nets[near + 3], p.nets[far + 3]
            out[k] = sign * degree * (w1 / w0) * (p.nets[near + k] / w0 - p.nets[far + k] / w1) / h
        else:
            out[k] = sign * degree * (p.nets[near + k] - p.nets[far + k]) / h


@helper
def _crease(p: Pieces, g: Tables, row: int, along_u: bool, i: int) -> float:
    """Bound of the jump of the first derivative across break ``i`` (1 <= i < n) of a direction."""
    s = g.surfaces[row]
    left = np.empty(3)
    right = np.empty(3)
    degree = s.degree_v if along_u else s.degree_u
    count = p.n_v[row] if along_u else p.n_u[row]
    at = p.break_u[row] if along_u else p.break_v[row]
    h0 = p.breaks[at + i] - p.breaks[at + i - 1]
    h1 = p.breaks[at + i + 1] - p.breaks[at + i]
    worst = 0.0
    scale = 0.0
    for j in range(count):
        a = p.first[row] + ((i - 1) * p.n_v[row] + j if along_u else j * p.n_v[row] + i - 1)
        b = p.first[row] + (i * p.n_v[row] + j if along_u else j * p.n_v[row] + i)
        for k in range(degree + 1):
            _end_slope(p, g, row, a, along_u, True, k, h0, left)
            _end_slope(p, g, row, b, along_u, False, k, h1, right)
            size = 0.0
            for m in range(3):
                size += (left[m] - right[m]) ** 2
                scale = max(scale, abs(left[m]) + abs(right[m]))
            worst = max(worst, math.sqrt(size))
    # Smooth up to roundoff is smooth.
    if worst <= 1e-9 * scale:
        return 0.0
    # Of a rational net the slopes along the break are mixed with weights: charge their spread.
    return worst * (1.0 if s.rational == 0 else 2.0)


@helper
def _multiple(g: Tables, knots: int, n: int, degree: int, value: float) -> bool:
    """Whether ``value`` is an inner knot of multiplicity >= degree."""
    count = 0
    for i in range(degree + 1, n):
        if g.values[knots + i] == value:
            count += 1
    return count >= degree


@kernel
def _fill(g: Tables, p: Pieces) -> None:
    spans_u = np.empty(16, dtype=np.int64)
    spans_v = np.empty(16, dtype=np.int64)
    work = np.empty((2, MAX_DEGREE + 2, 4))
    box = np.empty(4)
    for row in range(len(g.surfaces)):
        if p.n_u[row] == 0 or p.n_v[row] == 0:
            continue
        s = g.surfaces[row]
        if p.n_u[row] > len(spans_u):
            spans_u = np.empty(2 * p.n_u[row], dtype=np.int64)
        if p.n_v[row] > len(spans_v):
            spans_v = np.empty(2 * p.n_v[row], dtype=np.int64)
        breaks_u = p.breaks[p.break_u[row] : p.break_u[row] + p.n_u[row] + 1]
        breaks_v = p.breaks[p.break_v[row] : p.break_v[row] + p.n_v[row] + 1]
        _list_spans(g, s.knots_u, s.n_u, s.degree_u, s.u0, s.u1, breaks_u, spans_u)
        _list_spans(g, s.knots_v, s.n_v, s.degree_v, s.v0, s.v1, breaks_v, spans_v)
        dim = 4 if s.rational else 3
        for i in range(p.n_u[row]):
            for j in range(p.n_v[row]):
                piece = p.first[row] + i * p.n_v[row] + j
                box[0], box[1] = breaks_u[i], breaks_u[i + 1]
                box[2], box[3] = breaks_v[j], breaks_v[j + 1]
                net = p.nets[p.net[piece] : p.net[piece + 1]]
                _piece_net(g, row, spans_u[i], spans_v[j], box, work, net)
                net_bounds(net, s.degree_u, s.degree_v, dim, box[1] - box[0], box[3] - box[2], p.bounds[piece])
        for i in range(1, p.n_u[row]):
            if _multiple(g, s.knots_u, s.n_u, s.degree_u, breaks_u[i]):
                p.crease_u[p.break_u[row] + i] = _crease(p, g, row, True, i)
        for j in range(1, p.n_v[row]):
            if _multiple(g, s.knots_v, s.n_v, s.degree_v, breaks_v[j]):
                p.crease_v[p.break_v[row] + j] = _crease(p, g, row, False, j)


@kernel
def _net_offsets(g: Tables, n_u: Ints, n_v: Ints, net: Ints) -> None:
    at = 0
    for row in range(len(g.surfaces)):
        s = g.surfaces[row]
        size = (s.degree_u + 1) * (s.degree_v + 1) * (4 if s.rational else 3)
        for _ in range(n_u[row] * n_v[row]):
            net[at + 1] = net[at] + size
            at += 1


def bezier_pieces(g: Tables) -> Pieces:
    """Cut all B-spline surfaces of a part into Bézier pieces with bounds.

    Args:
        g: the part's tables; FAILED surfaces get no pieces.

    Returns:
        The pieces; tagged surfaces have none.
    """
    n = len(g.surfaces)
    n_u, n_v = np.zeros(n, np.int64), np.zeros(n, np.int64)
    _count(g, n_u, n_v)
    first = np.concatenate([[0], np.cumsum(n_u * n_v)]).astype(np.int64)
    counts = np.where(n_u > 0, n_u + 1, 0), np.where(n_v > 0, n_v + 1, 0)
    starts = np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int64)
    breaks = np.zeros(int(starts[-1]))
    net = np.zeros(int(first[-1]) + 1, np.int64)
    _net_offsets(g, n_u, n_v, net)
    nets = np.zeros(int(net[-1]))
    bounds = np.zeros((int(first[-1]), 5))
    pieces = Pieces(
        first, n_u, n_v, starts[:n].copy(), starts[n : 2 * n].copy(), breaks, net, nets, bounds,
        np.zeros_like(breaks), np.zeros_like(breaks),
    )  # fmt: skip
    _fill(g, pieces)
    return pieces


@helper
def find_break(p: Pieces, at: int, n: int, t: float) -> int:
    """The piece number in [0, n - 1] of one direction that holds ``t``."""
    low = 0
    high = n
    while high - low > 1:
        middle = (low + high) // 2
        if p.breaks[at + middle] <= t:
            low = middle
        else:
            high = middle
    return low


@helper
def box_bounds(
    g: Tables, p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float, work: Floats, out: Floats
) -> None:
    """Derivative bounds over a parameter box of any surface: closed form, or the largest of the pieces it meets."""
    if g.surfaces[row].kind != NURBS:
        closed_form_bounds(g, row, u0, u1, v0, v1, work, out)
        return
    for k in range(5):
        out[k] = 0.0
    i0 = find_break(p, p.break_u[row], p.n_u[row], u0)
    j0 = find_break(p, p.break_v[row], p.n_v[row], v0)
    i = i0
    while i < p.n_u[row] and (i == i0 or p.breaks[p.break_u[row] + i] < u1):
        j = j0
        while j < p.n_v[row] and (j == j0 or p.breaks[p.break_v[row] + j] < v1):
            piece = p.first[row] + i * p.n_v[row] + j
            for k in range(5):
                out[k] = max(out[k], p.bounds[piece, k])
            j += 1
        i += 1


@helper
def crease_charge(p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float) -> float:
    """What creases inside the open box add to the deviation of a linear interpolant over it, mm.

    A function with slope jump J at distance x from one end and y from the other of an interval
    deviates from its chord by J x y / (x + y) there.
    """
    charge = 0.0
    for direction in range(2):
        n = p.n_u[row] if direction == 0 else p.n_v[row]
        if n < 2:
            continue
        at = p.break_u[row] if direction == 0 else p.break_v[row]
        low = u0 if direction == 0 else v0
        high = u1 if direction == 0 else v1
        i = find_break(p, at, n, low) + 1
        while i < n and p.breaks[at + i] < high:
            jump = p.crease_u[at + i] if direction == 0 else p.crease_v[at + i]
            if jump > 0.0:
                x = p.breaks[at + i] - low
                y = high - p.breaks[at + i]
                if x > 0.0 and y > 0.0:
                    charge += jump * x * y / (x + y)
            i += 1
    return charge
