"""More samples on some segments of edges: where a face has found that one breaks its bound, or that two cross."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.edge_samples import MAX_SAMPLES, EdgeSamples, place_samples
from nurbs_ooc.tessellation.edge_uses import EdgeUses

Ints = npt.NDArray[np.int64]

# An edge is cut into so many times its first samples, or to so many, at most: what wants more moves by more than the
# error within any step of its parameter.
MOST_GROWN, GROWN_SAMPLES = 64, 1 << 13


def most_samples(samples: EdgeSamples) -> Ints:
    """(n_edges,) how many samples edges that have these at first may get."""
    return np.minimum(np.maximum(np.diff(samples.first) * MOST_GROWN, GROWN_SAMPLES), MAX_SAMPLES)


@kernel
def _count(first: Ints, parts: Ints, most: Ints, counts: Ints) -> None:
    """Samples of each edge when its segments are cut; as many as it has where there would be more than ``most``."""
    for e in range(len(first) - 1):
        has = first[e + 1] - first[e]
        counts[e] = has
        for i in range(first[e], first[e + 1] - 1):
            counts[e] += max(parts[i], 1) - 1
        if counts[e] > most[e]:
            counts[e] = has


@kernel
def _cut(g: Tables, uses: EdgeUses, old: EdgeSamples, parts: Ints, low: int, high: int, new: EdgeSamples) -> None:
    """Samples of edges low..high - 1: equal parts of the old segments."""
    for e in range(low, high):
        at = new.first[e]
        changed = new.first[e + 1] - at > old.first[e + 1] - old.first[e]
        last = old.first[e + 1] - 1
        for i in range(old.first[e], last + 1):
            into = max(parts[i], 1) if changed and i < last else 1
            for k in range(into):
                new.t[at] = old.t[i]
                if k > 0:
                    new.t[at] += (old.t[i + 1] - old.t[i]) * (k / into)
                for m in range(3):
                    new.position[at, m] = old.position[i, m]
                at += 1
        if changed:
            place_samples(g, uses, new, e)


def split_segments(
    g: Tables, uses: EdgeUses, samples: EdgeSamples, parts: Ints, most: Ints, run: Run
) -> tuple[EdgeSamples, npt.NDArray[np.bool_]]:
    """Cut segments into equal parts, but no edge into more than its ``most``.

    Args:
        g: the part's tables.
        uses: its coedges by edge.
        samples: of its edges.
        parts: (n_samples,) how many parts each segment shall have; below 2 it stays.
        most: (n_edges,) samples; an edge that would get more stays as it is.
        run: maps a kernel over ranges of edges.

    Returns:
        The new samples, and which edges (n_edges,) have changed.
    """
    first = np.zeros(len(g.edges) + 1, np.int64)
    _count(samples.first, parts, most, first[1:])
    changed = first[1:] > np.diff(samples.first)
    np.cumsum(first, out=first)
    split = EdgeSamples(first, np.empty(first[-1]), np.empty((first[-1], 3)), samples.trim)
    run(lambda low, high: _cut(g, uses, samples, parts, low, high, split), len(g.edges))
    return split, changed
