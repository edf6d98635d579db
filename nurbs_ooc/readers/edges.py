"""The shared edges and vertices of one part: each once, however many faces use them."""

from __future__ import annotations

from math import dist
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepLib import BRepLib
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import Array, CurveForm
from nurbs_ooc.readers.curves import curve_form
from nurbs_ooc.readers.refusal import FaceRefusedError

FORWARD = TopAbs_Orientation.TopAbs_FORWARD
LEAST_MISS = 1e-3  # mm; below this no edge is looked at more closely
MISSED_SHARE = 0.05  # of an edge's length: a curve that ends further from its vertex is bridged


class EdgeTable:
    """Gives each topological edge and vertex of the part its row in the builder.

    Some files name a curve for an edge that lies far from the edge's vertices, though the vertices fit
    the neighbouring edges. Such an edge is recorded as the straight line between its vertices and its
    row is in ``broken``: its p-curves are as wrong and have to be made anew. A curve that misses only
    one of its vertices keeps its own end, and a straight bridge goes on from there to the vertex; all
    faces at the edge share the bridge.

    Args:
        builder: takes the records in the order of first use.
    """

    def __init__(self, builder: BatchBuilder) -> None:
        self.builder = builder
        self._edges = ShapeMap()
        self._vertices = ShapeMap()
        self._edge_rows: list[int] = []
        self._vertex_rows: list[int] = []
        self._tolerances: dict[int, float] = {}
        self._ends: dict[int, tuple[int, int]] = {}
        self._points: dict[int, tuple[float, ...]] = {}
        self._bridges: dict[tuple[int, int], int] = {}
        self._joins: dict[tuple[int, int], int] = {}
        self.broken: set[int] = set()

    def edge(self, edge: Any) -> int:
        """Row of ``edge``, recorded on its first use.

        Raises:
            FaceRefusedError: the edge has no usable 3D curve.
        """
        index = int(self._edges.Add(edge))
        if index > len(self._edge_rows):
            self._edge_rows.append(-1)
        if self._edge_rows[index - 1] < 0:
            self._edge_rows[index - 1] = self._record(TopoDS.Edge(edge.Oriented(FORWARD)))
        return self._edge_rows[index - 1]

    def vertex(self, vertex: Any) -> int:
        """Row of ``vertex``, recorded on its first use."""
        index = int(self._vertices.Add(vertex))
        if index > len(self._vertex_rows):
            point = BRep_Tool.Pnt_s(vertex).Coord()
            if not np.isfinite(point).all():
                raise FaceRefusedError(FaceReason.NOT_FINITE, "a vertex is not finite")
            row = self.builder.vertex(point)
            self._vertex_rows.append(row)
            self._tolerances[row] = BRep_Tool.Tolerance_s(vertex)
            self._points[row] = point
        return self._vertex_rows[index - 1]

    def free_vertex(self, point: Array) -> int:
        """Row of a new vertex that is not in the file."""
        row = self.builder.vertex(point)
        self._points[row] = tuple(point.tolist())
        return row

    def vertex_tolerance(self, row: int) -> float:
        """The file's tolerance of the vertex in ``row``, mm."""
        return self._tolerances.get(row, 0.0)

    def ends(self, row: int) -> tuple[int, int]:
        """Rows of the vertices at t0 and t1 of the edge in ``row``."""
        return self._ends[row]

    def add(self, form: CurveForm | None, vertex0: int, vertex1: int, tolerance: float) -> int:
        """Append an edge that is not in the file; without a curve it is one point."""
        if form is None:
            row = self.builder.pole(vertex0, tolerance=tolerance)
        else:
            row = self.builder.edge(form, vertex0, vertex1, tolerance)
        self._ends[row] = (vertex0, vertex1)
        return row

    def _record(self, edge: Any) -> int:
        first, last = TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge)
        tolerance = BRep_Tool.Tolerance_s(edge)
        t0, t1 = BRep_Tool.Range_s(edge)
        if BRep_Tool.Degenerated_s(edge):
            vertex = self.vertex(first if not first.IsNull() else last)
            row = self.builder.pole(vertex, t0, t1, tolerance)
            self._ends[row] = (vertex, vertex)
            return row
        curve = BRep_Tool.Curve_s(edge, 0.0, 0.0)
        if curve is None:
            if not BRepLib.BuildCurve3d_s(edge):
                raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "an edge has no curve in space")
            curve = BRep_Tool.Curve_s(edge, 0.0, 0.0)
            t0, t1 = BRep_Tool.Range_s(edge)
        form = curve_form(curve, t0, t1)
        rows = [
            self.free_vertex(point) if vertex.IsNull() else self.vertex(vertex)
            for vertex, point in ((first, form.start), (last, form.end))
        ]
        return self._joined(form, rows, tolerance)

    def bridge(self, row: int, end: int) -> int | None:
        """Row of the bridge from the curve's end (0: at t0, 1: at t1) to the vertex, if there is one."""
        return self._bridges.get((row, end))

    def join(self, vertex0: int, vertex1: int) -> tuple[int, bool]:
        """Row of a straight edge between two vertices that the file leaves open; whether it runs backwards."""
        key = (min(vertex0, vertex1), max(vertex0, vertex1))
        if key not in self._joins:
            self._joins[key] = self.add(CurveForm.line(self._points[key[0]], self._points[key[1]]), *key, 0.0)
        return self._joins[key], vertex0 > vertex1

    def _joined(self, form: CurveForm, rows: list[int], tolerance: float) -> int:
        """Append an edge and make sure that it reaches its vertices."""
        points = [self._points[row] for row in rows]
        ends = [form.start, form.end]
        misses = [dist(end, point) for end, point in zip(ends, points, strict=True)]
        if max(misses) < LEAST_MISS:
            return self.add(form, rows[0], rows[1], tolerance)
        length = float(np.linalg.norm(np.diff(form.polygon(), axis=0), axis=1).sum())
        if min(misses) > length:
            row = self.add(CurveForm.line(points[0], points[1], form.t0, form.t1), rows[0], rows[1], 0.0)
            self.broken.add(row)
            return row
        missed = [miss > MISSED_SHARE * length for miss in misses]
        own = [self.builder.vertex(end) if far else row for far, end, row in zip(missed, ends, rows, strict=True)]
        row = self.add(form, own[0], own[1], tolerance)
        self._ends[row] = (rows[0], rows[1])
        for end in (0, 1):
            if missed[end]:
                line = CurveForm.line(ends[end], points[end])
                self._bridges[row, end] = self.add(line, own[end], rows[end], 0.0)
        return row
