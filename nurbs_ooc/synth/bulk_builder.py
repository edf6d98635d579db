"""Collects curves, edges, faces and loops by the array into a ``GeometryBatch``.

What ``geometry.builder.BatchBuilder`` does one record at a time, this does for n records of one shape
(degree, knots, size) in one call, so that millions of faces cost numpy calls, not Python loops. Rows
are given out in order; loops may be added in any order and are sorted when the batch is built.
"""

from __future__ import annotations

from collections.abc import Sequence

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

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


class BulkBuilder:
    """Appends arrays of records; see the module."""

    def __init__(self) -> None:
        self._tables: dict[str, list[npt.NDArray[np.void]]] = {k: [] for k in ("surfaces", "edges", "curves")}
        self._counts = {"surfaces": 0, "edges": 0, "curves": 0, "vertices": 0, "values": 0, "coedges": 0}
        self._vertices: list[Array] = []
        self._values: list[Array] = []
        self._coedges: list[npt.NDArray[np.void]] = []
        self._places: list[npt.NDArray[np.int64]] = []  # surface, loop, order of each coedge
        self._knots: dict[bytes, int] = {}
        self.n_control_points = 0

    @property
    def n_surfaces(self) -> int:
        """Surfaces so far."""
        return self._counts["surfaces"]

    def _append(self, table: str, rows: npt.NDArray[np.void]) -> Rows:
        first = self._counts[table]
        self._tables[table].append(rows)
        self._counts[table] += len(rows)
        return np.arange(first, first + len(rows))

    def _store(self, values: Array) -> int:
        offset = self._counts["values"]
        flat = np.ascontiguousarray(values, np.float64).reshape(-1)
        self._values.append(flat)
        self._counts["values"] += flat.size
        return offset

    def _store_knots(self, knots: Array) -> int:
        """Equal knot vectors are stored once."""
        key = np.ascontiguousarray(knots, np.float64).tobytes()
        if key not in self._knots:
            self._knots[key] = self._store(knots)
        return self._knots[key]

    def vertices(self, points: Array) -> Rows:
        """Append (n, 3) vertices, mm."""
        points = np.asarray(points, np.float64).reshape(-1, 3)
        first = self._counts["vertices"]
        self._vertices.append(points)
        self._counts["vertices"] += len(points)
        return np.arange(first, first + len(points))

    def vertex(self, row: int) -> Array:
        """(3,) the vertex in ``row``."""
        first = self._counts["vertices"]
        for points in self._vertices[::-1]:  # the latest are asked for most
            first -= len(points)
            if row >= first:
                return points[row - first]
        raise IndexError(row)

    def all_vertices(self) -> Array:
        """(n, 3) all vertices so far."""
        return np.concatenate([*self._vertices, np.empty((0, 3))])

    def curves(self, degree: int, knots: Array, points: Array, *, rational: bool = False) -> Rows:
        """Append n B-spline curves of one knot vector.

        Args:
            points: (n, k, dim) or, if rational, (n, k, dim + 1) homogeneous.
        """
        n, size, width = points.shape
        table = np.zeros(n, CURVE_DTYPE)
        table["kind"], table["dim"], table["rational"] = CurveKind.NURBS, width - rational, rational
        table["degree"], table["n"] = degree, size
        table["knots"] = self._store_knots(knots)
        table["points"] = self._store(points) + np.arange(n) * size * width
        table["t0"], table["t1"] = knots[degree], knots[-degree - 1]
        return self._append("curves", table)

    def lines(self, start: Array, end: Array, t0: float = 0.0, t1: float = 1.0) -> Rows:
        """Append n straight curves from ``start`` (n, dim) at t0 to ``end`` at t1."""
        start, end = np.broadcast_arrays(start, end)
        return self.curves(1, np.array([t0, t0, t1, t1]), np.stack([start, end], axis=1))

    def ellipses(self, center: Array, a: Array, b: Array, t0: float = 0.0, t1: float = 2.0 * np.pi) -> Rows:
        """Append n curves C + cos(t) A + sin(t) B, each argument (n, dim)."""
        center, a, b = np.broadcast_arrays(center, a, b)
        n, dim = center.shape
        table = np.zeros(n, CURVE_DTYPE)
        table["kind"], table["dim"], table["t0"], table["t1"] = CurveKind.ELLIPSE, dim, t0, t1
        table["points"] = self._store(np.stack([center, a, b], axis=1)) + np.arange(n) * 3 * dim
        return self._append("curves", table)

    def stretches(self, curves: Rows, t0: float | Array, t1: float | Array) -> Rows:
        """Append curves that are the stretches t0..t1 of others, sharing their control points."""
        self._tables["curves"] = [_joined(self._tables["curves"], CURVE_DTYPE)]
        table = _taken(self._tables["curves"][0], curves)
        table["t0"], table["t1"] = t0, t1
        return self._append("curves", table)

    def edges(
        self,
        curves: Rows,
        vertex0: Rows,
        vertex1: Rows,
        tolerance: float | Array = 0.0,
    ) -> Rows:
        """Append n edges over 0..1 that run along whole curves (row -1: the edge is one point, a pole)."""
        table = np.zeros(len(curves), EDGE_DTYPE)
        table["id"] = self._counts["edges"] + np.arange(len(curves))
        table["curve"], table["vertex0"], table["vertex1"] = curves, vertex0, vertex1
        table["t1"], table["tolerance"] = 1.0, tolerance
        return self._append("edges", table)

    def surfaces(
        self,
        degrees: tuple[int, int],
        knots: tuple[Array, Array],
        points: Array,
        *,
        rational: bool = False,
        reversed: bool | npt.NDArray[np.bool_] = False,
        material: int | npt.NDArray[np.integer] = 0,
    ) -> Rows:
        """Append n B-spline surfaces of one shape over their whole domains.

        Args:
            points: (n, n_u, n_v, 3) or, if rational, (n, n_u, n_v, 4) homogeneous.
        """
        n, n_u, n_v, width = points.shape
        table = np.zeros(n, SURFACE_DTYPE)
        table["kind"], table["rational"], table["reversed"] = SurfaceKind.NURBS, rational, reversed
        table["degree_u"], table["degree_v"] = degrees
        table["n_u"], table["n_v"], table["profile"], table["frame"] = n_u, n_v, -1, -1
        table["material"] = material
        table["source"] = self._counts["surfaces"] + np.arange(n)
        table["knots_u"], table["knots_v"] = self._store_knots(knots[0]), self._store_knots(knots[1])
        table["points"] = self._store(points) + np.arange(n) * n_u * n_v * width
        table["u0"], table["u1"] = knots[0][degrees[0]], knots[0][-degrees[0] - 1]
        table["v0"], table["v1"] = knots[1][degrees[1]], knots[1][-degrees[1] - 1]
        self.n_control_points += n * n_u * n_v
        return self._append("surfaces", table)

    def coedges(
        self,
        surface: Rows,
        loop: int | Rows,
        order: int | Rows,
        edge: Rows,
        pcurve: Rows,
        *,
        reversed: bool | npt.NDArray[np.bool_] = False,
        seam: bool = False,
        pole: bool = False,
    ) -> None:
        """Use n edges in loops: ``order`` is the place in loop number ``loop`` (0: outer) of ``surface``."""
        table = np.zeros(len(edge), COEDGE_DTYPE)
        table["edge"], table["pcurve"], table["reversed"] = edge, pcurve, reversed
        table["seam"], table["pole"] = seam, pole
        self._coedges.append(table)
        self._places.append(np.stack(np.broadcast_arrays(surface, loop, order), axis=1).astype(np.int64))

    def build(self, sources: Sequence[str] | str = "face") -> GeometryBatch:
        """All records so far as one batch; ``sources`` names the faces, or is what their names start with."""
        surfaces = _joined(self._tables["surfaces"], SURFACE_DTYPE)
        places = np.concatenate([*self._places, np.empty((0, 3), np.int64)])
        order = np.lexsort((places[:, 2], places[:, 1], places[:, 0]))
        places = places[order]
        starts = np.flatnonzero(np.diff(places[:, 0] * (1 << 20) + places[:, 1], prepend=-1))
        loops = np.zeros(len(starts), LOOP_DTYPE)
        loops["first_coedge"] = starts
        loops["n_coedges"] = np.diff(starts, append=len(places))
        counts = (
            np.bincount(places[starts, 0], minlength=len(surfaces)) if len(starts) else np.zeros(len(surfaces), int)
        )
        surfaces["n_loops"] = counts
        surfaces["first_loop"] = np.cumsum(counts) - counts
        if isinstance(sources, str):
            sources = [f"{sources} {i + 1}" for i in range(len(surfaces))]
        return GeometryBatch(
            surfaces=surfaces,
            loops=loops,
            coedges=_taken(_joined(self._coedges, COEDGE_DTYPE), order),
            edges=_joined(self._tables["edges"], EDGE_DTYPE),
            curves=_joined(self._tables["curves"], CURVE_DTYPE),
            vertices=self.all_vertices(),
            values=np.concatenate([*self._values, np.empty(0)]),
            sources=list(sources),
        )


def _joined(tables: list[npt.NDArray[np.void]], dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
    """One table, byte for byte: padding stays zero, so that equal content is equal bytes."""
    return np.frombuffer(bytearray(b"".join(table.tobytes() for table in tables)), dtype)


def _taken(table: npt.NDArray[np.void], rows: Rows) -> npt.NDArray[np.void]:
    """Rows of a table, byte for byte."""
    return table.view(f"V{table.dtype.itemsize}")[rows].view(table.dtype)
