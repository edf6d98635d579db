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

from nurbs_cache.jit import helper, leaf
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.predicates import LATTICE
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.edges import EdgeSamples

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
    box: Floats  # (4,) u0, u1, v0, v1 of all points
    trim: float  # mm, bound of the slivers between p-curves and segments
    gap: float  # mm, largest distance between a position and the surface at its (u, v)


@leaf
def _count_points(g: Tables, samples: EdgeSamples, row: int) -> int:
    s = g.surfaces[row]
    n = 0
    for m in range(s.first_loop, s.first_loop + s.n_loops):
        for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
            e = g.coedges[c].edge
            n += max(samples.first[e + 1] - samples.first[e] - 1, 0)
    return n


@helper
def gather_boundary(g: Tables, samples: EdgeSamples, row: int) -> Boundary:
    """Collect the loops of surface ``row``; each coedge gives its samples but the last."""
    s = g.surfaces[row]
    n = _count_points(g, samples, row)
    uv = np.empty((n, 2))
    position = np.empty((n, 3))
    normal = np.empty((n, 3))
    pole = np.zeros(n, dtype=np.uint8)
    follow = np.empty(n, dtype=np.int64)
    segments = np.empty(n, dtype=np.int64)
    scratch = np.empty((4, MAX_DEGREE + 2))
    point = np.empty(12)
    trim = 0.0
    gap = 0.0
    at = 0
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
                pole[at] = 0 if surface_normal(g, row, u, v, scratch, point, normal[at]) else 1
                uv[at, 0], uv[at, 1] = u, v
                for d in range(3):
                    position[at, d] = samples.position[k, d]
                follow[at] = at + 1
                segments[at] = k - 1 if coedge.reversed else k
                at += 1
        if at > start:
            follow[at - 1] = start
    box = np.zeros(4)
    if n > 0:
        box[0], box[1] = uv[:, 0].min(), uv[:, 0].max()
        box[2], box[3] = uv[:, 1].min(), uv[:, 1].max()
    return Boundary(uv, position, normal, pole, follow, segments, box, trim, gap)


@leaf
def to_lattice(value: float, low: float, high: float) -> int:
    """The lattice coordinate of a parameter in [low, high]."""
    return int(math.floor((value - low) / (high - low) * LATTICE + 0.5))
