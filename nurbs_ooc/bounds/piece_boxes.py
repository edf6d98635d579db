"""What the pieces of a surface say of a parameter box: bounds, boxes of second derivatives, creases."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.creases import crease_charge
from nurbs_ooc.bounds.derivatives import BOXES, MUU, net_bounds, weight_spread
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, CREASED, FIRST, N_U, N_V, Pieces
from nurbs_ooc.bounds.triangle_bound import box_radii
from nurbs_ooc.geometry.bezier_net import NET, bezier_net
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Weights of a piece further apart than this: a conic's are 2, a sphere's 4. Each bound carries a power of it.
FAR_APART = 16.0
# A line along which derivatives are sought becomes a strip of such a part of its piece, wide if weights allow.
MODEST = 2.0
WIDEST = 2.0**-6
NARROWEST = 2.0**-30


@leaf
def unite(boxes: Floats, out: Floats) -> None:
    """Grow the boxes ``out`` (BOXES,) so that they hold ``boxes``."""
    for m in range(3):
        for k in range(3):
            out[6 * m + k] = min(out[6 * m + k], boxes[6 * m + k])
            out[6 * m + 3 + k] = max(out[6 * m + 3 + k], boxes[6 * m + 3 + k])


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
def pieces_met(p: Pieces, at: int, n: int, low: float, high: float) -> tuple[int, int]:
    """First and last plus one of the ``n`` pieces of one direction that meet [low, high]; one at least."""
    first = find_break(p, at, n, low)
    end = first + 1
    while end < n and p.breaks[at + end, 0] < high:
        end += 1
    return first, end


@leaf
def _widened(low: float, high: float, start: float, end: float, share: float) -> tuple[float, float]:
    """[low, high], or if that is a point an interval around it of ``share`` of [start, end], inside that."""
    if high - low >= NARROWEST * (end - start):
        return low, high
    width = share * (end - start)
    low = max(start, min(low - 0.5 * width, end - width))
    return low, min(end, low + width)


@leaf
def _line_bounds(g: Tables, p: Pieces, row: int, i: int, j: int, box: Floats, out: Floats) -> None:
    """Derivative bounds (5,) over the part in piece (i, j) of a ``box`` that may be a line or a point.

    A line is given some width, for derivatives across it are differences.
    """
    s = g.surfaces[row]
    n = (s.degree_u + 1) * (s.degree_v + 1)
    at_u, at_v = p.table[row, BREAK_U] + i, p.table[row, BREAK_V] + j
    start_u, end_u, start_v, end_v = p.breaks[at_u, 0], p.breaks[at_u + 1, 0], p.breaks[at_v, 0], p.breaks[at_v + 1, 0]
    u0, u1 = min(max(box[0], start_u), end_u), max(min(box[1], end_u), start_u)
    v0, v1 = min(max(box[2], start_v), end_v), max(min(box[3], end_v), start_v)
    net = local_line(NET)
    boxes = local_line(BOXES)
    share = WIDEST
    while True:
        a, b = _widened(u0, u1, start_u, end_u, share)
        c, d = _widened(v0, v1, start_v, end_v, share)
        bezier_net(g, row, a, b, c, d, net)
        if share <= NARROWEST or weight_spread(net, n) <= MODEST or (a == u0 and b == u1 and c == v0 and d == v1):
            break
        share *= 0.5
    net_bounds(net, s.degree_u, s.degree_v, 4, b - a, d - c, out, boxes)


@leaf
def box_bounds(g: Tables, p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> None:
    """Derivative bounds (5,) over a parameter box of any surface: closed form, or the largest of its pieces there.

    Where weights are far apart a piece's bounds are of no use; they are found anew on its part of the box.
    """
    if g.surfaces[row].kind != NURBS:
        closed_form_bounds(g, row, u0, u1, v0, v1, out)
        return
    for k in range(5):
        out[k] = 0.0
    box = local_line(4)
    box[0], box[1], box[2], box[3] = u0, u1, v0, v1
    i0, i1 = pieces_met(p, p.table[row, BREAK_U], p.table[row, N_U], u0, u1)
    j0, j1 = pieces_met(p, p.table[row, BREAK_V], p.table[row, N_V], v0, v1)
    for i in range(i0, i1):
        for j in range(j0, j1):
            piece = p.table[row, FIRST] + i * p.table[row, N_V] + j
            part = p.bounds[piece]
            if p.spread[piece] > FAR_APART:
                part = local_line(5)
                _line_bounds(g, p, row, i, j, box, part)
            for k in range(5):
                out[k] = max(out[k], part[k])


@leaf
def _boxes_of_pieces(p: Pieces, row: int, i0: int, i1: int, j0: int, j1: int, out: Floats) -> None:
    """The box of each second derivative over pieces [i0, i1) x [j0, j1), to ``out`` (BOXES,)."""
    for m in range(3):
        for k in range(3):
            out[6 * m + k], out[6 * m + 3 + k] = np.inf, -np.inf
    for i in range(i0, i1):
        for j in range(j0, j1):
            unite(p.boxes[p.table[row, FIRST] + i * p.table[row, N_V] + j], out)


@leaf
def box_boxes(p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> None:
    """The box of each second derivative over a parameter box of a B-spline surface, to ``out`` (BOXES,)."""
    i0, i1 = pieces_met(p, p.table[row, BREAK_U], p.table[row, N_U], u0, u1)
    j0, j1 = pieces_met(p, p.table[row, BREAK_V], p.table[row, N_V], v0, v1)
    _boxes_of_pieces(p, row, i0, i1, j0, j1, out)


@leaf
def second_of_pieces(p: Pieces, row: int, i0: int, i1: int, j0: int, j1: int, out: Floats) -> None:
    """Second-derivative bounds of pieces [i0, i1) x [j0, j1) as they are known, to ``out`` (MEASURES,)."""
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    for i in range(i0, i1):
        for j in range(j0, j1):
            bounds = p.bounds[p.table[row, FIRST] + i * p.table[row, N_V] + j]
            for k in range(3):
                out[k] = max(out[k], bounds[MUU + k])
    _boxes_of_pieces(p, row, i0, i1, j0, j1, out[3:])
    box_radii(out)


@leaf
def creases_in_box(p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float) -> float:
    """What creases add to the deviation of a linear interpolant over a parameter box, mm."""
    if p.table[row, CREASED] == 0:
        return 0.0
    charge = 0.0
    for direction in range(2):
        n = p.table[row, N_U] if direction == 0 else p.table[row, N_V]
        if n > 1:
            at = p.table[row, BREAK_U] if direction == 0 else p.table[row, BREAK_V]
            low, high = (u0, u1) if direction == 0 else (v0, v1)
            charge += crease_charge(p.breaks[at : at + n + 1], n, find_break(p, at, n, low), low, high)
    return charge
