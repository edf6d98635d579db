"""Samples of one edge at equal shares of its density, halved where a segment errs by more than it may.

The square root of the demand (see ``edge_demand``) is the density of samples; equal amounts of its
integral lie between neighbours::

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

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.surface_record import POLE
from nurbs_ooc.geometry.curve import ELLIPSE
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.edge_demand import Demand
from nurbs_ooc.tessellation.edge_samples import MAX_SAMPLES

Floats = npt.NDArray[np.float64]

# A third of a turn is the longest chord that still encloses area.
LONGEST_TURN = 2.0 * math.pi / 3.0
# Depth of halving of one segment.
MAX_HALVINGS = 32


@leaf
def segment_error(breaks: Floats, demand: Floats, n: int, a: float, b: float, start: int) -> float:
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
def smallest_count(g: Tables, e: int) -> int:
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
def place_all(g: Tables, e: int, d: Demand, n: int, out: Floats) -> int:
    """Samples of an edge of ``n`` intervals to ``out``: at every fixed break, and between them by density."""
    count = smallest_count(g, e)
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
def refine(d: Demand, n: int, coarse: Floats, n_coarse: int, out: Floats, at: int) -> int:
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
            fits = segment_error(d.breaks, d.demand, n, a, b, start) <= 1.0 and _bend(d, n, a, b, start) <= 1.0
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
