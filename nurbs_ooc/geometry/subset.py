"""Some surfaces of a part as a record of their own, with all the curves they need and nothing else.

Tables are followed from the surfaces downwards; each table keeps the rows that are reached, in their
old order, and every pointer is re-based onto the shortened table::

    surfaces -> loops -> coedges -> edges -> vertices
        |                   |         |
        +----> profile      +--> curves (p-curves, edge curves, profiles) --> values

The cost follows what is kept, not the size of the part.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

Rows = npt.NDArray[np.int64]

FRAME_LENGTH = 14
CONIC_POINTS = 3  # an ellipse or a hyperbola: centre and two half axes


def subset(geometry: GeometryBatch, rows: npt.ArrayLike) -> GeometryBatch:
    """The surfaces ``rows`` of ``geometry``, in that order, as a self-contained batch.

    Edge ids and the rows of materials stay, for they count through the whole assembly. With all rows
    in order the result equals ``geometry``, less what no surface uses.

    Args:
        geometry: one part.
        rows: (n,) integers in [0, len(geometry)); a repeated row is repeated in the result, sharing
            edges, curves and numbers.

    Raises:
        UsageError: a row is out of range.
    """
    wanted = np.asarray(rows, np.int64).reshape(-1)
    if wanted.size and (wanted.min() < 0 or wanted.max() >= len(geometry)):
        raise UsageError(f"surface rows {wanted.min()}..{wanted.max()} are outside 0..{len(geometry) - 1}")

    surfaces = take(geometry.surfaces, wanted)
    loops = take(geometry.loops, expand(surfaces["first_loop"], surfaces["n_loops"]))
    coedges = take(geometry.coedges, expand(loops["first_coedge"], loops["n_coedges"]))
    surfaces["first_loop"] = starts(surfaces["n_loops"])
    loops["first_coedge"] = starts(loops["n_coedges"])

    edge_rows = _reached(coedges["edge"])
    edges = take(geometry.edges, edge_rows)
    coedges["edge"] = _rebased(coedges["edge"], edge_rows)

    vertex_rows = _reached(edges["vertex0"], edges["vertex1"])
    for name in ("vertex0", "vertex1"):
        edges[name] = _rebased(edges[name], vertex_rows)

    curve_rows = _reached(coedges["pcurve"], edges["curve"], surfaces["profile"])
    curves = take(geometry.curves, curve_rows)
    for table, name in ((coedges, "pcurve"), (edges, "curve"), (surfaces, "profile")):
        table[name] = _rebased(table[name], curve_rows)

    return GeometryBatch(
        surfaces,
        loops,
        coedges,
        edges,
        curves,
        geometry.vertices[vertex_rows],
        _move_values(geometry.values, surfaces, curves),
        _move_sources(geometry.sources, surfaces),
    )


def take(table: npt.NDArray[np.void], rows: Rows) -> npt.NDArray[np.void]:
    """``table[rows]`` byte for byte: numpy leaves the gaps of a structured row undefined, which would be stored."""
    raw = np.ascontiguousarray(table).view(np.dtype((np.void, table.dtype.itemsize)))
    return raw[rows].view(table.dtype)


def expand(first: npt.NDArray[np.integer], count: npt.NDArray[np.integer]) -> Rows:
    """The rows of many ranges one after the other: ``first[i], ..., first[i] + count[i] - 1`` for each i."""
    lengths = count.astype(np.int64)
    return np.arange(lengths.sum()) + np.repeat(first.astype(np.int64) - starts(lengths), lengths)


def starts(count: npt.NDArray[np.integer]) -> Rows:
    """Where each of consecutive ranges of these lengths begins."""
    lengths = count.astype(np.int64)
    return np.cumsum(lengths) - lengths


def _reached(*columns: npt.NDArray[np.integer]) -> Rows:
    """The rows that these columns point to, ascending, each once; negative means none."""
    every = np.unique(np.concatenate([column.astype(np.int64) for column in columns]))
    return every[every >= 0]


def _rebased(column: npt.NDArray[np.integer], kept: Rows) -> Rows:
    """Where the targets of ``column`` lie among the ``kept`` rows; negative stays as it is."""
    return np.where(column < 0, column, np.searchsorted(kept, column))


def _move_sources(sources: list[str], surfaces: npt.NDArray[np.void]) -> list[str]:
    """Names of the kept surfaces; re-bases ``surfaces["source"]``. A row without a name becomes -1."""
    surfaces["source"][surfaces["source"] >= len(sources)] = -1
    kept = _reached(surfaces["source"])
    surfaces["source"] = _rebased(surfaces["source"], kept)
    return [sources[row] for row in kept]


def _move_values(
    values: npt.NDArray[np.float64], surfaces: npt.NDArray[np.void], curves: npt.NDArray[np.void]
) -> npt.NDArray[np.float64]:
    """The numbers of these surfaces and curves; re-bases their offsets.

    Ranges may overlap (equal knot vectors are shared): overlapping ones are kept as one block.
    """
    fields = [*_surface_ranges(surfaces), *_curve_ranges(curves)]
    if not fields:
        return values[:0]
    first = np.concatenate([table[name][rows] for table, name, rows, _ in fields])
    length = np.concatenate([lengths for *_, lengths in fields])

    order = np.argsort(first, kind="stable")
    first_sorted, end_sorted = first[order], (first + length)[order]
    reach = np.maximum.accumulate(end_sorted)
    is_new = np.r_[True, first_sorted[1:] >= reach[:-1]][: len(first)]
    block_first = first_sorted[is_new]
    block_end = reach[np.r_[np.flatnonzero(is_new)[1:] - 1, len(first) - 1]] if len(first) else reach
    block_length = block_end - block_first
    shift = starts(block_length) - block_first

    for table, name, rows, _ in fields:
        old = table[name][rows]
        table[name][rows] = old + shift[np.searchsorted(block_first, old, side="right") - 1]
    return values[expand(block_first, block_length)]


Range = tuple[npt.NDArray[np.void], str, Rows, Rows]  # table, offset column, rows that use it, numbers each


def _surface_ranges(surfaces: npt.NDArray[np.void]) -> list[Range]:
    """The offset columns of surfaces that are in use, and how many numbers each offset stands for."""
    nurbs = np.flatnonzero(surfaces["kind"] == SurfaceKind.NURBS)
    framed = np.flatnonzero(surfaces["kind"] != SurfaceKind.NURBS)
    s = surfaces[nurbs]
    n_u, n_v = s["n_u"].astype(np.int64), s["n_v"].astype(np.int64)
    return [
        (surfaces, "knots_u", nurbs, n_u + s["degree_u"] + 1),
        (surfaces, "knots_v", nurbs, n_v + s["degree_v"] + 1),
        (surfaces, "points", nurbs, n_u * n_v * (3 + s["rational"])),
        (surfaces, "frame", framed, np.full(len(framed), FRAME_LENGTH)),
    ]


def _curve_ranges(curves: npt.NDArray[np.void]) -> list[Range]:
    """The same of curves."""
    nurbs = np.flatnonzero(curves["kind"] == CurveKind.NURBS)
    conics = np.flatnonzero(curves["kind"] != CurveKind.NURBS)
    c = curves[nurbs]
    n = c["n"].astype(np.int64)
    return [
        (curves, "knots", nurbs, n + c["degree"] + 1),
        (curves, "points", nurbs, n * (c["dim"].astype(np.int64) + c["rational"])),
        (curves, "points", conics, CONIC_POINTS * curves["dim"][conics].astype(np.int64)),
    ]
