"""The knot spans of all B-spline surfaces of a part, each with its derivative bounds, and their creases.

The pieces of a surface are its non-empty knot spans inside the used domain. Where a knot has the
multiplicity of the degree the surface may have a crease (see ``creases``). Surfaces that sweep a profile
with such knots have breaks too, for the creases alone: their bounds are in closed form.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_table
from nurbs_ooc.bounds.creases import JUMP, VALUE, is_multiple, profile_jump, slope_jump
from nurbs_ooc.bounds.curve_bounds import NURBS as NURBS_CURVE
from nurbs_ooc.bounds.derivatives import BOXES, net_bounds, weight_spread
from nurbs_ooc.bounds.spline_bounds import Spans, spline_bounds
from nurbs_ooc.geometry.bezier_net import LINE, net_of_span
from nurbs_ooc.geometry.bspline import bezier_weights, find_span
from nurbs_ooc.geometry.ranges import Run, at_once
from nurbs_ooc.geometry.surface import EXTRUSION, NURBS, REVOLUTION
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


# Files end a face's domain a few units of roundoff beyond a knot: a cut span this thin, relative to the
# domain, is left to its neighbour. Its own bounds would be differences of roundoff.
SLIVER = 1e-9
# Columns of ``Pieces.table``.
FIRST, N_U, N_V, BREAK_U, BREAK_V, CREASED = 0, 1, 2, 3, 4, 5


class Pieces(NamedTuple):
    """Piece (i, j) of a surface is row ``FIRST + i * N_V + j``; its box lies between breaks."""

    table: (
        Ints  # (n_surfaces, 6): first piece, pieces in u and v (0: none, no breaks either), offsets of breaks, CREASED
    )
    breaks: Floats  # (n, 4): value, and what ``creases`` says of it
    bounds: Floats  # (n_pieces, 5): |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv|
    boxes: Floats  # (n_pieces, BOXES): boxes of the vectors S_uu, S_uv, S_vv
    spread: Floats  # (n_pieces,) largest over smallest weight of the piece's net; 1 for polynomials


@leaf
def _overlaps(a: float, b: float, low: float, high: float) -> bool:
    """Whether the span [a, b] has a part in the domain that is more than a domain end beside a knot."""
    if not a < b:
        return False
    if a >= low and b <= high:
        return True
    return min(b, high) - max(a, low) > SLIVER * (high - low)


@leaf
def _profile_range(g: Tables, row: int) -> tuple[float, float]:
    """Parameters of its profile that a swept surface uses."""
    s = g.surfaces[row]
    low, high = (s.u0, s.u1) if s.kind == EXTRUSION else (s.v0, s.v1)
    return float(low), float(high)


@leaf
def _profile_spans(g: Tables, row: int) -> int:
    """Knot spans of a swept surface's profile in use; 0 if the profile cannot have a kink."""
    c = g.curves[g.surfaces[row].profile]
    low, high = _profile_range(g, row)
    if c.kind != NURBS_CURVE:
        return 0
    n = 0
    kinks = False
    for i in range(c.degree, c.n):
        a, b = g.values[c.knots + i], g.values[c.knots + i + 1]
        if _overlaps(a, b, low, high):
            kinks = kinks or (n > 0 and is_multiple(g, c.knots, c.n, c.degree, a))
            n += 1
    return n if kinks else 0


@leaf
def _count(g: Tables, row: int) -> tuple[int, int]:
    """Pieces per direction of a surface."""
    s = g.surfaces[row]
    if s.status == 3:
        return 0, 0
    if s.kind == REVOLUTION or s.kind == EXTRUSION:
        n = _profile_spans(g, row)
        return (n, min(n, 1)) if s.kind == EXTRUSION else (min(n, 1), n)
    if s.kind != NURBS:
        return 0, 0
    n_u, n_v = 0, 0
    for i in range(s.degree_u, s.n_u):
        if _overlaps(g.values[s.knots_u + i], g.values[s.knots_u + i + 1], s.u0, s.u1):
            n_u += 1
    for i in range(s.degree_v, s.n_v):
        if _overlaps(g.values[s.knots_v + i], g.values[s.knots_v + i + 1], s.v0, s.v1):
            n_v += 1
    return n_u, n_v


@kernel
def _lay_out(g: Tables, table: Ints) -> tuple[int, int]:
    """Fill the table; how many pieces and breaks there are."""
    pieces, breaks = 0, 0
    for row in range(len(g.surfaces)):
        n_u, n_v = _count(g, row)
        table[row, N_U], table[row, N_V], table[row, CREASED] = n_u, n_v, 0
        table[row, FIRST], table[row, BREAK_U], table[row, BREAK_V] = pieces, breaks, breaks + n_u + 1
        pieces += n_u * n_v
        if n_u > 0:
            breaks += n_u + n_v + 2
    return pieces, breaks


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
def _rational_bounds(g: Tables, p: Pieces, row: int, breaks_u: Floats, breaks_v: Floats, net: Floats) -> None:
    """Bounds of the pieces of a rational surface, from their Bézier nets."""
    s = g.surfaces[row]
    along_u = local_table(LINE, LINE)
    along_v = local_table(LINE, LINE)
    for j in range(p.table[row, N_V]):
        v0, v1 = breaks_v[j, 0], breaks_v[j + 1, 0]
        span_v = find_span(g.values, s.knots_v, s.n_v, s.degree_v, 0.5 * (v0 + v1))
        bezier_weights(g.values, s.knots_v, span_v, s.degree_v, v0, v1, along_v)
        for i in range(p.table[row, N_U]):
            u0, u1 = breaks_u[i, 0], breaks_u[i + 1, 0]
            span_u = find_span(g.values, s.knots_u, s.n_u, s.degree_u, 0.5 * (u0 + u1))
            bezier_weights(g.values, s.knots_u, span_u, s.degree_u, u0, u1, along_u)
            dim = net_of_span(g, row, span_u, span_v, along_u, along_v, net)
            piece = p.table[row, FIRST] + i * p.table[row, N_V] + j
            net_bounds(net, s.degree_u, s.degree_v, dim, u1 - u0, v1 - v0, p.bounds[piece], p.boxes[piece])
            p.spread[piece] = weight_spread(net, (s.degree_u + 1) * (s.degree_v + 1))


@leaf
def _jumps(g: Tables, row: int, along_u: bool, n: int, breaks: Floats, across: Floats, m: int, nets: Floats) -> None:
    """Find the creases among the ``n`` spans of one direction; ``across`` are the m spans' breaks of the other."""
    s = g.surfaces[row]
    knots, count, degree = (s.knots_u, s.n_u, s.degree_u) if along_u else (s.knots_v, s.n_v, s.degree_v)
    for i in range(1, n):
        if is_multiple(g, knots, count, degree, breaks[i, 0]):
            t0, t, t1 = breaks[i - 1, 0], breaks[i, 0], breaks[i + 1, 0]
            breaks[i, 1] = slope_jump(g, row, along_u, t0, t, t1, across, m, nets[0], nets[1])


@leaf
def _profile_breaks(g: Tables, p: Pieces, row: int, spans: Ints) -> None:
    """Breaks of a swept surface: the knots of its profile, with their kinks, and the ends of the other direction."""
    s = g.surfaces[row]
    c = g.curves[s.profile]
    low, high = _profile_range(g, row)
    along_u = s.kind == EXTRUSION
    at, across = p.table[row, BREAK_U], p.table[row, BREAK_V]
    p.breaks[across, VALUE], p.breaks[across + 1, VALUE] = s.v0, s.v1
    n = p.table[row, N_U]
    if not along_u:
        at, across = across, at
        p.breaks[across, VALUE], p.breaks[across + 1, VALUE] = s.u0, s.u1
        n = p.table[row, N_V]
    breaks = p.breaks[at : at + n + 1]
    _list_spans(g, c.knots, c.n, c.degree, low, high, breaks, spans)
    for i in range(1, n):
        if is_multiple(g, c.knots, c.n, c.degree, breaks[i, VALUE]):
            breaks[i, JUMP] = profile_jump(g, s.profile, breaks[i - 1, VALUE], breaks[i, VALUE], breaks[i + 1, VALUE])


@leaf
def any_crease(p: Pieces, row: int) -> bool:
    """Whether a surface has a crease at all."""
    at = p.table[row, BREAK_U]
    for k in range(at, at + p.table[row, N_U] + p.table[row, N_V] + 2):
        if p.breaks[k, JUMP] > 0.0:
            return True
    return False


@kernel
def _fill(g: Tables, p: Pieces, low: int, high: int) -> None:
    """Breaks, bounds and creases of surfaces low..high - 1."""
    nets = np.empty((2, (MAX_DEGREE + 1) * (MAX_DEGREE + 1) * 4))
    most = 16
    for row in range(low, high):
        if p.table[row, N_U] > 0:
            most = max(most, g.surfaces[row].n_u * g.surfaces[row].n_v, p.table[row, N_U], p.table[row, N_V])
    spans = np.empty((2, most), dtype=np.int64)
    scratch = np.empty((3, 3 * most))
    for row in range(low, high):
        n_u, n_v = p.table[row, N_U], p.table[row, N_V]
        if n_u == 0 or n_v == 0:
            continue
        s = g.surfaces[row]
        first = p.table[row, FIRST]
        last = first + n_u * n_v
        if s.kind != NURBS:
            p.bounds[first:last] = 0.0
            p.boxes[first:last] = 0.0
            _profile_breaks(g, p, row, spans[0])
            p.table[row, CREASED] = any_crease(p, row)
            continue
        breaks_u = p.breaks[p.table[row, BREAK_U] : p.table[row, BREAK_U] + n_u + 1]
        breaks_v = p.breaks[p.table[row, BREAK_V] : p.table[row, BREAK_V] + n_v + 1]
        _list_spans(g, s.knots_u, s.n_u, s.degree_u, s.u0, s.u1, breaks_u, spans[0])
        _list_spans(g, s.knots_v, s.n_v, s.degree_v, s.v0, s.v1, breaks_v, spans[1])
        if s.rational:
            _rational_bounds(g, p, row, breaks_u, breaks_v, nets[0])
        else:
            used = Spans(spans[0], n_u, spans[1], n_v, s.degree_u, s.degree_v)
            spline_bounds(g, row, used, scratch, p.bounds[first:last], p.boxes[first:last])
        _jumps(g, row, True, n_u, breaks_u, breaks_v, n_v, nets)
        _jumps(g, row, False, n_v, breaks_v, breaks_u, n_u, nets)
        p.table[row, CREASED] = any_crease(p, row)


def plain_pieces(g: Tables, run: Run = at_once) -> Pieces:
    """The pieces of all B-spline surfaces of a part, with bounds; no strip is taken for a crease yet.

    Args:
        g: the part's tables; FAILED surfaces get no pieces.
        run: maps a kernel over ranges of surfaces.

    Returns:
        The pieces; tagged surfaces have none, or breaks alone.
    """
    table = np.empty((len(g.surfaces), 6), np.int64)
    n_pieces, n_breaks = _lay_out(g, table)
    breaks, bounds, boxes = np.zeros((n_breaks, 4)), np.empty((n_pieces, 5)), np.empty((n_pieces, BOXES))
    pieces = Pieces(table, breaks, bounds, boxes, np.ones(n_pieces))
    run(lambda low, high: _fill(g, pieces, low, high), len(g.surfaces))
    return pieces
