"""Samples of an edge in the longest steps that its demand allows, evened out.

Equal shares of the density (see ``edges``) are best where the demand hardly changes from sample to sample. Where
it does, segments that reach into an interval of larger demand fail, and halving them gives up to twice as
many as needed. Walking from break to break, each step as long as the largest demand on its way allows, needs the
fewest. The last step would be a short one, so all are shortened as far as their number stays.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.tessellation.edge_demand import Demand

Floats = npt.NDArray[np.float64]

# Halvings of the range in which the length of steps is sought.
EVENINGS = 6


@leaf
def _step(d: Demand, k: int, high: int, a: float, allowed: float) -> float:
    """The end of the longest step from ``a`` in interval ``k`` that errs by ``allowed``, at most the break ``high``."""
    largest = 0.0
    reach = math.inf
    for m in range(k, high):
        if d.demand[m] > largest:
            largest = d.demand[m]
            reach = a + math.sqrt(8.0 * allowed / largest)
            if m > k and reach <= d.breaks[m]:
                return float(d.breaks[m])
        if reach < d.breaks[m + 1]:
            return reach
    return float(d.breaks[high])


@leaf
def _walk(d: Demand, low: int, high: int, allowed: float, out: Floats, at: int, end: int) -> int:
    """Write the samples from break ``low`` up to, but without, break ``high`` to ``out[at:end]``.

    Returns where they end; -1 if there is no room, or steps are too short to be taken.
    """
    a = d.breaks[low]
    k = low
    while a < d.breaks[high]:
        if at >= end:
            return -1
        out[at] = a
        at += 1
        while k < high - 1 and d.breaks[k + 1] <= a:
            k += 1
        b = _step(d, k, high, a, allowed)
        if b <= a:
            return -1
        a = b
    return at


@leaf
def walk_edge(d: Demand, n: int, fewest: int, out: Floats, end: int) -> int:
    """Samples of an edge of ``n`` intervals to ``out[:end]``: at every fixed break, and between them in even steps.

    Args:
        d, n: the edge's demand.
        fewest: segments that the edge must have.
        out: room for the samples.
        end: how many there may be.

    Returns:
        How many; 0 if they would be more, or too few segments.
    """
    at = 0
    low = 0
    for high in range(1, n + 1):
        if d.fixed[high] == 0:
            continue
        last = _walk(d, low, high, 1.0, out, at, end - 1)
        if last < 0:
            return 0
        total = 0.0
        for k in range(low, high):
            total += math.sqrt(d.demand[k] / 8.0) * (d.breaks[k + 1] - d.breaks[k])
        short, long = (total / (last - at)) ** 2, 1.0
        for _ in range(EVENINGS):
            middle = 0.5 * (short + long)
            if _walk(d, low, high, middle, out, at, last) < 0:
                short = middle
            else:
                long = middle
        _walk(d, low, high, long, out, at, last)
        at = last
        low = high
    out[at] = d.breaks[n]
    return at + 1 if at >= fewest else 0
