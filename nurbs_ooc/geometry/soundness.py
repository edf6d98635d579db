"""Numbers that no surface can be made of: not finite, weights that are not positive, knots that fall or tear it.

Readers heal or refuse such records; what comes through other doors (a program's own batches, an old
store) is found here, so that one bad face costs that face and its mates along a bad edge, no more.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import CurveKind, FaceReason, FaceStatus, SurfaceKind
from nurbs_ooc.geometry.ranges import Run, at_once
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NOT_FINITE = int(FaceReason.NOT_FINITE)
BAD_WEIGHTS = int(FaceReason.BAD_WEIGHTS)
BAD_KNOTS = int(FaceReason.BAD_KNOTS)
NURBS_CURVE = int(CurveKind.NURBS)
NURBS_SURFACE = int(SurfaceKind.NURBS)
FRAME_LENGTH = 14


@leaf
def _finite(values: Floats, start: int, n: int) -> bool:
    for i in range(start, start + n):
        if not math.isfinite(values[i]):
            return False
    return True


@leaf
def _positive(values: Floats, start: int, n: int, step: int) -> bool:
    """Whether every ``step``-th number, from ``start`` on, is above 0; ``n`` of them."""
    for i in range(n):
        if not values[start + i * step] > 0.0:
            return False
    return True


@leaf
def _knot_fault(values: Floats, start: int, n: int, degree: int) -> int:
    """Reason why ``n`` control points of a degree cannot have the knots at ``start``; 0 if they can."""
    if degree < 1 or degree > MAX_DEGREE or n <= degree:
        return BAD_KNOTS
    if not _finite(values, start, n + degree + 1):
        return NOT_FINITE
    for i in range(start, start + n + degree):
        if values[i] > values[i + 1]:
            return BAD_KNOTS
    # An inner knot of more than the degree tears the curve or surface in two; what joins the parts is not the file's.
    for i in range(start + 1, start + n):
        if values[i] == values[i + degree]:
            return BAD_KNOTS
    return 0 if values[start + degree] < values[start + n] else BAD_KNOTS


@leaf
def _curve_fault(g: Tables, row: int) -> int:
    c = g.curves[row]
    if not (math.isfinite(c.t0) and math.isfinite(c.t1) and c.t0 < c.t1):
        return NOT_FINITE
    if c.kind != NURBS_CURVE:
        return 0 if _finite(g.values, c.points, 3 * int(c.dim)) else NOT_FINITE
    fault = _knot_fault(g.values, c.knots, c.n, c.degree)
    step = int(c.dim) + int(c.rational)
    if fault == 0 and not _finite(g.values, c.points, c.n * step):
        fault = NOT_FINITE
    if fault == 0 and c.rational and not _positive(g.values, c.points + int(c.dim), c.n, step):
        fault = BAD_WEIGHTS
    return fault


@leaf
def _surface_fault(g: Tables, row: int) -> int:
    s = g.surfaces[row]
    ends = math.isfinite(s.u0) and math.isfinite(s.u1) and math.isfinite(s.v0) and math.isfinite(s.v1)
    if not (ends and s.u0 < s.u1 and s.v0 < s.v1):
        return NOT_FINITE
    if s.kind != NURBS_SURFACE:
        fault = 0 if _finite(g.values, s.frame, FRAME_LENGTH) else NOT_FINITE
        if fault == 0 and s.profile >= 0:
            fault = _curve_fault(g, s.profile)
        return fault
    fault = max(
        _knot_fault(g.values, s.knots_u, s.n_u, s.degree_u), _knot_fault(g.values, s.knots_v, s.n_v, s.degree_v)
    )
    step = 4 if s.rational else 3
    if fault == 0 and not _finite(g.values, s.points, s.n_u * s.n_v * step):
        fault = NOT_FINITE
    if fault == 0 and s.rational and not _positive(g.values, s.points + 3, s.n_u * s.n_v, step):
        fault = BAD_WEIGHTS
    return fault


@kernel
def _find_edges(g: Tables, edge_fault: Ints, low: int, high: int) -> None:
    """Reasons why edges low..high - 1 cannot be computed; 0 where they can."""
    for e in range(low, high):
        edge = g.edges[e]
        if not (math.isfinite(edge.t0) and math.isfinite(edge.t1) and edge.t0 < edge.t1):
            edge_fault[e] = NOT_FINITE
        elif edge.curve >= 0:
            edge_fault[e] = _curve_fault(g, edge.curve)
        for k in range(3):
            if not (math.isfinite(g.vertices[edge.vertex0, k]) and math.isfinite(g.vertices[edge.vertex1, k])):
                edge_fault[e] = NOT_FINITE


@kernel
def _find_surfaces(g: Tables, edge_fault: Ints, surface_fault: Ints, low: int, high: int) -> None:
    """The same of surfaces low..high - 1 with their loops."""
    for row in range(low, high):
        s = g.surfaces[row]
        surface_fault[row] = _surface_fault(g, row)
        for m in range(s.first_loop, s.first_loop + s.n_loops):
            for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
                fault = max(edge_fault[g.coedges[c].edge], _curve_fault(g, g.coedges[c].pcurve))
                if surface_fault[row] == 0:
                    surface_fault[row] = fault


def sound_tables(g: Tables, run: Run = at_once) -> Tables:
    """The tables with every face that cannot be computed marked FAILED, with its reason.

    Edges with such numbers are left without a curve: all faces along them are FAILED.

    Args:
        g: the part's tables.
        run: maps a kernel over ranges of edges, and of surfaces.

    Returns:
        The tables; ``g`` itself if there are no such faces.
    """
    surface_fault = np.zeros(len(g.surfaces), np.int64)
    edge_fault = np.zeros(len(g.edges), np.int64)
    run(lambda low, high: _find_edges(g, edge_fault, low, high), len(g.edges))
    run(lambda low, high: _find_surfaces(g, edge_fault, surface_fault, low, high), len(g.surfaces))
    bad = (surface_fault > 0) & (g.surfaces["status"] != FaceStatus.FAILED)
    if not bad.any() and not edge_fault.any():
        return g
    surfaces, edges = g.surfaces.copy(), g.edges.copy()
    surfaces["status"][bad] = FaceStatus.FAILED
    surfaces["reason"][bad] = surface_fault[bad]
    edges["curve"][edge_fault > 0] = -1
    edges["t0"][edge_fault > 0], edges["t1"][edge_fault > 0] = 0.0, 1.0
    return g._replace(surfaces=surfaces, edges=edges)
