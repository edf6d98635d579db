"""The faces of a part as Open CASCADE has them: the same surfaces, edges and p-curves, built record by record.

Native parameters are Open CASCADE's own, so every surface and curve goes over without approximation;
only elliptic cylinders become extrusions of their ellipse, and conics whose axes are oblique or that begin on
their short axis are refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

LEAST_TOLERANCE = 1e-7  # mm, Open CASCADE's own confusion
ROUND = 1e-9  # relative: two radii or ranges that differ by less are equal

Array = npt.NDArray[np.float64]


class FaceNotBuiltError(Exception):
    """Open CASCADE cannot hold this face; the text says why."""


def _pnt(x: Array) -> Any:
    from OCP.gp import gp_Pnt

    return gp_Pnt(*map(float, x))


def _dir(x: Array) -> Any:
    from OCP.gp import gp_Dir

    return gp_Dir(*map(float, x))


def _array(kind: str, values: list[Any]) -> Any:
    import OCP.collections

    array = getattr(OCP.collections, f"Array1_{kind}")(1, len(values))
    for i, value in enumerate(values):
        array.SetValue(i + 1, value)
    return array


def _grid(kind: str, rows: list[list[Any]]) -> Any:
    import OCP.collections

    array = getattr(OCP.collections, f"Array2_{kind}")(1, len(rows), 1, len(rows[0]))
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            array.SetValue(i + 1, j + 1, value)
    return array


def _knots(knots: Array) -> tuple[Any, Any]:
    """Distinct knots and multiplicities."""
    values, counts = np.unique(knots, return_counts=True)
    return _array("double", values.tolist()), _array("int", counts.tolist())


class ShapeBuilder:
    """Builds edges once and faces on them.

    Args:
        geometry: the part.
    """

    def __init__(self, geometry: GeometryBatch) -> None:
        from OCP.BRep import BRep_Builder

        self.geometry = geometry
        self._builder = BRep_Builder()
        self._vertices: dict[int, Any] = {}
        self._edges: dict[int, Any] = {}
        self._tolerance = np.full(len(geometry.vertices), LEAST_TOLERANCE)
        for edge in geometry.edges:
            for name in ("vertex0", "vertex1"):
                at = int(edge[name])
                self._tolerance[at] = max(self._tolerance[at], 2.0 * float(edge["tolerance"]))

    def _curve_rows(self, c: Any) -> Array:
        dim = int(c["dim"])
        n, width = (int(c["n"]), dim + int(c["rational"])) if c["kind"] == CurveKind.NURBS else (3, dim)
        return self.geometry.values[int(c["points"]) : int(c["points"]) + n * width].reshape(n, width)

    def _spline(self, c: Any, flat: bool) -> Any:
        from OCP.Geom import Geom_BSplineCurve
        from OCP.Geom2d import Geom2d_BSplineCurve
        from OCP.gp import gp_Pnt, gp_Pnt2d

        rows, dim, degree = self._curve_rows(c), int(c["dim"]), int(c["degree"])
        w = rows[:, dim] if c["rational"] else np.ones(len(rows))
        points = (rows[:, :dim] / w[:, None]).tolist()
        at = int(c["knots"])
        knots, counts = _knots(self.geometry.values[at : at + len(rows) + degree + 1])
        kind, point, curve = (
            ("gp_Pnt2d", gp_Pnt2d, Geom2d_BSplineCurve) if flat else ("gp_Pnt", gp_Pnt, Geom_BSplineCurve)
        )
        poles = _array(kind, [point(*p) for p in points])
        return curve(poles, _array("double", w.tolist()), knots, counts, degree, False)

    def curve(self, row: int) -> Any:
        """A curve in space."""
        from OCP.Geom import Geom_Circle, Geom_Ellipse, Geom_Hyperbola
        from OCP.gp import gp_Ax2

        c = self.geometry.curves[row]
        if c["kind"] == CurveKind.NURBS:
            return self._spline(c, flat=False)
        centre, a, b = self._curve_rows(c)
        long, short = float(np.linalg.norm(a)), float(np.linalg.norm(b))
        if abs(a @ b) > ROUND * long * short:
            raise FaceNotBuiltError("an oblique conic")
        axes = gp_Ax2(_pnt(centre), _dir(np.cross(a, b)), _dir(a))
        if c["kind"] == CurveKind.HYPERBOLA:
            return Geom_Hyperbola(axes, long, short)
        if abs(long - short) <= ROUND * long:
            return Geom_Circle(axes, long)
        if long < short:
            raise FaceNotBuiltError("an ellipse that begins on its short axis")
        return Geom_Ellipse(axes, long, short)

    def pcurve(self, row: int) -> Any:
        """A curve in (u, v)."""
        from OCP.Geom2d import Geom2d_Circle, Geom2d_Ellipse, Geom2d_Hyperbola
        from OCP.gp import gp_Ax22d, gp_Dir2d, gp_Pnt2d

        c = self.geometry.curves[row]
        if c["kind"] == CurveKind.NURBS:
            return self._spline(c, flat=True)
        centre, a, b = self._curve_rows(c)
        long, short = float(np.linalg.norm(a)), float(np.linalg.norm(b))
        if abs(a @ b) > ROUND * long * short:
            raise FaceNotBuiltError("an oblique conic in (u, v)")
        axes = gp_Ax22d(gp_Pnt2d(*centre), gp_Dir2d(*a), gp_Dir2d(*b))
        if c["kind"] == CurveKind.HYPERBOLA:
            return Geom2d_Hyperbola(axes, long, short)
        if abs(long - short) <= ROUND * long:
            return Geom2d_Circle(axes, long)
        if long < short:
            raise FaceNotBuiltError("an ellipse in (u, v) that begins on its short axis")
        return Geom2d_Ellipse(axes, long, short)

    def surface(self, s: Any) -> Any:
        """An untrimmed surface."""
        from OCP import Geom
        from OCP.gp import gp_Ax1, gp_Ax2, gp_Ax3

        kind = SurfaceKind(int(s["kind"]))
        if kind == SurfaceKind.NURBS:
            return self._nurbs(s)
        frame = self.geometry.values[int(s["frame"]) : int(s["frame"]) + 14]
        o, x, y, z = frame[:12].reshape(4, 3)
        a, b = map(float, frame[12:])
        if kind == SurfaceKind.EXTRUSION:
            return Geom.Geom_SurfaceOfLinearExtrusion(self.curve(int(s["profile"])), _dir(z))
        if kind == SurfaceKind.REVOLUTION:
            return Geom.Geom_SurfaceOfRevolution(self.curve(int(s["profile"])), gp_Ax1(_pnt(o), _dir(z)))
        across = np.cross(x, y)
        axes = gp_Ax3(_pnt(o), _dir(across if kind == SurfaceKind.PLANE else z), _dir(x))
        if kind != SurfaceKind.PLANE and across @ z < 0.0:
            axes.YReverse()
        if kind == SurfaceKind.CYLINDER:
            long, short = float(np.linalg.norm(x)), float(np.linalg.norm(y))
            if abs(long - short) > ROUND * long:
                ellipse = Geom.Geom_Ellipse(gp_Ax2(_pnt(o), _dir(across), _dir(x)), long, short)
                return Geom.Geom_SurfaceOfLinearExtrusion(ellipse, _dir(z))
            return Geom.Geom_CylindricalSurface(axes, long)
        if kind == SurfaceKind.CONE:
            return Geom.Geom_ConicalSurface(axes, b, a)
        if kind == SurfaceKind.SPHERE:
            return Geom.Geom_SphericalSurface(axes, a)
        return Geom.Geom_Plane(axes) if kind == SurfaceKind.PLANE else Geom.Geom_ToroidalSurface(axes, a, b)

    def _nurbs(self, s: Any) -> Any:
        from OCP.Geom import Geom_BSplineSurface
        from OCP.gp import gp_Pnt

        n_u, n_v, width = int(s["n_u"]), int(s["n_v"]), 3 + int(s["rational"])
        at = int(s["points"])
        net = self.geometry.values[at : at + n_u * n_v * width].reshape(n_u, n_v, width)
        w = net[..., 3] if s["rational"] else np.ones((n_u, n_v))
        points = (net[..., :3] / w[..., None]).tolist()
        p, q = int(s["degree_u"]), int(s["degree_v"])
        along = [
            _knots(self.geometry.values[int(s[k]) : int(s[k]) + n + d + 1])
            for k, n, d in (("knots_u", n_u, p), ("knots_v", n_v, q))
        ]
        (knots_u, counts_u), (knots_v, counts_v) = along
        poles = _grid("gp_Pnt", [[gp_Pnt(*x) for x in row] for row in points])
        return Geom_BSplineSurface(
            poles, _grid("double", w.tolist()), knots_u, knots_v, counts_u, counts_v, p, q, False, False
        )

    def _vertex(self, row: int) -> Any:
        from OCP.TopoDS import TopoDS_Vertex

        if row not in self._vertices:
            vertex = TopoDS_Vertex()
            self._builder.MakeVertex(vertex, _pnt(self.geometry.vertices[row]), float(self._tolerance[row]))
            self._vertices[row] = vertex
        return self._vertices[row]

    def _edge(self, row: int) -> Any:
        from OCP.TopAbs import TopAbs_Orientation
        from OCP.TopoDS import TopoDS_Edge

        if row in self._edges:
            return self._edges[row]
        record, edge = self.geometry.edges[row], TopoDS_Edge()
        if record["curve"] < 0:
            self._builder.MakeEdge(edge)
            self._builder.Degenerated(edge, True)
        else:
            tolerance = max(float(record["tolerance"]), LEAST_TOLERANCE)
            self._builder.MakeEdge(edge, self.curve(int(record["curve"])), tolerance)
        forward, backward = TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED
        self._builder.Add(edge, self._vertex(int(record["vertex0"])).Oriented(forward))
        self._builder.Add(edge, self._vertex(int(record["vertex1"])).Oriented(backward))
        if record["curve"] >= 0:
            self._builder.Range(edge, float(record["t0"]), float(record["t1"]))
        self._edges[row] = edge
        return edge

    def face(self, row: int) -> Any:
        """The trimmed face in ``row``.

        Raises:
            FaceNotBuiltError: Open CASCADE refuses a curve or the surface.
        """
        try:
            return self._face(self.geometry.surfaces[row])
        except FaceNotBuiltError:
            raise
        except Exception as error:
            raise FaceNotBuiltError(f"{type(error).__name__}: {error}") from error

    def _face(self, s: Any) -> Any:
        from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
        from OCP.TopAbs import TopAbs_Orientation
        from OCP.TopLoc import TopLoc_Location
        from OCP.TopoDS import TopoDS_Face, TopoDS_Wire

        forward, backward = TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED
        surface = self.surface(s)
        if s["n_loops"] == 0:
            box = [float(s[k]) for k in ("u0", "u1", "v0", "v1")]
            face = BRepBuilderAPI_MakeFace(surface, *box, LEAST_TOLERANCE).Face()
        else:
            face = TopoDS_Face()
            self._builder.MakeFace(face, surface, TopLoc_Location(), max(float(s["tolerance"]), LEAST_TOLERANCE))
            self._put_pcurves(s, face)
            for loop in self.geometry.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]:
                wire = TopoDS_Wire()
                self._builder.MakeWire(wire)
                for coedge in self.geometry.coedges[loop["first_coedge"] :][: loop["n_coedges"]]:
                    edge = self._edge(int(coedge["edge"]))
                    self._builder.Add(wire, edge.Oriented(backward if coedge["reversed"] else forward))
                wire.Closed(True)
                self._builder.Add(face, wire)
        if s["reversed"]:
            face.Orientation(backward)
        return face

    def _put_pcurves(self, s: Any, face: Any) -> None:
        """Tell the edges their curves on the face; an edge used twice gets both at once."""
        from OCP.BRepLib import BRepLib

        loops = self.geometry.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]
        uses: dict[int, list[Any]] = {}
        for loop in loops:
            for coedge in self.geometry.coedges[loop["first_coedge"] :][: loop["n_coedges"]]:
                uses.setdefault(int(coedge["edge"]), []).append(coedge)
        for row, coedges in uses.items():
            edge, record = self._edge(row), self.geometry.edges[row]
            tolerance = max(float(record["tolerance"]), LEAST_TOLERANCE)
            coedges.sort(key=lambda c: int(c["reversed"]))
            curves = [self.pcurve(int(c["pcurve"])) for c in coedges[:2]]
            if len(curves) == 2:
                self._builder.UpdateEdge(edge, curves[0], curves[1], face, tolerance)
            else:
                self._builder.UpdateEdge(edge, curves[0], face, tolerance)
            c = self.geometry.curves[int(coedges[0]["pcurve"])]
            if record["curve"] < 0:
                self._builder.Range(edge, face, float(c["t0"]), float(c["t1"]))
                continue
            span = abs(float(record["t1"] - record["t0"]))
            if max(abs(float(c[k] - record[k])) for k in ("t0", "t1")) > ROUND * span:
                self._builder.Range(edge, face, float(c["t0"]), float(c["t1"]))
                self._builder.SameRange(edge, False)
                self._builder.SameParameter(edge, False)
                BRepLib.SameParameter_s(edge, tolerance)
