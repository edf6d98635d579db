"""Samples of shared edges: one polyline per edge and error, whatever face looks at it.

They lie at equal shares of the edge's density (``edge_shares``), unless a walk in longest steps (``edge_walk``)
needs fewer than halving would give. Where a face finds that a segment alone breaks its bound, or that two of them
cross, just those are cut (``split_segments``).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel, leaf
from nurbs_ooc.bounds.curve_pieces import CurvePieces
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.beside_edges import BesideEdges
from nurbs_ooc.tessellation.edge_demand import MAX_PARTS, MAX_USES, Demand, break_room, edge_demand
from nurbs_ooc.tessellation.edge_samples import MAX_SAMPLES, EdgeSamples, with_positions
from nurbs_ooc.tessellation.edge_shares import place_all, refine, segment_error, smallest_count
from nurbs_ooc.tessellation.edge_uses import EdgeUses
from nurbs_ooc.tessellation.edge_walk import walk_edge

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Aim a little below the error, so that roundoff in a bound never exceeds it.
AIM = 0.999


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
            worst = max(worst, segment_error(d.breaks, d.sliver[slot], n, t[i], t[i + 1], start))
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
        n_coarse = place_all(g, e, d, n, coarse)
        end = refine(d, n, coarse, n_coarse, t, at)
        while end < 0:
            more = np.empty(2 * len(t) + n_coarse)
            more[:at] = t[:at]
            t = more
            end = refine(d, n, coarse, n_coarse, t, at)
        if longest and end - at > n_coarse:
            walked = walk_edge(d, n, smallest_count(g, e), coarse, min(end - at - 1, len(coarse)))
            for i in range(walked):
                t[at + i] = coarse[i]
            end = at + walked if walked > 0 else end
        _slivers(uses, e, d, n, t, at, end, trim)
        counts[e - low] = end - at
        at = end
    return counts, t[:at].copy()


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
