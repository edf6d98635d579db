"""The shared edges and vertices of one part: each once, however many faces use them."""

from __future__ import annotations

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
from nurbs_ooc.geometry.forms import CurveForm
from nurbs_ooc.readers.curves import curve_form
from nurbs_ooc.readers.refusal import FaceRefusedError

FORWARD = TopAbs_Orientation.TopAbs_FORWARD


class EdgeTable:
    """Gives each topological edge and vertex of the part its row in the builder.

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
        return self._vertex_rows[index - 1]

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
            self.builder.vertex(point) if vertex.IsNull() else self.vertex(vertex)
            for vertex, point in ((first, form.start), (last, form.end))
        ]
        return self.add(form, rows[0], rows[1], tolerance)
