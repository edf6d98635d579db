"""Surfaces and shapes made with the kernel, one of every kind, for tests of the readers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.collections import Array1_double, Array1_gp_Pnt, Array1_int, Array2_double, Array2_gp_Pnt
from OCP.Geom import (
    Geom_BezierSurface,
    Geom_BSplineCurve,
    Geom_BSplineSurface,
    Geom_Circle,
    Geom_ConicalSurface,
    Geom_CylindricalSurface,
    Geom_Ellipse,
    Geom_Hyperbola,
    Geom_Line,
    Geom_OffsetSurface,
    Geom_Parabola,
    Geom_Plane,
    Geom_RectangularTrimmedSurface,
    Geom_SphericalSurface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
    Geom_TrimmedCurve,
)
from OCP.gp import gp_Ax1, gp_Ax2, gp_Ax3, gp_Dir, gp_Pnt

Box = tuple[float, float, float, float]


def frame(left_handed: bool = False) -> Any:
    """A tilted coordinate system away from the origin."""
    axes = gp_Ax3(gp_Pnt(3, -2, 5), gp_Dir(1, 2, 3), gp_Dir(2, -1, 0.3))
    if left_handed:
        axes.YReverse()
    return axes


def doubles(values: Any) -> Any:
    """A kernel array from 1."""
    array = Array1_double(1, len(values))
    for i, value in enumerate(values):
        array.SetValue(i + 1, float(value))
    return array


def integers(values: Any) -> Any:
    """A kernel array from 1."""
    array = Array1_int(1, len(values))
    for i, value in enumerate(values):
        array.SetValue(i + 1, int(value))
    return array


def _points(rows: Any) -> Any:
    array = Array1_gp_Pnt(1, len(rows))
    for i, row in enumerate(rows):
        array.SetValue(i + 1, gp_Pnt(*map(float, row)))
    return array


def _grid(rows: Any) -> Any:
    array = Array2_gp_Pnt(1, rows.shape[0], 1, rows.shape[1])
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            array.SetValue(i + 1, j + 1, gp_Pnt(*map(float, rows[i, j])))
    return array


def _weights(rows: Any) -> Any:
    array = Array2_double(1, rows.shape[0], 1, rows.shape[1])
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            array.SetValue(i + 1, j + 1, float(rows[i, j]))
    return array


def net(n_u: int, n_v: int, seed: int = 1) -> Any:
    """A wavy height field as control points."""
    x, y = np.meshgrid(np.linspace(0, 40, n_u), np.linspace(0, 30, n_v), indexing="ij")
    return np.stack([x, y, np.random.default_rng(seed).normal(scale=3.0, size=x.shape)], -1)


def spline_curve(periodic: bool = False) -> Any:
    """A cubic B-spline, closed and periodic if asked."""
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    ring = np.stack([12 + 3 * np.cos(turn), 4 * np.sin(turn), 2 + np.sin(2 * turn)], -1)
    if periodic:
        return Geom_BSplineCurve(_points(ring), doubles(np.linspace(0.5, 4.5, 9)), integers([1] * 9), 3, True)
    return Geom_BSplineCurve(_points(ring), doubles([0, 1, 2.5, 3, 4, 6]), integers([4, 1, 1, 1, 1, 4]), 3, False)


def spline_surface(rational: bool = False, u_periodic: bool = False) -> Any:
    """A B-spline of degrees 3 and 2; periodic in u with a shifted origin if asked."""
    weights = np.random.default_rng(2).uniform(0.4, 2.0, (8, 5)) if rational else np.ones((8, 5))
    if u_periodic:
        turn = np.linspace(0, 2 * np.pi, 9)[:-1]
        rows = [[(r * np.cos(t), r * np.sin(t), 6 * k) for k, r in enumerate([9, 11, 8, 12, 10])] for t in turn]
        knots_u, mults_u = np.linspace(-0.3, 7.7, 9), [1] * 9
        points = np.array(rows)
    else:
        knots_u, mults_u = np.array([0, 1, 2, 2.5, 4, 5.0]), [4, 1, 1, 1, 1, 4]
        points = net(8, 5)
    return Geom_BSplineSurface(
        _grid(points),
        _weights(weights),
        doubles(knots_u),
        doubles([0, 1, 2, 3]),
        integers(mults_u),
        integers([3, 1, 1, 3]),
        3,
        2,
        u_periodic,
        False,
    )


def offset_of(surface: Any, distance: float) -> Any:
    """The kernel's offset surface."""
    return Geom_OffsetSurface(surface, distance)


def _ax2() -> Any:
    return gp_Ax2(gp_Pnt(1, 2, 3), gp_Dir(0, 1, 2), gp_Dir(1, 0, 0))


UPWARDS = gp_Dir(1, 2, 2)
AXIS = gp_Ax1(gp_Pnt(1, 1, 0), gp_Dir(0.2, 0, 1))

SURFACES: dict[str, tuple[Callable[[], Any], Box]] = {
    "plane": (lambda: Geom_Plane(frame()), (-3, 4, -2, 6)),
    "plane, left-handed": (lambda: Geom_Plane(frame(True)), (-3, 4, -2, 6)),
    "cylinder": (lambda: Geom_CylindricalSurface(frame(), 5.0), (0.4, 4.0, -2, 6)),
    "cylinder, left-handed": (lambda: Geom_CylindricalSurface(frame(True), 5.0), (0, 2 * np.pi, -2, 6)),
    "cone": (lambda: Geom_ConicalSurface(frame(), 0.4, 5.0), (0, 2 * np.pi, -2, 6)),
    "cone, narrowing, left-handed": (lambda: Geom_ConicalSurface(frame(True), -0.4, 5.0), (1, 3, -2, 6)),
    "sphere": (lambda: Geom_SphericalSurface(frame(), 5.0), (0, 2 * np.pi, -np.pi / 2, np.pi / 2)),
    "sphere, left-handed": (lambda: Geom_SphericalSurface(frame(True), 5.0), (1, 4, -0.5, 1.2)),
    "torus": (lambda: Geom_ToroidalSurface(frame(), 9.0, 2.5), (0, 2 * np.pi, 0, 2 * np.pi)),
    "torus, left-handed": (lambda: Geom_ToroidalSurface(frame(True), 9.0, 2.5), (0.5, 5.5, 1, 6)),
    "extruded line": (lambda: Geom_SurfaceOfLinearExtrusion(Geom_Line(AXIS), UPWARDS), (-4, 9, 2, 7)),
    "extruded ellipse": (
        lambda: Geom_SurfaceOfLinearExtrusion(Geom_Ellipse(_ax2(), 7.0, 3.0), UPWARDS),
        (0, 2 * np.pi, -4, 5),
    ),
    "extruded hyperbola": (
        lambda: Geom_SurfaceOfLinearExtrusion(Geom_Hyperbola(_ax2(), 3.0, 2.0), UPWARDS),
        (-1.5, 1, -4, 5),
    ),
    "extruded parabola": (
        lambda: Geom_SurfaceOfLinearExtrusion(Geom_Parabola(_ax2(), 3.0), UPWARDS),
        (-5, 7, -4, 5),
    ),
    "extruded B-spline": (lambda: Geom_SurfaceOfLinearExtrusion(spline_curve(), UPWARDS), (0, 6, -4, 5)),
    "extruded periodic B-spline over its origin": (
        lambda: Geom_SurfaceOfLinearExtrusion(spline_curve(True), UPWARDS),
        (3.0, 6.2, -4, 5),
    ),
    "revolved line": (
        lambda: Geom_SurfaceOfRevolution(Geom_Line(gp_Pnt(8, 1, 0), gp_Dir(0.3, 0.5, 1)), AXIS),
        (0.5, 5.5, -4, 5),
    ),
    "revolved ellipse": (
        lambda: Geom_SurfaceOfRevolution(Geom_Ellipse(gp_Ax2(gp_Pnt(9, 0, 0), gp_Dir(0, 1, 0)), 4, 2), AXIS),
        (0, 2 * np.pi, 0, 2 * np.pi),
    ),
    "revolved arc": (
        lambda: Geom_SurfaceOfRevolution(
            Geom_TrimmedCurve(Geom_Circle(gp_Ax2(gp_Pnt(9, 0, 0), gp_Dir(0, 1, 0)), 4), 1.0, 3.0, True), AXIS
        ),
        (0, 2 * np.pi, 1, 3),
    ),
    "revolved B-spline": (lambda: Geom_SurfaceOfRevolution(spline_curve(), AXIS), (0, 2 * np.pi, 0, 6)),
    "Bezier": (lambda: Geom_BezierSurface(_grid(net(4, 6))), (0, 1, 0, 1)),
    "rational Bezier": (
        lambda: Geom_BezierSurface(_grid(net(3, 4)), _weights(np.random.default_rng(3).uniform(0.5, 2, (3, 4)))),
        (0.2, 1, 0, 0.7),
    ),
    "B-spline": (lambda: spline_surface(), (0, 5, 0, 3)),
    "rational B-spline": (lambda: spline_surface(rational=True), (0.3, 4.2, 0.5, 3)),
    "periodic B-spline": (lambda: spline_surface(u_periodic=True), (-0.3, 7.7, 0, 3)),
    "rational periodic B-spline over its origin": (
        lambda: spline_surface(rational=True, u_periodic=True),
        (5.0, 9.5, 0.2, 2.5),
    ),
    "trimmed cylinder": (
        lambda: Geom_RectangularTrimmedSurface(Geom_CylindricalSurface(frame(), 5.0), 1.0, 3.0, -2.0, 6.0),
        (1, 3, -2, 6),
    ),
    "offset plane": (lambda: offset_of(Geom_Plane(frame(True)), 1.5), (-3, 4, -2, 6)),
    "offset cylinder": (lambda: offset_of(Geom_CylindricalSurface(frame(), 5.0), -1.5), (0.4, 4, -2, 6)),
    "offset cylinder, left-handed": (
        lambda: offset_of(Geom_CylindricalSurface(frame(True), 5.0), 1.5),
        (0.4, 4, -2, 6),
    ),
    "offset cone": (lambda: offset_of(Geom_ConicalSurface(frame(), 0.4, 5.0), 1.5), (0.4, 4, -2, 6)),
    "offset cone, left-handed": (lambda: offset_of(Geom_ConicalSurface(frame(True), 0.4, 5.0), 0.5), (0.4, 4, -2, 6)),
    "offset sphere": (lambda: offset_of(Geom_SphericalSurface(frame(), 5.0), 1.5), (0.4, 4, -1, 1)),
    "offset torus": (lambda: offset_of(Geom_ToroidalSurface(frame(), 9.0, 2.5), -1.0), (0.4, 4, 1, 3)),
}


def face_of(surface: Any, box: Box) -> Any:
    """A face over ``box`` with the kernel's natural edges."""
    return BRepBuilderAPI_MakeFace(surface, *map(float, box), 1e-7).Face()
