"""The boundary of one face: its loops as polylines through the shared samples of their edges.

Every point keeps two addresses: its exact (u, v) on the p-curve, in which the surface is triangulated,
and the position of the shared edge sample, at which it is drawn. How far the surface at (u, v) is
from that position is the gap between p-curve, edge curve and surface in the file: measured, reported,
never refined against.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.predicates import LATTICE
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.edge_samples import EdgeSamples
from nurbs_ooc.tessellation.workspace import BoundaryRoom

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.uint8]


class Boundary(NamedTuple):
    """Points of all loops of a face, loop after loop; point i is joined to ``next[i]``."""

    uv: Floats  # (n, 2)
    position: Floats  # (n, 3) mm, of the shared edge sample
    normal: Floats  # (n, 3)
    pole: Flags  # (n,) 1: the surface has no normal at the point's (u, v)
    next: Ints  # (n,)
    segment: Ints  # (n,) number, among the edge samples, of the segment that starts here
    point: Ints  # (n,) lattice point
    box: Floats  # (4,) u0, u1, v0, v1 of all points
    trim: float  # mm, bound of the slivers between p-curves and segments
    gap: float  # mm, largest distance between a position and the surface at its (u, v)


@leaf
def count_points(g: Tables, samples: EdgeSamples, row: int) -> int:
    """How many points the boundary of surface ``row`` has."""
    s = g.surfaces[row]
    n = 0
    for m in range(s.first_loop, s.first_loop + s.n_loops):
        for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
            e = g.coedges[c].edge
            n += max(samples.first[e + 1] - samples.first[e] - 1, 0)
    return n


@leaf
def gather_boundary(g: Tables, samples: EdgeSamples, row: int, r: BoundaryRoom, scratch: Floats) -> tuple[float, float]:
    """Collect the loops of surface ``row``, ``count_points`` of them, in ``r``; the trim error and the gap, mm.

    Each coedge gives its samples but the last.
    """
    s = g.surfaces[row]
    point = local_line(12)
    trim = 0.0
    gap = 0.0
    at = 0
    for k in range(2):
        r.box[2 * k], r.box[2 * k + 1] = np.inf, -np.inf
    for m in range(s.first_loop, s.first_loop + s.n_loops):
        start = at
        for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
            coedge = g.coedges[c]
            e = coedge.edge
            low, high = samples.first[e], samples.first[e + 1]
            trim = max(trim, samples.trim[c])
            for i in range(high - low):
                k = high - 1 - i if coedge.reversed else low + i
                coedge_uv(g, c, samples.t[k], scratch, point)
                u, v = point[0], point[1]
                surface_point(g, row, u, v, scratch, point)
                off = 0.0
                for d in range(3):
                    off += (point[d] - samples.position[k, d]) ** 2
                gap = max(gap, math.sqrt(off))
                if i == high - low - 1:
                    # The next coedge gives this point; here only the gap at its end counts.
                    break
                r.pole[at] = 0 if surface_normal(g, row, u, v, scratch, point, r.normal[at]) else 1
                r.uv[at, 0], r.uv[at, 1] = u, v
                r.box[0], r.box[1] = min(r.box[0], u), max(r.box[1], u)
                r.box[2], r.box[3] = min(r.box[2], v), max(r.box[3], v)
                for d in range(3):
                    r.position[at, d] = samples.position[k, d]
                r.next[at] = at + 1
                r.segment[at] = k - 1 if coedge.reversed else k
                at += 1
        if at > start:
            r.next[at - 1] = start
    return trim, gap


@leaf
def to_lattice(value: float, low: float, high: float) -> int:
    """The lattice coordinate of a parameter in [low, high]."""
    return int(math.floor((value - low) / (high - low) * LATTICE + 0.5))
