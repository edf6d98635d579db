"""The samples of all edges of a part, and where they lie."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_cache.surface_record import ON_SURFACE, POLE
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.ranges import Run
from nurbs_ooc.geometry.surface import surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.edge_uses import EdgeUses

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Samples of one edge: beyond it the error is reported as it is.
MAX_SAMPLES = 1 << 16
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
