"""Samples of shared edges: one polyline per edge and error, whatever face looks at it.

Every edge is cut where any of its curves (the 3D curve and the p-curve of each face that uses it)
has a knot, so that on each interval second derivatives are bounded. From them follow, per interval
and in units of the allowed error, three demands: the chord in space, the sliver between p-curve and
its chord carried into space, and the surface's own deviation along the chord. The square root of
the largest is the density of samples; equal amounts of its integral lie between neighbours::

    t0 |--- flat ---|- round -|--- flat ---| t1
       o            o  o  o  o             o

The interpolation error of a segment [a, b] under |f''| <= M_k on its intervals k is at most
max M_k (b - a)^2 / 8 and at most the sum of M_k times the integral of (t - a)(b - t)/(b - a) over k;
a segment that exceeds the demand by both is halved until it does not.

Source: C. de Boor, "A Practical Guide to Splines", 1978, ch. III (equidistributed knots); the
integral is that of the Green's function of linear interpolation at its largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_ooc.bounds.curve_bounds import D1_X, D2, D2_X, HIGH, LOW, SIZE, curve_bounds
from nurbs_ooc.bounds.derivatives import LU, LV, MUU, MUV, MVV
from nurbs_ooc.bounds.pieces import Pieces, box_bounds
from nurbs_ooc.geometry.curve import ELLIPSE, NURBS, curve_point
from nurbs_ooc.geometry.surface import PLANE
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Share of the error that slivers of curved p-curves may take on curved surfaces; the rest is the surface's.
TRIM_SHARE = 0.25
# The surface's deviation along the boundary leaves at least this share to the direction across it.
ACROSS_SHARE = 0.5
# Aim a little below the error, so that roundoff in a bound never exceeds it.
AIM = 0.999
# A third of a turn is the longest chord that still encloses area.
LONGEST_TURN = 2.0 * math.pi / 3.0
# Refinement inside one knot interval when its demand is uneven.
MAX_PARTS = 16
# Samples of one edge: beyond it the error is reported as it is.
MAX_SAMPLES = 1 << 18
# Breaks closer than this part of the edge are one.
SAME_BREAK = 1e-12


class EdgeUses(NamedTuple):
    """Which coedges run along an edge, and which surface a coedge bounds."""

    first: Ints  # (n_edges + 1,)
    coedge: Ints  # (n_coedges,) sorted by edge
    surface: Ints  # (n_coedges,) by coedge


class EdgeSamples(NamedTuple):
    """Polylines of all edges: samples ``first[e]:first[e + 1]`` of edge e, from t0 to t1."""

    first: Ints
    t: Floats
    position: Floats  # (n, 3) mm
    trim: Floats  # (n_coedges,) mm: bound of the sliver between p-curve and polyline, in space


def edge_uses(g: Tables) -> EdgeUses:
    """Invert coedge -> edge; loops and coedges are stored in the order of their surfaces."""
    n_edges = len(g.edges)
    loop_of = np.repeat(np.arange(len(g.loops)), g.loops["n_coedges"])
    surface_of_loop = np.repeat(np.arange(len(g.surfaces)), g.surfaces["n_loops"])
    surface = np.full(len(g.coedges), -1, np.int64)
    rows = _ranges(g.loops["first_coedge"], g.loops["n_coedges"])
    loops = _ranges(g.surfaces["first_loop"], g.surfaces["n_loops"])
    owner = np.full(len(g.loops), -1, np.int64)
    owner[loops] = surface_of_loop
    surface[rows] = owner[loop_of]
    edge = g.coedges["edge"].astype(np.int64)
    order = np.argsort(edge, kind="stable").astype(np.int64)
    first = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=n_edges))]).astype(np.int64)
    return EdgeUses(first, order, surface)


def _ranges(first: npt.NDArray[np.int32], count: npt.NDArray[np.int32]) -> Ints:
    """first[i], first[i] + 1, ..., first[i] + count[i] - 1 for all i, in one array."""
    count = count.astype(np.int64)
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(first.astype(np.int64) - (ends - count), count)


@helper
def _add_knots(g: Tables, row: int, t0: float, t1: float, breaks: Floats, forced: npt.NDArray[np.uint8], n: int) -> int:
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


@helper
def _sort_breaks(breaks: Floats, forced: npt.NDArray[np.uint8], n: int) -> int:
    """Sort in place and merge those that are the same; the ends stay as they are."""
    span = breaks[1] - breaks[0]
    order = np.argsort(breaks[:n])
    sorted_breaks = breaks[:n][order]
    sorted_forced = forced[:n][order]
    m = 0
    for i in range(n):
        if m > 0 and sorted_breaks[i] - breaks[m - 1] <= SAME_BREAK * span:
            forced[m - 1] = max(forced[m - 1], sorted_forced[i])
            continue
        breaks[m] = sorted_breaks[i]
        forced[m] = sorted_forced[i]
        m += 1
    return m


@helper
def _demand(
    g: Tables, p: Pieces, uses: EdgeUses, e: int, a: float, b: float, error: float, work: Floats, part: Floats,
    bounds: Floats, trims: Floats,
) -> float:  # fmt: skip
    """Largest second-derivative demand on [a, b] of the edge in units of the error; slivers to ``trims`` in mm."""
    edge = g.edges[e]
    worst = 0.0
    if edge.curve >= 0:
        curve_bounds(g, edge.curve, a, b, work, part)
        worst = part[D2] / error
    for use in range(uses.first[e], uses.first[e + 1]):
        coedge = g.coedges[uses.coedge[use]]
        row = uses.surface[uses.coedge[use]]
        trims[use - uses.first[e]] = 0.0
        if row < 0 or g.surfaces[row].status == 3:
            continue
        s = g.surfaces[row]
        c = g.curves[coedge.pcurve]
        scale = (c.t1 - c.t0) / (edge.t1 - edge.t0)
        curve_bounds(g, coedge.pcurve, c.t0 + (a - edge.t0) * scale, c.t0 + (b - edge.t0) * scale, work, part)
        square = scale * scale
        u0, u1, v0, v1 = part[LOW], part[HIGH], part[LOW + 1], part[HIGH + 1]
        if edge.curve < 0:
            # A pole has no length: let the columns of the whole face decide.
            u0, u1, v0, v1 = s.u0, s.u1, s.v0, s.v1
        box_bounds(g, p, row, u0, u1, v0, v1, work, bounds)
        if edge.curve >= 0:
            if s.kind == PLANE and abs(bounds[LU] - bounds[LV]) <= 1e-9 * bounds[LU]:
                sliver = bounds[LU] * part[D2] * square
                worst = max(worst, sliver / error)
            else:
                sliver = (bounds[LU] * part[D2_X] + bounds[LV] * part[D2_X + 1]) * square
                worst = max(worst, sliver / (error * (1.0 if s.kind == PLANE else TRIM_SHARE)))
            trims[use - uses.first[e]] = sliver
        du, dv = part[D1_X], part[D1_X + 1]
        bend = (bounds[MUU] * du * du + 2.0 * bounds[MUV] * du * dv + bounds[MVV] * dv * dv) * square
        if bend > 0.0:
            curved = part[D2_X] > 0.0 or part[D2_X + 1] > 0.0
            share = (1.0 - TRIM_SHARE) if curved else 1.0
            # What a triangle as deep as the whole face would need across the boundary.
            if bounds[MUU] * du * du >= bounds[MVV] * dv * dv:
                across = (s.v1 - s.v0) ** 2 * bounds[MVV] / (8.0 * error)
            else:
                across = (s.u1 - s.u0) ** 2 * bounds[MUU] / (8.0 * error)
            if bounds[MUV] > 0.0:
                across = 1.0
            share *= max(1.0 - across, ACROSS_SHARE)
            worst = max(worst, bend / (error * share))
    return worst


@helper
def _segment_error(breaks: Floats, demand: Floats, n: int, a: float, b: float, start: int) -> float:
    """Bound of the linear interpolant's error over [a, b] under the piecewise demand (see the module)."""
    largest = 0.0
    total = 0.0
    length = b - a
    k = start
    while k < n and breaks[k] < b:
        if breaks[k + 1] > a:
            low = max(a, breaks[k]) - a
            high = min(b, breaks[k + 1]) - a
            largest = max(largest, demand[k])
            total += demand[k] * (0.5 * (high**2 - low**2) - (high**3 - low**3) / (3.0 * length))
        k += 1
    return min(largest * length * length / 8.0, total)


@helper
def _grow(a: Floats, n: int) -> Floats:
    """``a`` with room for at least n numbers."""
    if n <= len(a):
        return a
    bigger = np.empty(2 * n)
    bigger[: len(a)] = a
    return bigger


@helper
def _smallest_count(g: Tables, e: int, boost: int) -> int:
    """Fewest segments: closed edges need three, arcs one per third of a turn."""
    edge = g.edges[e]
    count = 1
    if edge.curve >= 0:
        if edge.vertex0 == edge.vertex1:
            count = 3
        if g.curves[edge.curve].kind == ELLIPSE:
            count = max(count, math.ceil((edge.t1 - edge.t0) / LONGEST_TURN - 1e-9))
    return count << boost


@helper
def _place(
    breaks: Floats, demand: Floats, low: int, high: int, count: int, density: float, out: Floats, at: int
) -> int:
    """Write the samples of intervals low..high - 1, without the last end, at equal shares of density."""
    total = 0.0
    for k in range(low, high):
        total += math.sqrt(demand[k] / 8.0) * density * (breaks[k + 1] - breaks[k])
    segments = min(max(count, math.ceil(total - 1e-9)), MAX_SAMPLES)
    length = breaks[high] - breaks[low]
    # A forced minimum spreads over flat intervals too.
    floor = (segments - total) / length if total < segments else 0.0
    share = (total + floor * length) / segments
    start = at
    out[at] = breaks[low]
    at += 1
    done = 0.0
    for k in range(low, high):
        d = math.sqrt(demand[k] / 8.0) * density + floor
        gain = d * (breaks[k + 1] - breaks[k])
        while at - start < segments:
            need = share * (at - start) - done
            if need > gain or d == 0.0:
                break
            out[at] = breaks[k] + need / d
            at += 1
        done += gain
    return at


class _Scratch(NamedTuple):
    """Work arrays of one thread; each may be replaced by a larger one while an edge is sampled."""

    knots: Floats
    forced: npt.NDArray[np.uint8]
    work: Floats
    part: Floats
    bounds: Floats


@helper
def _intervals(
    g: Tables, p: Pieces, uses: EdgeUses, e: int, error: float, scratch: _Scratch, trims: Floats
) -> tuple[Floats, Floats, npt.NDArray[np.uint8], Floats]:
    """Breaks, demands, forced flags and sliver bounds (use, interval) of an edge, refined where uneven."""
    edge = g.edges[e]
    n_uses = uses.first[e + 1] - uses.first[e]
    room = 2
    if edge.curve >= 0:
        room += g.curves[edge.curve].n
    for use in range(uses.first[e], uses.first[e + 1]):
        room += g.curves[g.coedges[uses.coedge[use]].pcurve].n
    knots, forced = scratch.knots, scratch.forced
    if room > len(knots):
        knots = np.empty(room)
        forced = np.empty(room, dtype=np.uint8)
    knots[0], knots[1] = edge.t0, edge.t1
    forced[0], forced[1] = 1, 1
    n = 2
    if edge.curve >= 0:
        n = _add_knots(g, edge.curve, edge.t0, edge.t1, knots, forced, n)
    for use in range(uses.first[e], uses.first[e + 1]):
        n = _add_knots(g, g.coedges[uses.coedge[use]].pcurve, edge.t0, edge.t1, knots, forced, n)
    n = _sort_breaks(knots, forced, n)
    # Measure each interval once, then again in parts where it holds several samples.
    parts = np.empty(n - 1, dtype=np.int64)
    total = 0
    for k in range(n - 1):
        d = _demand(g, p, uses, e, knots[k], knots[k + 1], error, scratch.work, scratch.part, scratch.bounds, trims)
        expected = math.sqrt(d / 8.0) * (knots[k + 1] - knots[k])
        parts[k] = 1 if expected < 1.5 else min(MAX_PARTS, math.ceil(expected))
        total += parts[k]
    breaks = np.empty(total + 1)
    demand = np.empty(total)
    full = np.zeros(total + 1, dtype=np.uint8)
    slivers = np.zeros((max(n_uses, 1), total))
    at = 0
    for k in range(n - 1):
        full[at] = forced[k]
        for i in range(parts[k]):
            a = knots[k] + (knots[k + 1] - knots[k]) * i / parts[k]
            b = knots[k] + (knots[k + 1] - knots[k]) * (i + 1) / parts[k]
            breaks[at] = a
            demand[at] = _demand(g, p, uses, e, a, b, error, scratch.work, scratch.part, scratch.bounds, trims)
            for use in range(n_uses):
                slivers[use, at] = trims[use]
            at += 1
    breaks[at] = knots[n - 1]
    full[at] = 1
    return breaks, demand, full, slivers


@helper
def _refine(breaks: Floats, demand: Floats, coarse: Floats, n: int, out: Floats, at: int) -> tuple[Floats, int]:
    """Copy the samples ``coarse[:n]`` to ``out``, halving segments whose error exceeds the demand."""
    start = 0
    stack = np.empty(64)
    for i in range(n - 1):
        a = coarse[i]
        top = 0
        stack[0] = coarse[i + 1]
        while top >= 0:
            b = stack[top]
            while start < len(demand) - 1 and breaks[start + 1] <= a:
                start += 1
            middle = 0.5 * (a + b)
            fits = _segment_error(breaks, demand, len(demand), a, b, start) <= 1.0
            if not fits and top < 63 and a < middle < b and at < MAX_SAMPLES:
                top += 1
                stack[top] = middle
                continue
            out = _grow(out, at + 2)
            out[at] = a
            at += 1
            a = b
            top -= 1
    out = _grow(out, at + 1)
    out[at] = coarse[n - 1]
    return out, at + 1


@helper
def _sample_edge(
    g: Tables, p: Pieces, uses: EdgeUses, e: int, error: float, boost: int, scratch: _Scratch, trim: Floats
) -> Floats:
    """Parameters of the samples of edge ``e`` from t0 to t1; slivers of its coedges to ``trim`` (by coedge)."""
    n_uses = uses.first[e + 1] - uses.first[e]
    trims = np.zeros(max(n_uses, 1))
    breaks, demand, full, slivers = _intervals(g, p, uses, e, error, scratch, trims)
    n = len(demand)
    expected = 0.0
    for k in range(n):
        expected += math.sqrt(demand[k] / 8.0) * (breaks[k + 1] - breaks[k]) + 1.0
    density = float(1 << boost)
    count = _smallest_count(g, e, boost)
    coarse = np.empty(int(min(expected * density, float(MAX_SAMPLES))) + n * (count + 2) + 2)
    at = 0
    low = 0
    length = breaks[n] - breaks[0]
    for high in range(1, n + 1):
        if full[high]:
            share = math.ceil(count * (breaks[high] - breaks[low]) / length - 1e-9)
            at = _place(breaks, demand, low, high, share, density, coarse, at)
            low = high
    coarse[at] = breaks[n]
    out, at = _refine(breaks, demand, coarse, at + 1, np.empty(at + 2), 0)
    for use in range(n_uses):
        start = 0
        worst = 0.0
        for i in range(at - 1):
            while start < n - 1 and breaks[start + 1] <= out[i]:
                start += 1
            worst = max(worst, _segment_error(breaks, slivers[use], n, out[i], out[i + 1], start))
        trim[uses.coedge[uses.first[e] + use]] = worst
    return out[:at]


@kernel
def _sample_edges(
    g: Tables, p: Pieces, uses: EdgeUses, low: int, high: int, error: float, boost: Ints, trim: Floats
) -> tuple[Ints, Floats]:
    """Samples of edges low..high - 1: how many each, and all parameters one after the other."""
    scratch = _Scratch(
        np.empty(256),
        np.empty(256, dtype=np.uint8),
        np.empty((3, MAX_DEGREE + 2, 4)),
        np.empty(SIZE),
        np.empty(5),
    )
    counts = np.zeros(high - low, dtype=np.int64)
    t = np.empty(8 * (high - low) + 16)
    at = 0
    for e in range(low, high):
        if uses.first[e + 1] == uses.first[e]:
            continue
        samples = _sample_edge(g, p, uses, e, error * AIM, boost[e], scratch, trim)
        t = _grow(t, at + len(samples))
        for i in range(len(samples)):
            t[at + i] = samples[i]
        at += len(samples)
        counts[e - low] = len(samples)
    return counts, t[:at].copy()


@kernel
def _positions(g: Tables, first: Ints, t: Floats, low: int, high: int, out: Floats) -> None:
    """Points of the samples: the shared vertices at the ends, the 3D curve between."""
    scratch = np.empty((2, MAX_DEGREE + 2))
    point = np.empty(6)
    for e in range(low, high):
        edge = g.edges[e]
        last = first[e + 1] - 1
        for i in range(first[e], first[e + 1]):
            for k in range(3):
                if i == first[e] or edge.curve < 0:
                    out[i, k] = g.vertices[edge.vertex0, k]
                elif i == last:
                    out[i, k] = g.vertices[edge.vertex1, k]
            if i != first[e] and i != last and edge.curve >= 0:
                c = g.curves[edge.curve]
                s = c.t0 + (t[i] - edge.t0) * (c.t1 - c.t0) / (edge.t1 - edge.t0)
                curve_point(g, edge.curve, s, scratch, point)
                for k in range(3):
                    out[i, k] = point[k]


def sample_edges(
    g: Tables, pieces: Pieces, uses: EdgeUses, error: float, boost: Ints, run: Callable[..., list[Any]]
) -> EdgeSamples:
    """Sample all edges of a part so that chords and slivers stay within ``error``.

    Args:
        g: the part's tables.
        pieces: its Bézier pieces.
        uses: its coedges by edge.
        error: mm.
        boost: (n_edges,) edges get 2**boost times the samples that the error asks for.
        run: maps a kernel over ranges of edges, in order (see ``workers``).

    Returns:
        The samples, the same for any split of the work.
    """
    n = len(g.edges)
    trim = np.zeros(len(g.coedges))
    results = run(lambda low, high: _sample_edges(g, pieces, uses, low, high, error, boost, trim), n)
    counts = np.concatenate([r[0] for r in results]) if results else np.zeros(0, np.int64)
    t = np.concatenate([r[1] for r in results]) if results else np.zeros(0)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    position = np.empty((len(t), 3))
    run(lambda low, high: _positions(g, first, t, low, high, position), n)
    return EdgeSamples(first, t, position, trim)
