"""Samples where edges run over a crease of a face beside them, so that no boundary segment has two normals inside.

Asked for only where normals count: distance bounds charge a crease by its depth.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.creases import JUMP, VALUE
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, CREASED, N_U, N_V, Pieces
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.edge_samples import EdgeSamples, with_positions
from nurbs_ooc.tessellation.edge_uses import EdgeUses

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A sample this near to a crease, as a share of the domain, lies on it.
ON_IT = 1e-10
HALVINGS = 60
BASIS = MAX_DEGREE + 2  # room for the basis functions of a point


@leaf
def _offset(g: Tables, coedge: int, t: float, along: int, value: float) -> float:
    """How far the edge's point at ``t`` lies from a crease, in its parameter."""
    at = local_line(6)
    coedge_uv(g, coedge, t, local_table(4, BASIS), at)
    return at[along] - value


@leaf
def _crossing(g: Tables, coedge: int, t0: float, t1: float, along: int, value: float, low: float) -> float:
    """Where between t0, at which the offset is ``low``, and t1 an edge crosses a crease."""
    for _ in range(HALVINGS):
        middle = 0.5 * (t0 + t1)
        if (_offset(g, coedge, middle, along, value) > 0.0) == (low > 0.0):
            t0 = middle
        else:
            t1 = middle
    return 0.5 * (t0 + t1)


@kernel
def _find_crossings(g: Tables, p: Pieces, uses: EdgeUses, first: Ints, t: Floats, found: Floats, segment: Ints) -> int:
    """Parameters of crossings to ``found``, the segments they lie on to ``segment``; how many (no more than fit)."""
    n = 0
    for coedge in range(len(g.coedges)):
        row = uses.surface[coedge]
        if row < 0 or g.surfaces[row].status == 3 or p.table[row, CREASED] == 0:
            continue
        s = g.surfaces[row]
        e = g.coedges[coedge].edge
        for along in range(2):
            at = p.table[row, BREAK_U] if along == 0 else p.table[row, BREAK_V]
            count = p.table[row, N_U] if along == 0 else p.table[row, N_V]
            hair = ON_IT * ((s.u1 - s.u0) if along == 0 else (s.v1 - s.v0))
            for k in range(1, count):
                if p.breaks[at + k, JUMP] <= 0.0 or first[e + 1] <= first[e]:
                    continue
                value = p.breaks[at + k, VALUE]
                before = _offset(g, coedge, t[first[e]], along, value)
                for i in range(first[e], first[e + 1] - 1):
                    after = _offset(g, coedge, t[i + 1], along, value)
                    crosses = (before < -hair and after > hair) or (before > hair and after < -hair)
                    if crosses and n < len(found):
                        found[n] = _crossing(g, coedge, t[i], t[i + 1], along, value, before)
                        segment[n] = i
                        n += 1
                    before = after
    return n


def with_crease_samples(g: Tables, pieces: Pieces, uses: EdgeUses, samples: EdgeSamples, run: Run) -> EdgeSamples:
    """The samples, and one wherever an edge crosses a crease of a surface beside it.

    Args:
        g, pieces, uses: the part.
        samples: of its edges.
        run: see ``sample_edges``.
    """
    room = 4 * len(samples.t) + 1024
    found, segment = np.empty(room), np.empty(room, np.int64)
    n = _find_crossings(g, pieces, uses, samples.first, samples.t, found, segment)
    if n == 0:
        return samples
    # Faces on both sides of a seam may see the same crossing.
    order = np.lexsort((found[:n], segment[:n]))
    t, at = found[:n][order], segment[:n][order]
    keep = (t > samples.t[at]) & (t < samples.t[at + 1])
    keep[1:] &= (t[1:] > t[:-1]) | (at[1:] > at[:-1])
    t, at = t[keep], at[keep]
    edge = np.repeat(np.arange(len(g.edges)), np.diff(samples.first))
    counts = np.diff(samples.first) + np.bincount(edge[at], minlength=len(g.edges))
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    every = np.insert(samples.t, at + 1, t)
    more = EdgeSamples(first, every, np.empty((len(every), 3)), samples.trim)
    return with_positions(g, uses, more, run)
