"""Writes a model as a STEP file (AP214) through Open CASCADE, so that a reader's whole way can be measured.

Parts are shells of B-spline faces with shared edges and no p-curves, as most CAD systems write them; groups are
assemblies, rigid placements are components. A mirrored or scaled placement, which STEP has no component for,
becomes a part of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from OCP.BRep import BRep_Builder
from OCP.collections import Array1_double, Array1_gp_Pnt, Array1_int, Array2_double, Array2_gp_Pnt
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.gp import gp_Pnt, gp_Trsf
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shell, TopoDS_Vertex, TopoDS_Wire
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

from nurbs_cache.errors import CacheError
from nurbs_cache.scene_record import Material
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.readers.kernel_setup import new_document, prepare_kernel
from nurbs_ooc.synth.baked import Baker
from nurbs_ooc.synth.model import CarModel
from nurbs_ooc.synth.part_draft import STAY

Array = npt.NDArray[np.float64]

RESOLUTION = 1e-6  # mm, tolerance of vertices, edges and faces where nothing larger is stated
FORWARD, REVERSED = TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED


def _reals(values: Array) -> Any:
    out = Array1_double(1, len(values))
    for i, value in enumerate(values.tolist(), start=1):
        out.SetValue(i, value)
    return out


def _knots(knots: Array) -> tuple[Any, Any]:
    """Distinct knots and their multiplicities."""
    distinct, counts = np.unique(knots, return_counts=True)
    times = Array1_int(1, len(counts))
    for i, count in enumerate(counts.tolist(), start=1):
        times.SetValue(i, count)
    return _reals(distinct), times


def _points(rows: Array, rational: bool) -> tuple[Array, Array]:
    return (rows[..., :3] / rows[..., 3:], rows[..., 3]) if rational else (rows, np.ones(rows.shape[:-1]))


class _Shape:
    """One part as a shell."""

    def __init__(self, geometry: GeometryBatch) -> None:
        self._g, self._build = geometry, BRep_Builder()
        self.shell = TopoDS_Shell()
        self._build.MakeShell(self.shell)
        self._vertices = [self._vertex(point) for point in geometry.vertices]
        self._edges = [self._edge(row) for row in geometry.edges]
        self.faces = [self._face(row) for row in geometry.surfaces]

    def _vertex(self, point: Array) -> Any:
        vertex = TopoDS_Vertex()
        self._build.MakeVertex(vertex, gp_Pnt(*point.tolist()), RESOLUTION)
        return vertex

    def _edge(self, row: np.void) -> Any:
        c = self._g.curves[row["curve"]]
        size = int(c["n"]) * (4 if c["rational"] else 3)
        points, weights = _points(self._g.values[c["points"] :][:size].reshape(int(c["n"]), -1), bool(c["rational"]))
        poles = Array1_gp_Pnt(1, len(points))
        for i, point in enumerate(points.tolist(), start=1):
            poles.SetValue(i, gp_Pnt(*point))
        knots = _knots(self._g.values[c["knots"] :][: c["n"] + c["degree"] + 1])
        curve = Geom_BSplineCurve(poles, _reals(weights), *knots, int(c["degree"]))
        edge = TopoDS_Edge()
        self._build.MakeEdge(edge, curve, max(RESOLUTION, float(row["tolerance"])))
        self._build.Add(edge, self._vertices[row["vertex0"]].Oriented(FORWARD))
        self._build.Add(edge, self._vertices[row["vertex1"]].Oriented(REVERSED))
        self._build.Range(edge, float(c["t0"]), float(c["t1"]))
        return edge

    def _face(self, s: np.void) -> Any:
        g = self._g
        n_u, n_v, width = int(s["n_u"]), int(s["n_v"]), 4 if s["rational"] else 3
        points, weights = _points(
            g.values[s["points"] :][: n_u * n_v * width].reshape(n_u, n_v, width), bool(s["rational"])
        )
        poles, scales = Array2_gp_Pnt(1, n_u, 1, n_v), Array2_double(1, n_u, 1, n_v)
        for i in range(n_u):
            for j in range(n_v):
                poles.SetValue(i + 1, j + 1, gp_Pnt(*points[i, j].tolist()))
                scales.SetValue(i + 1, j + 1, float(weights[i, j]))
        p, q = int(s["degree_u"]), int(s["degree_v"])
        (u, times_u), (v, times_v) = (
            _knots(g.values[s[name] :][: n + degree + 1])
            for name, n, degree in (("knots_u", n_u, p), ("knots_v", n_v, q))
        )
        surface = Geom_BSplineSurface(poles, scales, u, v, times_u, times_v, p, q)
        face = TopoDS_Face()
        self._build.MakeFace(face, surface, RESOLUTION)
        for loop in g.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]:
            wire = TopoDS_Wire()
            self._build.MakeWire(wire)
            for coedge in g.coedges[loop["first_coedge"] : loop["first_coedge"] + loop["n_coedges"]]:
                edge = self._edges[coedge["edge"]]
                self._build.Add(wire, edge.Oriented(REVERSED if coedge["reversed"] else FORWARD))
            self._build.Add(face, wire)
        face.Orientation(REVERSED if s["reversed"] else FORWARD)
        self._build.Add(self.shell, face)
        return face


class _Document:
    """An XCAF document that parts are added to."""

    def __init__(self, name: str, materials: list[Material]) -> None:
        prepare_kernel()
        self.document = new_document()
        main = self.document.Main()
        self._shapes, self._colours = XCAFDoc_DocumentTool.ShapeTool_s(main), XCAFDoc_DocumentTool.ColorTool_s(main)
        linear = Quantity_TypeOfColor.Quantity_TOC_RGB
        self._look = [Quantity_Color(*m.rgba[:3], linear) for m in materials]
        self._groups: dict[tuple[str, ...], TDF_Label] = {(): self._named(self._shapes.NewShape(), name)}

    def _named(self, label: TDF_Label, name: str) -> TDF_Label:
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))
        return label

    def _group(self, group: tuple[str, ...]) -> TDF_Label:
        if group not in self._groups:
            label = self._named(self._shapes.NewShape(), group[-1])
            self._shapes.AddComponent(self._group(group[:-1]), label, TopLoc_Location())
            self._groups[group] = label
        return self._groups[group]

    def finish(self) -> None:
        """Bring the assemblies' shapes up to date."""
        self._shapes.UpdateAssemblies()

    def part(self, geometry: GeometryBatch, name: str, group: tuple[str, ...], places: list[Array]) -> None:
        """Add a part and its rigid placements."""
        shape = _Shape(geometry)
        label = self._named(self._shapes.AddShape(shape.shell, False), name)
        material = geometry.surfaces["material"]
        usual = int(np.bincount(material).argmax())
        kind = XCAFDoc_ColorType.XCAFDoc_ColorSurf
        self._colours.SetColor(label, self._look[usual], kind)
        for row in np.flatnonzero(material != usual):
            self._colours.SetColor(
                self._shapes.AddSubShape(label, shape.faces[row]), self._look[int(material[row])], kind
            )
        for place in places:
            move = gp_Trsf()
            move.SetValues(*place.reshape(-1).tolist())
            self._named(self._shapes.AddComponent(self._group(group), label, TopLoc_Location(move)), name)


def _rigid(place: Array) -> bool:
    linear = place[:, :3]
    return bool(np.linalg.det(linear) > 0.0 and np.abs(linear @ linear.T - np.eye(3)).max() < 1e-12)


def write_step(
    model: CarModel, name: str, materials: list[Material], path: Path, advance: Callable[[int], None]
) -> None:
    """Write one car.

    Args:
        model: the car.
        name: of the root product.
        materials: of its surfaces.
        path: the file to write, .step or .stp.
        advance: told the surfaces of each part.

    Raises:
        CacheError: it cannot be written.
    """
    document = _Document(name, materials)
    for draft in model.parts():
        geometry = draft.builder.build(draft.name)
        rigid = [place for place in draft.places if _rigid(place)]
        if rigid:
            document.part(geometry, draft.name, draft.group, rigid)
        baker = Baker(geometry)
        for place in draft.places:
            if not _rigid(place):
                document.part(baker.moved(place), draft.name, draft.group, [STAY])
        advance(len(geometry) * len(draft.places))
    document.finish()
    writer = STEPCAFControl_Writer()
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    writer.Transfer(document.document)
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise CacheError(f"{path}: cannot be written as STEP")
