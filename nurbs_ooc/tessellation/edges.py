"""Samples of shared edges: one polyline per edge and error, whatever face looks at it.

The square root of the demand (see ``edge_demand``) is the density of samples; equal amounts of its
integral lie between neighbours::

    t0 |--- flat ---|- round -|--- flat ---| t1
       o            o  o  o  o             o

The interpolation error of a segment [a, b] under |f''| <= M_k on its intervals k is at most
max M_k (b - a)^2 / 8 and at most the sum of M_k times the integral of (t - a)(b - t)/(b - a) over k;
a segment that exceeds the demand by both is halved until it does not, unless a walk in longest steps
(``edge_walk``) needs fewer. Where a face finds that a segment alone breaks its bound, or that two of them
cross, just those are cut (``split_segments``).

Source: C. de Boor, "A Practical Guide to Splines", 1978, ch. III (equidistributed knots); the
integral is that of the Green's function of linear interpolation at its largest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel, leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_cache.surface_record import ON_SURFACE, POLE
from nurbs_ooc.bounds.curve_pieces import CurvePieces
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.curve import ELLIPSE, curve_point
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.geometry.surface import surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.beside_edges import BesideEdges
from nurbs_ooc.tessellation.edge_demand import MAX_PARTS, MAX_USES, Demand, break_room, edge_demand
from nurbs_ooc.tessellation.edge_uses import EdgeUses
from nurbs_ooc.tessellation.edge_walk import walk_edge

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Aim a little below the error, so that roundoff in a bound never exceeds it.
AIM = 0.999
# A third of a turn is the longest chord that still encloses area.
LONGEST_TURN = 2.0 * math.pi / 3.0
# Samples of one edge: beyond it the error is reported as it is.
MAX_SAMPLES = 1 << 16
# Depth of halving of one segment.
MAX_HALVINGS = 32
BASIS = MAX_DEGREE + 2  # room for the basis functions of a point


class EdgeSamples(NamedTuple):
    """Polylines of all edges: samples ``first[e]:first[e + 1]`` of edge e, from t0 to t1.

    A segment has the number of the sample it starts from.
    """

    first: Ints
    t: Floats
    position: Floats  # (n, 3) mm
    trim: Floats  # (n_coedges,) mm: bound of the sliver between p-curve and polyline, in space


@leaf
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


@leaf
def _bend(d: Demand, n: int, a: float, b: float, start: int) -> float:
    """What a triangle's bound will make of the surfaces' own deviation over [a, b]: its largest demand throughout."""
    largest = 0.0
    k = start
    while k < n and d.breaks[k] < b:
        if d.breaks[k + 1] > a:
            largest = max(largest, d.bend[k])
        k += 1
    return largest * (b - a) * (b - a) / 8.0


@leaf
def _smallest_count(g: Tables, e: int) -> int:
    """Fewest segments: closed edges need three, arcs one per third of a turn."""
    edge = g.edges[e]
    count = 1
    if edge.curve != POLE:
        if edge.vertex0 == edge.vertex1:
            count = 3
        if edge.curve >= 0 and g.curves[edge.curve].kind == ELLIPSE:
            count = max(count, math.ceil((edge.t1 - edge.t0) / LONGEST_TURN - 1e-9))
    return count


@leaf
def _place(d: Demand, low: int, high: int, count: int, out: Floats, at: int) -> int:
    """Write the samples of intervals low..high - 1, without the last end, at equal shares of density."""
    total = 0.0
    for k in range(low, high):
        total += math.sqrt(d.demand[k] / 8.0) * (d.breaks[k + 1] - d.breaks[k])
    segments = min(max(count, math.ceil(total - 1e-9)), MAX_SAMPLES)
    length = d.breaks[high] - d.breaks[low]
    # A forced minimum spreads over flat intervals too.
    floor = (segments - total) / length if total < segments else 0.0
    share = (total + floor * length) / segments
    start = at
    out[at] = d.breaks[low]
    at += 1
    done = 0.0
    for k in range(low, high):
        density = math.sqrt(d.demand[k] / 8.0) + floor
        gain = density * (d.breaks[k + 1] - d.breaks[k])
        while at - start < segments:
            need = share * (at - start) - done
            if need > gain or density == 0.0:
                break
            out[at] = d.breaks[k] + need / density
            at += 1
        done += gain
    return at


@leaf
def _place_all(g: Tables, e: int, d: Demand, n: int, out: Floats) -> int:
    """Samples of an edge of ``n`` intervals to ``out``: at every fixed break, and between them by density."""
    count = _smallest_count(g, e)
    length = d.breaks[n] - d.breaks[0]
    at = 0
    low = 0
    for high in range(1, n + 1):
        if d.fixed[high]:
            share = math.ceil(count * (d.breaks[high] - d.breaks[low]) / length - 1e-9)
            at = _place(d, low, high, share, out, at)
            low = high
    out[at] = d.breaks[n]
    return at + 1


@leaf
def _refine(d: Demand, n: int, coarse: Floats, n_coarse: int, out: Floats, at: int) -> int:
    """Copy the samples ``coarse`` to ``out[at:]``, halving segments whose error exceeds the demand.

    Returns the end in ``out``, -1 if there is no room.
    """
    first = at
    start = 0
    for i in range(n_coarse - 1):
        a = coarse[i]
        # Halvings of [coarse[i], coarse[i + 1]]: at ``depth``, the ``index``-th part.
        depth = 0
        index = 0
        whole = coarse[i + 1] - coarse[i]
        while True:
            parts = float(1 << depth)
            b = coarse[i + 1] if index + 1 == (1 << depth) else coarse[i] + whole * (index + 1.0) / parts
            while start < n - 1 and d.breaks[start + 1] <= a:
                start += 1
            fits = _segment_error(d.breaks, d.demand, n, a, b, start) <= 1.0 and _bend(d, n, a, b, start) <= 1.0
            if not fits and depth < MAX_HALVINGS and a < 0.5 * (a + b) < b and at - first < MAX_SAMPLES:
                depth += 1
                index *= 2
                continue
            if at + 1 >= len(out):
                return -1
            out[at] = a
            at += 1
            a = b
            index += 1
            while depth > 0 and index % 2 == 0:
                index //= 2
                depth -= 1
            if index >= 1 << depth:
                break
    out[at] = coarse[n_coarse - 1]
    return at + 1


@leaf
def _slivers(uses: EdgeUses, e: int, d: Demand, n: int, t: Floats, low: int, high: int, trim: Floats) -> None:
    """Bounds of the slivers of all uses of edge ``e`` along the samples ``t[low:high]``, to ``trim`` by coedge."""
    for use in range(uses.first[e], uses.first[e + 1]):
        slot = min(use - uses.first[e], MAX_USES - 1)
        worst = 0.0
        start = 0
        for i in range(low, high - 1):
            while start < n - 1 and d.breaks[start + 1] <= t[i]:
                start += 1
            worst = max(worst, _segment_error(d.breaks, d.sliver[slot], n, t[i], t[i + 1], start))
        trim[uses.coedge[use]] = worst


@helper
def _room_for(intervals: int) -> Demand:
    """Room for the demand of an edge."""
    return Demand(
        np.empty(intervals + 1),
        np.empty(intervals + 1, dtype=np.uint8),
        np.empty(intervals),
        np.empty(intervals),
        np.empty((MAX_USES, intervals)),
        np.empty(intervals + 1),
        np.empty(intervals + 1, dtype=np.uint8),
        np.empty(MAX_USES),
    )


@kernel
def _sample_edges(
    g: Tables, p: Pieces, c: CurvePieces, near: BesideEdges, uses: EdgeUses, low: int, high: int, error: float,
    trim: Floats, longest: bool,
) -> tuple[Ints, Floats]:  # fmt: skip
    """Samples of edges low..high - 1: how many each, and all parameters one after the other.

    ``longest``: a walk in longest steps may be taken.
    """
    room = 64
    for e in range(low, high):
        room = max(room, break_room(g, uses, e))
    d = _room_for(room * MAX_PARTS)
    counts = np.zeros(high - low, dtype=np.int64)
    coarse = np.empty(1024)
    t = np.empty(16 * (high - low) + 1024)
    at = 0
    for e in range(low, high):
        if uses.first[e + 1] == uses.first[e]:
            continue
        n = edge_demand(g, p, c, near, uses, e, error, d)
        expected = 8.0
        stretches = 1
        for k in range(n):
            stretches += 1 if d.fixed[k + 1] else 0
            expected += math.sqrt(d.demand[k] / 8.0) * (d.breaks[k + 1] - d.breaks[k]) + 8.0
        # Each stretch between fixed breaks may have the most samples there are; the demand may be infinite.
        most = float(MAX_SAMPLES) * stretches
        need = int(expected if expected < most else most) + 8 * n
        if need > len(coarse):
            coarse = np.empty(2 * need)
        n_coarse = _place_all(g, e, d, n, coarse)
        end = _refine(d, n, coarse, n_coarse, t, at)
        while end < 0:
            more = np.empty(2 * len(t) + n_coarse)
            more[:at] = t[:at]
            t = more
            end = _refine(d, n, coarse, n_coarse, t, at)
        if longest and end - at > n_coarse:
            walked = walk_edge(d, n, _smallest_count(g, e), coarse, min(end - at - 1, len(coarse)))
            for i in range(walked):
                t[at + i] = coarse[i]
            end = at + walked if walked > 0 else end
        _slivers(uses, e, d, n, t, at, end, trim)
        counts[e - low] = end - at
        at = end
    return counts, t[:at].copy()


@leaf
def place_samples(g: Tables, uses: EdgeUses, samples: EdgeSamples, e: int) -> None:
    """Write the points of the samples of edge ``e``.

    They are the shared vertices at the ends, between them the 3D curve, or the surface without one.
    """
    scratch = local_table(4, BASIS)
    point = local_line(12)
    edge = g.edges[e]
    first, last = samples.first[e], samples.first[e + 1] - 1
    for i in range(first, last + 1):
        t = samples.t[i]
        if i == first or i == last or edge.curve == POLE:
            vertex = edge.vertex1 if i == last else edge.vertex0
            for k in range(3):
                point[k] = g.vertices[vertex, k]
        elif edge.curve == ON_SURFACE:
            coedge = uses.coedge[uses.first[e]]
            coedge_uv(g, coedge, t, scratch, point)
            surface_point(g, uses.surface[coedge], point[0], point[1], scratch, point)
        else:
            c = g.curves[edge.curve]
            s = c.t0 + (t - edge.t0) * (c.t1 - c.t0) / (edge.t1 - edge.t0)
            curve_point(g, edge.curve, s, scratch, point)
        for k in range(3):
            samples.position[i, k] = point[k]


@kernel
def _place_samples(g: Tables, uses: EdgeUses, samples: EdgeSamples, low: int, high: int) -> None:
    for e in range(low, high):
        place_samples(g, uses, samples, e)


def with_positions(g: Tables, uses: EdgeUses, samples: EdgeSamples, run: Run) -> EdgeSamples:
    """``samples`` with the positions of all of them written."""
    run(lambda low, high: _place_samples(g, uses, samples, low, high), len(g.edges))
    return samples


def sample_edges(
    g: Tables, pieces: Pieces, curves: CurvePieces, near: BesideEdges, uses: EdgeUses, error: float, run: Run,
    longest: bool = True,
) -> EdgeSamples:  # fmt: skip
    """Sample all edges of a part so that chords and slivers stay within ``error``.

    Args:
        g: the part's tables.
        pieces: its Bézier pieces.
        curves: the pieces of its curves.
        near: what its surfaces do along them.
        uses: its coedges by edge.
        error: mm.
        run: maps a kernel over ranges of edges, in order (see ``workers``).
        longest: take the longest steps that the distance allows where that saves samples. Halved ones change
            their lengths gradually, which is kinder to normals.

    Returns:
        The samples, the same for any split of the work.
    """
    trim = np.zeros(len(g.coedges))
    aim = error * AIM
    results = run(
        lambda low, high: _sample_edges(g, pieces, curves, near, uses, low, high, aim, trim, longest), len(g.edges)
    )
    counts = [np.zeros(1, np.int64), *(r[0] for r in results)]
    t = np.concatenate([np.zeros(0), *(r[1] for r in results)])
    samples = EdgeSamples(np.cumsum(np.concatenate(counts)), t, np.empty((len(t), 3)), trim)
    return with_positions(g, uses, samples, run)
