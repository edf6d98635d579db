"""Dirty topology, made by hand: what is repaired, and what the status says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakePolygon,
    BRepBuilderAPI_MakeVertex,
    BRepBuilderAPI_MakeWire,
    BRepBuilderAPI_Transform,
)
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCone, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeTorus
from OCP.collections import Array1_gp_Pnt, Array1_gp_Pnt2d
from OCP.Geom import Geom_BezierCurve, Geom_CylindricalSurface, Geom_Plane, Geom_SphericalSurface
from OCP.Geom2d import Geom2d_BezierCurve
from OCP.gp import gp_Ax2, gp_Ax3, gp_Circ, gp_Dir, gp_Pln, gp_Pnt, gp_Pnt2d, gp_Trsf
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Wire

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.readers.part_geometry import part_geometry
from nurbs_ooc.readers.pcurve_fit import EdgeOnSurface, refitted
from tests.ooc.native_forms import edge_gap, loop_jump, signed_volume


def read(shape: Any) -> GeometryBatch:
    return part_geometry(shape, [0] * 100, "test")


def verdict(batch: GeometryBatch) -> set[tuple[FaceStatus, FaceReason]]:
    return {(FaceStatus(int(s["status"])), FaceReason(int(s["reason"]))) for s in batch.surfaces}


def bare_face(surface: Any) -> Any:
    face = TopoDS_Face()
    BRep_Builder().MakeFace(face, surface, 1e-7)
    return face


def wire_of(edges: list[Any]) -> Any:
    wire = TopoDS_Wire()
    builder = BRep_Builder()
    builder.MakeWire(wire)
    for edge in edges:
        builder.Add(wire, edge)
    return wire


def circle(radius: float, height: float) -> Any:
    return BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(gp_Pnt(0, 0, height), gp_Dir(0, 0, 1)), radius)).Edge()


def reversed_edge(edge: Any) -> Any:
    return TopoDS.Edge(edge.Oriented(TopAbs_Orientation.TopAbs_REVERSED))


def test_face_without_loops_gets_its_natural_boundary() -> None:
    batch = read(bare_face(Geom_SphericalSurface(gp_Ax3(), 3.0)))
    assert verdict(batch) == {(FaceStatus.HEALED, FaceReason.LOOP_MISSING)}
    assert batch.coedges["pole"].sum() == batch.coedges["seam"].sum() == 2
    assert signed_volume(batch) == pytest.approx(36 * np.pi, rel=1e-3)


def test_infinite_face_without_loops_fails() -> None:
    batch = read(bare_face(Geom_CylindricalSurface(gp_Ax3(), 3.0)))
    assert verdict(batch) == {(FaceStatus.FAILED, FaceReason.LOOP_MISSING)}


def test_missing_seam_and_pcurves_are_added() -> None:
    face = bare_face(Geom_CylindricalSurface(gp_Ax3(), 3.0))
    builder = BRep_Builder()
    builder.Add(face, wire_of([circle(3.0, 0.0)]))
    builder.Add(face, wire_of([reversed_edge(circle(3.0, 5.0))]))
    batch = read(face)
    assert {status for status, _ in verdict(batch)} == {FaceStatus.HEALED}
    assert batch.coedges["seam"].sum() == 2
    s = batch.surfaces[0]
    assert (s["v0"], s["v1"]) == pytest.approx((0.0, 5.0))
    assert s["u1"] - s["u0"] == pytest.approx(2 * np.pi)
    assert loop_jump(batch, 0) < 1e-9
    assert edge_gap(batch, 0) <= 1.0


def test_single_loop_around_a_sphere_is_joined_to_the_pole() -> None:
    for turned in (False, True):
        face = bare_face(Geom_SphericalSurface(gp_Ax3(), 3.0))
        equator = circle(3.0, 0.0)
        BRep_Builder().Add(face, wire_of([reversed_edge(equator) if turned else equator]))
        batch = read(face)
        assert {status for status, _ in verdict(batch)} == {FaceStatus.HEALED}
        s = batch.surfaces[0]
        assert (s["v0"], s["v1"]) == pytest.approx((-np.pi / 2, 0) if turned else (0, np.pi / 2))
        assert batch.coedges["pole"].sum() == 1
        assert loop_jump(batch, 0) < 1e-9
        assert edge_gap(batch, 0) <= 1.0
        assert signed_volume(batch) == pytest.approx(18 * np.pi, rel=1e-3)  # of the half ball


def test_loops_around_a_cylinder_that_do_not_pair_up_fail() -> None:
    face = bare_face(Geom_CylindricalSurface(gp_Ax3(), 3.0))
    BRep_Builder().Add(face, wire_of([circle(3.0, 0.0)]))
    assert verdict(read(face)) == {(FaceStatus.FAILED, FaceReason.SEAM_ADDED)}


def test_edges_in_any_order_are_chained() -> None:
    polygon = BRepBuilderAPI_MakePolygon()
    for x, y in [(0, 0), (4, 0), (5, 3), (2, 5), (-1, 2)]:
        polygon.Add(gp_Pnt(x, y, 1))
    polygon.Close()
    explorer, edges = TopExp_Explorer(polygon.Wire(), TopAbs_ShapeEnum.TopAbs_EDGE), []
    while explorer.More():
        edges.append(explorer.Current())
        explorer.Next()
    face = TopoDS_Face()
    BRep_Builder().MakeFace(face, Geom_Plane(gp_Pnt(0, 0, 1), gp_Dir(0, 0, 1)), 1e-7)
    BRep_Builder().Add(face, wire_of([edges[i] for i in (3, 0, 4, 2, 1)]))
    batch = read(face)
    assert verdict(batch) == {(FaceStatus.EXACT, FaceReason.NONE)}
    assert loop_jump(batch, 0) < 1e-9


def test_clockwise_outer_loop_is_turned() -> None:
    polygon = BRepBuilderAPI_MakePolygon(gp_Pnt(0, 0, 0), gp_Pnt(0, 3, 0), gp_Pnt(4, 3, 0), gp_Pnt(4, 0, 0), True)
    face = bare_face(Geom_Plane(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)))
    BRep_Builder().Add(face, polygon.Wire())
    batch = read(face)
    assert verdict(batch) == {(FaceStatus.HEALED, FaceReason.LOOP_REORIENTED)}


def square_with(curve: Any) -> Any:
    """A plane square whose fourth side, from (0, 4) to (0, 0), is given another curve."""
    corners = [gp_Pnt(0, 0, 0), gp_Pnt(4, 0, 0), gp_Pnt(4, 4, 0), gp_Pnt(0, 4, 0)]
    vertices = [BRepBuilderAPI_MakeVertex(p).Vertex() for p in corners]
    edges = [BRepBuilderAPI_MakeEdge(vertices[i], vertices[i + 1]).Edge() for i in range(3)]
    builder = BRep_Builder()
    for vertex in vertices:
        builder.UpdateVertex(vertex, 100.0)
    odd = TopoDS_Edge()
    builder.MakeEdge(odd, curve, 1e-7)
    builder.Add(odd, vertices[3].Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    builder.Add(odd, vertices[0].Oriented(TopAbs_Orientation.TopAbs_REVERSED))
    builder.Range(odd, 0.0, 1.0)
    face = bare_face(Geom_Plane(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)))
    builder.Add(face, wire_of([*edges, odd]))
    return face


def bezier(*points: tuple[float, float, float]) -> Any:
    array = Array1_gp_Pnt(1, len(points))
    for i, point in enumerate(points):
        array.SetValue(i + 1, gp_Pnt(*point))
    return Geom_BezierCurve(array)


def test_curve_far_from_its_vertices_is_replaced_by_a_line() -> None:
    batch = read(square_with(bezier((30, 40, 0), (31, 41, 0), (32, 40, 0))))
    assert verdict(batch) == {(FaceStatus.HEALED, FaceReason.PCURVE_REBUILT)}
    s = batch.surfaces[0]
    assert [s["u0"], s["u1"], s["v0"], s["v1"]] == pytest.approx([0, 4, 0, 4])
    assert loop_jump(batch, 0) < 1e-9


def test_curve_that_misses_one_vertex_is_bridged() -> None:
    batch = read(square_with(bezier((0, 4, 0), (-1, 2, 0), (0, 0.8, 0))))
    assert verdict(batch) == {(FaceStatus.HEALED, FaceReason.LOOP_GAP_CLOSED)}
    assert len(batch.coedges) == 5
    assert loop_jump(batch, 0) < 1e-9
    assert edge_gap(batch, 0) <= 1.0


def test_pcurve_at_another_pace_is_made_anew() -> None:
    cylinder = Geom_CylindricalSurface(gp_Ax3(), 3.0)
    height = 2.0
    slow = Array1_gp_Pnt2d(1, 3)
    for i, u in enumerate((0.0, 0.4, 2.0)):  # a parabola in t: the same line, run through unevenly
        slow.SetValue(i + 1, gp_Pnt2d(u, height))
    edge = BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(gp_Pnt(0, 0, height), gp_Dir(0, 0, 1)), 3.0), 0.0, 2.0).Edge()
    pair = EdgeOnSurface(cylinder, BRep_Tool.Curve_s(edge, 0.0, 0.0), Geom2d_BezierCurve(slow), (0.0, 2.0), (0.0, 1.0))
    assert pair.gap() > 0.5
    form = refitted(pair, 1e-7)
    assert form is not None
    for share in np.linspace(0.0, 1.0, 50):
        np.testing.assert_allclose(form.point(share), [2.0 * share, height], atol=1e-5)


def test_located_and_mirrored_shapes_keep_outward_normals() -> None:
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(1, 2, 3), gp_Dir(1, 1, 0)))
    for make in (
        BRepPrimAPI_MakeBox(2.0, 3.0, 4.0),
        BRepPrimAPI_MakeCylinder(2.0, 5.0),
        BRepPrimAPI_MakeCone(3.0, 1.0, 4.0),
        BRepPrimAPI_MakeTorus(5.0, 2.0),
    ):
        shape = make.Shape()
        volume = signed_volume(read(shape))
        assert volume > 0
        located = read(shape.Moved(TopLoc_Location(mirror), False))
        copied = read(BRepBuilderAPI_Transform(shape, mirror, True).Shape())
        assert signed_volume(located) == pytest.approx(volume, rel=1e-3)
        assert signed_volume(copied) == pytest.approx(volume, rel=1e-3)
        assert all(edge_gap(located, row) <= 1.0 for row in range(len(located)))


def test_scaled_location_inside_a_shape_is_applied() -> None:
    scale = gp_Trsf()
    scale.SetScale(gp_Pnt(0, 0, 0), 2.0)
    batch = read(BRepPrimAPI_MakeCylinder(1.0, 3.0).Shape().Moved(TopLoc_Location(scale), False))
    assert signed_volume(batch) == pytest.approx(np.pi * 24, rel=1e-2)
    assert all(edge_gap(batch, row) <= 1.0 for row in range(len(batch)))


def test_neighbours_share_edges_in_opposite_directions() -> None:
    batch = read(BRepPrimAPI_MakeBox(2.0, 3.0, 4.0).Shape())
    assert (len(batch.edges), len(batch.vertices)) == (12, 8)
    turns: dict[int, list[bool]] = {}
    for s in batch.surfaces:
        loops = batch.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]
        for loop in loops:
            for c in batch.coedges[loop["first_coedge"] : loop["first_coedge"] + loop["n_coedges"]]:
                turns.setdefault(int(c["edge"]), []).append(bool(c["reversed"]) != bool(s["reversed"]))
    assert all(sorted(pair) == [False, True] for pair in turns.values())


def test_sense_of_plane_faces_with_holes() -> None:
    outer = BRepBuilderAPI_MakeWire(circle(5.0, 0.0)).Wire()
    hole = BRepBuilderAPI_MakeWire(reversed_edge(circle(2.0, 0.0))).Wire()
    face = BRepBuilderAPI_MakeFace(gp_Pln(), outer)
    face.Add(TopoDS.Wire(hole))
    batch = read(face.Face())
    assert verdict(batch) == {(FaceStatus.EXACT, FaceReason.NONE)}
    assert batch.surfaces[0]["n_loops"] == 2
    assert BRep_Tool.Surface_s(face.Face()) is not None
