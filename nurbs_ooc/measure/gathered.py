"""Chosen surfaces of several parts side by side in one batch, so that one kernel call can take them all.

Only what the attack evaluates is taken along: surfaces, loops, co-edges, p-curves and profiles with
their numbers; no edges, no vertices.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    CurveKind,
    GeometryBatch,
    SurfaceKind,
)

FRAME = 14  # numbers of an analytic surface's frame

Indices = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]


def gathered(parts: Mapping[int, GeometryBatch], part: Indices, row: Indices) -> GeometryBatch:
    """The surfaces ``row[i]`` of ``parts[part[i]]``, in this order, without their edges and names."""
    batches = [_picked(parts[int(p)], row[part == p]) for p in np.unique(part)]
    joined = _joined(batches)
    place = np.argsort(np.argsort(part, kind="stable"), kind="stable")
    joined.surfaces[:] = joined.surfaces[place]
    return joined


def _ranges(first: npt.NDArray[np.integer], count: npt.NDArray[np.integer]) -> tuple[Indices, Indices]:
    """The numbers of ranges one after the other, and where each range begins among them."""
    lengths = count.astype(np.int64)
    begin = np.cumsum(lengths) - lengths
    return np.arange(lengths.sum()) + np.repeat(first.astype(np.int64) - begin, lengths), begin


def _picked(g: GeometryBatch, rows: Indices) -> GeometryBatch:
    """Some surfaces of one part with what they need."""
    surfaces = g.surfaces[rows].copy()
    at, surfaces["first_loop"] = _ranges(surfaces["first_loop"], surfaces["n_loops"])
    loops = g.loops[at].copy()
    at, loops["first_coedge"] = _ranges(loops["first_coedge"], loops["n_coedges"])
    coedges = g.coedges[at].copy()
    coedges["edge"] = -1
    used = np.unique(np.concatenate([coedges["pcurve"], surfaces["profile"][surfaces["profile"] >= 0]]))
    curves = g.curves[used].copy()
    coedges["pcurve"] = np.searchsorted(used, coedges["pcurve"])
    surfaces["profile"] = np.where(surfaces["profile"] < 0, -1, np.searchsorted(used, surfaces["profile"]))
    values = _move_numbers(g.values, surfaces, curves)
    return _batch(surfaces, loops, coedges, curves, values)


def _move_numbers(values: npt.NDArray[np.float64], surfaces: Rows, curves: Rows) -> npt.NDArray[np.float64]:
    """The numbers these records point to, each range copied by itself; sets the new offsets."""
    s, c = (
        {name: surfaces[name].astype(np.int64) for name in ("n_u", "n_v", "degree_u", "degree_v", "rational")},
        curves,
    )
    is_nurbs, is_spline = surfaces["kind"] == SurfaceKind.NURBS, curves["kind"] == CurveKind.NURBS
    n, dim = c["n"].astype(np.int64), c["dim"].astype(np.int64)
    wanted = [
        (surfaces, "knots_u", np.where(is_nurbs, s["n_u"] + s["degree_u"] + 1, 0)),
        (surfaces, "knots_v", np.where(is_nurbs, s["n_v"] + s["degree_v"] + 1, 0)),
        (surfaces, "points", np.where(is_nurbs, s["n_u"] * s["n_v"] * (3 + s["rational"]), 0)),
        (surfaces, "frame", np.where(is_nurbs, 0, FRAME)),
        (curves, "knots", np.where(is_spline, n + c["degree"] + 1, 0)),
        (curves, "points", np.where(is_spline, n * (dim + c["rational"]), 3 * dim)),
    ]
    first = np.concatenate([table[name].astype(np.int64) for table, name, _ in wanted])
    at, begin = _ranges(np.maximum(first, 0), np.concatenate([count for *_, count in wanted]))
    done = 0
    for table, name, count in wanted:
        table[name] = begin[done : done + len(count)]
        done += len(count)
    return values[at]


def _joined(batches: list[GeometryBatch]) -> GeometryBatch:
    """Batches one after the other, their pointers moved."""
    n_loops = n_coedges = n_curves = n_values = 0
    for b in batches:
        b.surfaces["first_loop"] += n_loops
        b.loops["first_coedge"] += n_coedges
        b.coedges["pcurve"] += n_curves
        b.surfaces["profile"][b.surfaces["profile"] >= 0] += n_curves
        for table, names in ((b.surfaces, ("knots_u", "knots_v", "points", "frame")), (b.curves, ("knots", "points"))):
            for name in names:
                table[name] += n_values
        n_loops, n_coedges = n_loops + len(b.loops), n_coedges + len(b.coedges)
        n_curves, n_values = n_curves + len(b.curves), n_values + len(b.values)
    tables = [
        np.concatenate([np.zeros(0, dtype), *(getattr(b, name) for b in batches)])
        for name, dtype in (
            ("surfaces", SURFACE_DTYPE), ("loops", LOOP_DTYPE), ("coedges", COEDGE_DTYPE), ("curves", CURVE_DTYPE),
            ("values", np.dtype(np.float64)),
        )
    ]  # fmt: skip
    return _batch(*tables)


def _batch(surfaces: Rows, loops: Rows, coedges: Rows, curves: Rows, values: npt.NDArray[np.float64]) -> GeometryBatch:
    return GeometryBatch(surfaces, loops, coedges, np.zeros(0, EDGE_DTYPE), curves, np.zeros((0, 3)), values)
