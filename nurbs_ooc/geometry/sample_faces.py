"""Small exact faces for trials and tests: one call, one surface with its loops in the builder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry import interpolation
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import Array, CurveForm, SurfaceForm, Vector
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.geometry.torn import whole_parts

X, Y, Z = np.eye(3)
ORIGIN = (0.0, 0.0, 0.0)
TURN = 2.0 * np.pi


def add_face(builder: BatchBuilder, form: SurfaceForm, *, reversed: bool = False, material: int = 0) -> int:
    """Append ``form`` with its natural boundary; seams and poles are found by themselves.

    A torn surface becomes a face for each of its parts. Returns the row of the first.
    """
    rows = []
    for part in whole_parts(form):
        rows.append(builder.surface(part, reversed=reversed, material=material))
        builder.loop(natural_loop(builder, part))
    return rows[0]


def add_plane(builder: BatchBuilder, width: float = 1.0, height: float = 1.0, origin: Vector = ORIGIN) -> int:
    """Rectangle 0..width x 0..height in the plane z = origin z."""
    form = SurfaceForm.framed(SurfaceKind.PLANE, origin, X, Y, Z, domain=(0.0, width, 0.0, height))
    return add_face(builder, form)


def add_cylinder(builder: BatchBuilder, radius: float = 1.0, height: float = 1.0, origin: Vector = ORIGIN) -> int:
    """Full turn, with a seam at u = 0."""
    domain = (0.0, TURN, 0.0, height)
    return add_face(builder, SurfaceForm.framed(SurfaceKind.CYLINDER, origin, radius * X, radius * Y, Z, domain=domain))


def add_cone(builder: BatchBuilder, radius: float = 1.0, half_angle: float = 0.5, origin: Vector = ORIGIN) -> int:
    """Full turn from radius ``radius`` at v = 0 up to the apex, which is a pole; 0 < half_angle < pi / 2."""
    domain = (0.0, TURN, 0.0, radius / np.sin(half_angle))
    form = SurfaceForm.framed(SurfaceKind.CONE, origin, X, Y, Z, radius, -half_angle, domain=domain)
    return add_face(builder, form)


def add_sphere(builder: BatchBuilder, radius: float = 1.0, origin: Vector = ORIGIN) -> int:
    """Whole sphere: a seam and two poles."""
    domain = (0.0, TURN, -np.pi / 2.0, np.pi / 2.0)
    return add_face(builder, SurfaceForm.framed(SurfaceKind.SPHERE, origin, X, Y, Z, radius, domain=domain))


def add_torus(builder: BatchBuilder, major: float = 2.0, minor: float = 0.5, origin: Vector = ORIGIN) -> int:
    """Whole torus: two seams, one vertex."""
    domain = (0.0, TURN, 0.0, TURN)
    return add_face(builder, SurfaceForm.framed(SurfaceKind.TORUS, origin, X, Y, Z, major, minor, domain=domain))


def add_patch(builder: BatchBuilder, degree_u: int, degree_v: int, points: Array, weights: Array | None = None) -> int:
    """B-spline patch with uniform clamped knots over 0..1 x 0..1; ``points`` (n_u, n_v, 3)."""
    knots_u, knots_v = uniform_knots(points.shape[0], degree_u), uniform_knots(points.shape[1], degree_v)
    return add_face(builder, SurfaceForm.nurbs(degree_u, degree_v, knots_u, knots_v, points, weights))


def uniform_knots(n: int, degree: int) -> Array:
    """(n + degree + 1,) clamped knots over 0..1 with equal spans."""
    inner = np.linspace(0.0, 1.0, n - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def add_polygon_trimmed(builder: BatchBuilder, form: SurfaceForm, polygons: Sequence[Array]) -> int:
    """Append ``form`` trimmed by closed polygons in (u, v), each (n, 2) with n >= 3, not repeated at the end.

    Edges are the images of the polygons' sides: straight lines on a plane, else cubics through 33
    points (good to about 1e-7 of the size for moderate curvature, stated as the edge's tolerance).
    """
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    row = builder.surface(form.over(low[0], high[0], low[1], high[1]))
    for polygon in polygons:
        vertices = [builder.vertex(form.point(*uv)) for uv in polygon]
        coedges = []
        for i, start in enumerate(polygon):
            end = polygon[(i + 1) % len(polygon)]
            curve, tolerance = _image(form, start, end)
            edge = builder.edge(curve, vertices[i], vertices[(i + 1) % len(polygon)], tolerance)
            coedges.append(Coedge(edge, CurveForm.line(start, end)))
        builder.loop(coedges)
    return row


def _image(form: SurfaceForm, start: Array, end: Array) -> tuple[CurveForm, float]:
    """The segment start..end of the parameter plane in space, and how far off it is at most (sampled)."""
    if form.kind == SurfaceKind.PLANE:
        return CurveForm.line(form.point(*start), form.point(*end)), 0.0
    nodes = interpolation.nodes(33)
    curve = interpolation.through(np.array([form.point(*(start + s * (end - start))) for s in nodes]))
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    gap = max(float(np.linalg.norm(curve.point(s) - form.point(*(start + s * (end - start))))) for s in middles)
    return curve, gap
