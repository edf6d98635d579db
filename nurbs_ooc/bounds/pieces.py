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

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import net_bounds
from nurbs_ooc.geometry.bspline import blossom
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


# Files end a face's domain a few units of roundoff beyond a knot: a cut span this thin, relative to the
# domain, is left to its neighbour. Its own bounds would be differences of roundoff.
SLIVER = 1e-9
# Columns of ``Pieces.table``.
FIRST, N_U, N_V, BREAK_U, BREAK_V, NET = 0, 1, 2, 3, 4, 5


class Pieces(NamedTuple):
    """Piece (i, j) of a surface is row ``FIRST + i * N_V + j``; its box lies between breaks."""

    table: Ints  # (n_surfaces, 6): first piece, pieces in u and v (0 for tagged surfaces), offsets of breaks and nets
    breaks: Floats  # (n, 2): value; jump of the first derivative across it, 0 where smooth and at the ends
    nets: Floats  # flat nets, piece after piece
    bounds: Floats  # (n_pieces, 5): |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv|


@leaf
def net_range(g: Tables, p: Pieces, row: int, piece: int) -> tuple[int, int]:
    """Where in ``nets`` the flat net (degree_u + 1, degree_v + 1, 3 or 4) of a piece begins and ends."""
    s = g.surfaces[row]
    size = (s.degree_u + 1) * (s.degree_v + 1) * (4 if s.rational else 3)
    at = p.table[row, NET] + (piece - p.table[row, FIRST]) * size
    return at, at + size


@leaf
def _overlaps(a: float, b: float, low: float, high: float) -> bool:
    """Whether the span [a, b] has a part in the domain that is more than a domain end beside a knot."""
    if not a < b:
        return False
    if a >= low and b <= high:
        return True
    return min(b, high) - max(a, low) > SLIVER * (high - low)


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
            if _overlaps(g.values[s.knots_u + i], g.values[s.knots_u + i + 1], s.u0, s.u1):
                n_u[row] += 1
        for i in range(s.degree_v, s.n_v):
            if _overlaps(g.values[s.knots_v + i], g.values[s.knots_v + i + 1], s.v0, s.v1):
                n_v[row] += 1


@leaf
def _list_spans(
    g: Tables, knots: int, n: int, degree: int, low: float, high: float, breaks: Floats, spans: Ints
) -> None:
    """Breaks (cut to [low, high]) and span numbers of one direction."""
    at = 0
    for i in range(degree, n):
        a, b = g.values[knots + i], g.values[knots + i + 1]
        if _overlaps(a, b, low, high):
            breaks[at, 0] = max(a, low)
            breaks[at + 1, 0] = min(b, high)
            spans[at] = i
            at += 1


@leaf
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


@leaf
def _end_slope(
    p: Pieces, g: Tables, row: int, piece: int, along_u: bool, at_end: bool, other: int, h: float, out: Floats
) -> None:
    """Derivative control vector (affine) of a net's end row across a break; ``other`` runs along it."""
    s = g.surfaces[row]
    dim = 4 if s.rational else 3
    degree = s.degree_u if along_u else s.degree_v
    step = (s.degree_v + 1) * dim if along_u else dim
    base = p.table[row, NET] + (piece - p.table[row, FIRST]) * (s.degree_u + 1) * (s.degree_v + 1) * dim
    base += other * dim if along_u else other * (s.degree_v + 1) * dim
    near = base + (degree * step if at_end else 0)
    far = base + ((degree - 1) * step if at_end else step)
    sign = 1.0 if at_end else -1.0
    for k in range(3):
        if dim == 4:
            w0, w1 = p.nets[near + 3], p.nets[far + 3]
            out[k] = sign * degree * (w1 / w0) * (p.nets[near + k] / w0 - p.nets[far + k] / w1) / h
        else:
            out[k] = sign * degree * (p.nets[near + k] - p.nets[far + k]) / h


@leaf
def _crease(p: Pieces, g: Tables, row: int, along_u: bool, i: int) -> float:
    """Bound of the jump of the first derivative across break ``i`` (1 <= i < n) of a direction."""
    s = g.surfaces[row]
    left = local_line(3)
    right = local_line(3)
    degree = s.degree_v if along_u else s.degree_u
    count = p.table[row, N_V] if along_u else p.table[row, N_U]
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    h0 = p.breaks[at + i, 0] - p.breaks[at + i - 1, 0]
    h1 = p.breaks[at + i + 1, 0] - p.breaks[at + i, 0]
    worst = 0.0
    scale = 0.0
    for j in range(count):
        a = p.table[row, FIRST] + ((i - 1) * p.table[row, N_V] + j if along_u else j * p.table[row, N_V] + i - 1)
        b = p.table[row, FIRST] + (i * p.table[row, N_V] + j if along_u else j * p.table[row, N_V] + i)
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


@leaf
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
        if p.table[row, N_U] == 0 or p.table[row, N_V] == 0:
            continue
        s = g.surfaces[row]
        if p.table[row, N_U] > len(spans_u):
            spans_u = np.empty(2 * p.table[row, N_U], dtype=np.int64)
        if p.table[row, N_V] > len(spans_v):
            spans_v = np.empty(2 * p.table[row, N_V], dtype=np.int64)
        breaks_u = p.breaks[p.table[row, BREAK_U] : p.table[row, BREAK_U] + p.table[row, N_U] + 1]
        breaks_v = p.breaks[p.table[row, BREAK_V] : p.table[row, BREAK_V] + p.table[row, N_V] + 1]
        _list_spans(g, s.knots_u, s.n_u, s.degree_u, s.u0, s.u1, breaks_u, spans_u)
        _list_spans(g, s.knots_v, s.n_v, s.degree_v, s.v0, s.v1, breaks_v, spans_v)
        dim = 4 if s.rational else 3
        for i in range(p.table[row, N_U]):
            for j in range(p.table[row, N_V]):
                piece = p.table[row, FIRST] + i * p.table[row, N_V] + j
                box[0], box[1] = breaks_u[i, 0], breaks_u[i + 1, 0]
                box[2], box[3] = breaks_v[j, 0], breaks_v[j + 1, 0]
                start, end = net_range(g, p, row, piece)
                net = p.nets[start:end]
                _piece_net(g, row, spans_u[i], spans_v[j], box, work, net)
                net_bounds(net, s.degree_u, s.degree_v, dim, box[1] - box[0], box[3] - box[2], p.bounds[piece])
        for i in range(1, p.table[row, N_U]):
            if _multiple(g, s.knots_u, s.n_u, s.degree_u, breaks_u[i, 0]):
                p.breaks[p.table[row, BREAK_U] + i, 1] = _crease(p, g, row, True, i)
        for j in range(1, p.table[row, N_V]):
            if _multiple(g, s.knots_v, s.n_v, s.degree_v, breaks_v[j, 0]):
                p.breaks[p.table[row, BREAK_V] + j, 1] = _crease(p, g, row, False, j)


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
    s = g.surfaces
    size = (s["degree_u"].astype(np.int64) + 1) * (s["degree_v"] + 1) * np.where(s["rational"] != 0, 4, 3)
    table = np.zeros((n, 6), np.int64)
    table[:, N_U], table[:, N_V] = n_u, n_v
    totals = []
    for column, counts in (
        (FIRST, n_u * n_v),
        (BREAK_U, np.where(n_u > 0, n_u + n_v + 2, 0)),
        (NET, n_u * n_v * size),
    ):
        ends = np.cumsum(counts)
        table[:, column] = ends - counts
        totals.append(int(ends[-1]) if n else 0)
    table[:, BREAK_V] = table[:, BREAK_U] + n_u + 1
    pieces = Pieces(table, np.zeros((totals[1], 2)), np.zeros(totals[2]), np.zeros((totals[0], 5)))
    _fill(g, pieces)
    return pieces


@leaf
def find_break(p: Pieces, at: int, n: int, t: float) -> int:
    """The piece number in [0, n - 1] of one direction that holds ``t``."""
    low = 0
    high = n
    while high - low > 1:
        middle = (low + high) // 2
        if p.breaks[at + middle, 0] <= t:
            low = middle
        else:
            high = middle
    return low


@leaf
def box_bounds(
    g: Tables, p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float, work: Floats, out: Floats
) -> None:
    """Derivative bounds over a parameter box of any surface: closed form, or the largest of the pieces it meets."""
    if g.surfaces[row].kind != NURBS:
        closed_form_bounds(g, row, u0, u1, v0, v1, work, out)
        return
    for k in range(5):
        out[k] = 0.0
    i0 = find_break(p, p.table[row, BREAK_U], p.table[row, N_U], u0)
    j0 = find_break(p, p.table[row, BREAK_V], p.table[row, N_V], v0)
    i = i0
    while i < p.table[row, N_U] and (i == i0 or p.breaks[p.table[row, BREAK_U] + i, 0] < u1):
        j = j0
        while j < p.table[row, N_V] and (j == j0 or p.breaks[p.table[row, BREAK_V] + j, 0] < v1):
            piece = p.table[row, FIRST] + i * p.table[row, N_V] + j
            for k in range(5):
                out[k] = max(out[k], p.bounds[piece, k])
            j += 1
        i += 1


@leaf
def crease_charge(p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float) -> float:
    """What creases inside the open box add to the deviation of a linear interpolant over it, mm.

    A function with slope jump J at distance x from one end and y from the other of an interval
    deviates from its chord by J x y / (x + y) there.
    """
    charge = 0.0
    for direction in range(2):
        n = p.table[row, N_U] if direction == 0 else p.table[row, N_V]
        if n < 2:
            continue
        at = p.table[row, BREAK_U] if direction == 0 else p.table[row, BREAK_V]
        low = u0 if direction == 0 else v0
        high = u1 if direction == 0 else v1
        i = find_break(p, at, n, low) + 1
        while i < n and p.breaks[at + i, 0] < high:
            jump = p.breaks[at + i, 1]
            if jump > 0.0:
                x = p.breaks[at + i, 0] - low
                y = high - p.breaks[at + i, 0]
                if x > 0.0 and y > 0.0:
                    charge += jump * x * y / (x + y)
            i += 1
    return charge
