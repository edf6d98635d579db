"""How densely an edge must be sampled: along it, bounds of second derivatives in units of the error.

Every edge is cut where any of its curves (the 3D curve and the p-curve of each face that uses it)
has a knot, so that on each interval second derivatives are bounded. From them follow, per interval
and in units of the allowed error, three demands: the chord in space, the sliver between p-curve and
its chord carried into space, and the surface's own deviation along the chord. An edge that lies on its
surface by definition has no chord of its own: the other two hold it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_cache.surface_record import POLE
from nurbs_ooc.bounds.curve_bounds import D1_X, D2, D2_X, SIZE, curve_bounds
from nurbs_ooc.bounds.curve_pieces import CurvePieces, piece_at
from nurbs_ooc.bounds.derivatives import LU, LV, MUU, MUV, MVV
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.curve import NURBS
from nurbs_ooc.geometry.surface import CONE, PLANE, REVOLUTION, SPHERE, TORUS
from nurbs_ooc.geometry.surface import NURBS as NURBS_SURFACE
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.beside_edges import BesideEdges, bounds_beside
from nurbs_ooc.tessellation.edge_uses import EdgeUses

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.uint8]
Ints = npt.NDArray[np.int64]

# Share of the error that slivers of curved p-curves may take on curved surfaces; the rest is the surface's.
TRIM_SHARE = 0.25
# The surface's deviation along the boundary leaves at least this share to the direction across it.
ACROSS_SHARE = 0.5
# A twist below this share of the error is none.
TWIST_SHARE = 0.01
# Along a pole there are to be more samples than rows of grids.
POLE_SHARE = 0.25
# An interval that needs several samples is measured again in halves while these are less demanding, or still need
# many, to so many parts.
SEVERAL = 1.5
MANY = 8.0
PAYS = 0.8
MAX_PARTS = 64
MAX_HALVINGS = 30
LEVELS = MAX_HALVINGS + 1
# Breaks closer than this part of the edge are one.
SAME_BREAK = 1e-12
# Faces at one edge whose slivers are told apart; those of further ones count as the largest.
MAX_USES = 8


class Demand(NamedTuple):
    """Intervals of one edge: interval k lies between breaks k and k + 1. Rows beyond its count are scratch."""

    breaks: Floats  # (n + 1,)
    fixed: Flags  # (n + 1,) 1: a sample must lie here
    demand: Floats  # (n,) bound of second derivatives in units of the error
    bend: Floats  # (n,) the surfaces' own part of the demand
    sliver: Floats  # (MAX_USES, n) mm, by use: second-derivative bound of the sliver beside the p-curve's chord
    knots: Floats  # scratch
    full: Flags  # scratch
    trims: Floats  # (MAX_USES,) scratch


@leaf
def _add_knots(g: Tables, row: int, t0: float, t1: float, breaks: Floats, forced: Flags, n: int) -> int:
    """Append the inner knots of curve ``row``, mapped to the edge's [t0, t1]; full knots are forced."""
    c = g.curves[row]
    if c.kind != NURBS:
        return n
    scale = (t1 - t0) / (c.t1 - c.t0)
    i = c.degree + 1
    while i < c.n:
        knot = g.values[c.knots + i]
        multiplicity = 1
        while i + multiplicity < c.n and g.values[c.knots + i + multiplicity] == knot:
            multiplicity += 1
        if c.t0 < knot < c.t1:
            breaks[n] = t0 + (knot - c.t0) * scale
            forced[n] = 1 if multiplicity >= c.degree else 0
            n += 1
        i += multiplicity
    return n


@leaf
def _sort_breaks(breaks: Floats, forced: Flags, n: int) -> int:
    """Sort in place (runs of a few sorted lists) and merge those that are the same; the ends stay as they are."""
    span = breaks[1] - breaks[0]
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            value, flag = breaks[i], forced[i]
            k = i
            while k >= gap and breaks[k - gap] > value:
                breaks[k], forced[k] = breaks[k - gap], forced[k - gap]
                k -= gap
            breaks[k], forced[k] = value, flag
        gap //= 3
    m = 1
    for i in range(1, n):
        if breaks[i] - breaks[m - 1] <= SAME_BREAK * span:
            forced[m - 1] = max(forced[m - 1], forced[i])
            continue
        breaks[m], forced[m] = breaks[i], forced[i]
        m += 1
    return m


@leaf
def _bounds(g: Tables, c: CurvePieces, row: int, a: float, b: float, exact: bool, out: Floats) -> int:
    """Bounds of curve ``row`` over [a, b]: its own if ``exact``, else those of the whole piece around.

    Returns the number of that piece among those of the curve.
    """
    if exact:
        curve_bounds(g, row, a, b, out)
        return 0
    k = piece_at(c, row, 0.5 * (a + b))
    for i in range(SIZE):
        out[i] = c.bounds[k, i]
    return int(k - c.first[row])


@leaf
def _turned_mixed(g: Tables, row: int, bounds: Floats) -> float:
    """Bound of |S_uv| of a surface of revolution, of which its triangles' own bound is free.

    A chord of a boundary that runs aslant lies on the surface's own triangles, but not where the boundary
    runs: it is off to the side, and so belongs to the trim error. |S_uv| is the part of S_v away from the axis.
    """
    s = g.surfaces[row]
    if s.kind == CONE:
        return abs(math.sin(g.values[s.frame + 13]))
    if s.kind == SPHERE or s.kind == TORUS or s.kind == REVOLUTION:
        return float(bounds[LV])
    return 0.0


@leaf
def _across(along: float, mixed: float, across: float, depth: float, error: float) -> float:
    """What a triangle as deep as the whole face would need across the boundary, in units of ``error``; 1 if it twists.

    Its side along the boundary is as long as the second derivative ``along`` allows by itself. A twist that is
    roundoff is none.
    """
    if along == 0.0:
        return 1.0 if mixed > 0.0 else 0.0
    if 2.0 * depth * math.sqrt(8.0 * error / along) * mixed > TWIST_SHARE * error:
        return 1.0
    return depth * depth * across / (8.0 * error)


@leaf
def _demand(
    g: Tables, p: Pieces, c: CurvePieces, near: BesideEdges, uses: EdgeUses, e: int, a: float, b: float,
    error: float, exact: bool, d: Demand,
) -> tuple[float, float]:  # fmt: skip
    """Largest second-derivative demand on [a, b] in units of the error, and that of the surfaces' own bending.

    Slivers go to ``d.trims`` in mm.
    """
    edge = g.edges[e]
    part = local_line(SIZE)
    anew = local_line(5)
    worst = 0.0
    largest_bend = 0.0
    if edge.curve >= 0:
        _bounds(g, c, edge.curve, a, b, exact, part)
        worst = part[D2] / error
    for k in range(MAX_USES):
        d.trims[k] = 0.0
    for use in range(uses.first[e], uses.first[e + 1]):
        coedge = g.coedges[uses.coedge[use]]
        row = uses.surface[uses.coedge[use]]
        if row < 0 or g.surfaces[row].status == 3:
            continue
        s = g.surfaces[row]
        curve = g.curves[coedge.pcurve]
        scale = (curve.t1 - curve.t0) / (edge.t1 - edge.t0)
        low, high = curve.t0 + (a - edge.t0) * scale, curve.t0 + (b - edge.t0) * scale
        piece = _bounds(g, c, coedge.pcurve, low, high, exact, part)
        square = scale * scale
        bounds = near.bounds[near.first[uses.coedge[use]] + piece]
        if exact:
            bounds = anew
            bounds_beside(g, p, row, edge.curve == POLE, part, bounds)
        du, dv = part[D1_X], part[D1_X + 1]
        if edge.curve != POLE:
            if s.kind == PLANE and abs(bounds[LU] - bounds[LV]) <= 1e-9 * bounds[LU]:
                sliver = bounds[LU] * part[D2] * square
                worst = max(worst, sliver / error)
            else:
                sliver = (bounds[LU] * part[D2_X] + bounds[LV] * part[D2_X + 1]) * square
                sliver += 2.0 * _turned_mixed(g, row, bounds) * du * dv * square
                worst = max(worst, sliver / (error * (1.0 if s.kind == PLANE else TRIM_SHARE)))
            slot = min(use - uses.first[e], MAX_USES - 1)
            d.trims[slot] = max(d.trims[slot], sliver)
        bend = (bounds[MUU] * du * du + 2.0 * bounds[MUV] * du * dv + bounds[MVV] * dv * dv) * square
        if bend > 0.0:
            curved = part[D2_X] > 0.0 or part[D2_X + 1] > 0.0
            share = (1.0 - TRIM_SHARE) if curved else 1.0
            if bounds[MUU] * du * du >= bounds[MVV] * dv * dv:
                across = _across(bounds[MUU], bounds[MUV], bounds[MVV], s.v1 - s.v0, error)
            else:
                across = _across(bounds[MVV], bounds[MUV], bounds[MUU], s.u1 - s.u0, error)
            # Rows of a grid that end at one sample of a pole would be triangles without area.
            share *= POLE_SHARE if edge.curve == POLE else max(1.0 - across, ACROSS_SHARE)
            largest_bend = max(largest_bend, bend / (error * share))
    return max(worst, largest_bend), largest_bend


@leaf
def _even(g: Tables, uses: EdgeUses, e: int) -> bool:
    """Whether the demand is the same all along each interval, as on lines and arcs of analytic faces."""
    edge = g.edges[e]
    if edge.curve >= 0:
        c = g.curves[edge.curve]
        if c.kind == NURBS and (c.rational != 0 or c.degree > 2):
            return False
    for use in range(uses.first[e], uses.first[e + 1]):
        row = uses.surface[uses.coedge[use]]
        c = g.curves[g.coedges[uses.coedge[use]].pcurve]
        flat = row >= 0 and g.surfaces[row].kind == PLANE
        if row >= 0 and g.surfaces[row].kind == NURBS_SURFACE:
            return False
        if not flat and (c.kind != NURBS or c.degree > 1):
            return False
        if flat and c.kind == NURBS and (c.rational != 0 or c.degree > 2):
            return False
    return True


@leaf
def break_room(g: Tables, uses: EdgeUses, e: int) -> int:
    """Upper limit of the number of breaks of edge ``e`` before intervals are cut in parts."""
    edge = g.edges[e]
    room = 2
    if edge.curve >= 0:
        room += g.curves[edge.curve].n
    for use in range(uses.first[e], uses.first[e + 1]):
        room += g.curves[g.coedges[uses.coedge[use]].pcurve].n
    return room


@leaf
def _append(d: Demand, at: int, start: float, fixed: int, demand: float, bend: float) -> int:
    """Write interval ``at``, whose slivers are in ``d.trims``; the number of the next."""
    d.breaks[at] = start
    d.fixed[at] = fixed
    d.demand[at], d.bend[at] = demand, bend
    for m in range(MAX_USES):
        d.sliver[m, at] = d.trims[m]
    return at + 1


@leaf
def _divide(
    g: Tables, p: Pieces, c: CurvePieces, near: BesideEdges, uses: EdgeUses, e: int, start: float, end: float,
    error: float, fixed: int, whole: float, bend: float, d: Demand, at: int,
) -> int:  # fmt: skip
    """Append a knot interval in halves of halves, as long as they hold several samples and halving pays.

    ``whole`` and ``bend`` are its demands; returns the number of the next interval.
    """
    first = at
    demands = local_line(LEVELS)
    bends = local_line(LEVELS)
    demands[0], bends[0] = whole, bend
    depth = 0
    index = 0
    while True:
        parts = float(1 << depth)
        a = start + (end - start) * index / parts
        b = start + (end - start) * (index + 1) / parts
        if depth > 0:
            own, own_bend = _demand(g, p, c, near, uses, e, a, b, error, True, d)
            demands[depth], bends[depth] = min(own, demands[depth - 1]), min(own_bend, bends[depth - 1])
        expected = math.sqrt(demands[depth] / 8.0) * (b - a)
        pays = depth == 0 or demands[depth] < PAYS * demands[depth - 1] or expected > MANY
        if expected > SEVERAL and pays and depth < MAX_HALVINGS and at - first + depth + 2 <= MAX_PARTS:
            depth += 1
            index *= 2
            continue
        at = _append(d, at, a, fixed if at == first else 0, demands[depth], bends[depth])
        index += 1
        while depth > 0 and index % 2 == 0:
            index //= 2
            depth -= 1
        if index >= 1 << depth:
            return at


@leaf
def edge_demand(
    g: Tables, p: Pieces, c: CurvePieces, near: BesideEdges, uses: EdgeUses, e: int, error: float, d: Demand
) -> int:
    """Fill ``d`` for edge ``e`` and an error in mm; returns the number of intervals, refined where uneven.

    ``d`` has room for MAX_PARTS times ``break_room`` intervals.
    """
    edge = g.edges[e]
    d.knots[0], d.knots[1] = edge.t0, edge.t1
    d.full[0], d.full[1] = 1, 1
    n = 2
    if edge.curve >= 0:
        n = _add_knots(g, edge.curve, edge.t0, edge.t1, d.knots, d.full, n)
    for use in range(uses.first[e], uses.first[e + 1]):
        n = _add_knots(g, g.coedges[uses.coedge[use]].pcurve, edge.t0, edge.t1, d.knots, d.full, n)
    n = _sort_breaks(d.knots, d.full, n)
    even = _even(g, uses, e)
    at = 0
    for k in range(n - 1):
        whole, bend = _demand(g, p, c, near, uses, e, d.knots[k], d.knots[k + 1], error, False, d)
        if even:
            at = _append(d, at, d.knots[k], d.full[k], whole, bend)
        else:
            at = _divide(g, p, c, near, uses, e, d.knots[k], d.knots[k + 1], error, d.full[k], whole, bend, d, at)
    d.breaks[at] = d.knots[n - 1]
    d.fixed[at] = 1
    return at
