"""Spheres, cones, tori and solids of them, down to their poles, seams and apexes."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.geometry.sample_faces import add_cone, add_face
from tests.hard.case import HardCase
from tests.hard.loops import TURN, X, Y, Z
from tests.hard.nets import as_nurbs, elevated, with_knots_over

Array = npt.NDArray[np.float64]
ORIGIN = np.zeros(3)
PI = np.pi

LEMON_AREA = TURN * (np.sqrt(3.0) - PI / 3.0)  # spindle torus R = 1/2, r = 1, its inner part
LEMON_VOLUME = 0.7911804


def sphere(u0: float = 0.0, u1: float = TURN, v0: float = -PI / 2, v1: float = PI / 2) -> SurfaceForm:
    """A piece of the unit sphere."""
    return SurfaceForm.framed(SurfaceKind.SPHERE, ORIGIN, X, Y, Z, 1.0, domain=(u0, u1, v0, v1))


def off_sphere(points: Array) -> Array:
    """Distance from the unit sphere."""
    return np.abs(np.linalg.norm(points, axis=1) - 1.0)


def off_torus(points: Array, major: float, minor: float) -> Array:
    """Distance from the whole torus (spindle tori too)."""
    rho = np.hypot(points[:, 0], points[:, 1])
    near = np.abs(np.hypot(rho - major, points[:, 2]) - minor)
    return np.minimum(near, np.abs(np.hypot(rho + major, points[:, 2]) - minor))


def off_cone(points: Array) -> Array:
    """Distance from the infinite double cone of ``add_cone``'s defaults (radius 1, half angle 0.5)."""
    rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    return np.abs((rho - 1.0) * np.cos(0.5) + z * np.sin(0.5))


def lemon() -> SurfaceForm:
    """The inner part of the spindle torus R = 1/2, r = 1: two poles on the axis."""
    return SurfaceForm.framed(SurfaceKind.TORUS, ORIGIN, X, Y, Z, 0.5, 1.0, domain=(0.0, TURN, TURN / 3, 2 * TURN / 3))


def _cone(nurbs: bool, builder: BatchBuilder) -> None:
    if not nurbs:
        add_cone(builder)
        return
    form = SurfaceForm.framed(SurfaceKind.CONE, ORIGIN, X, Y, Z, 1.0, -0.5, domain=(0.0, TURN, 0.0, 1.0 / np.sin(0.5)))
    add_face(builder, as_nurbs(form))


def _octant_without_pole(builder: BatchBuilder) -> None:
    """The octant's loop has three edges; at the pole it jumps in (u, v)."""
    form = sphere(0.0, PI / 2, 0.0, PI / 2)
    builder.surface(form)
    sides = natural_loop(builder, form)
    builder.loop([c for c in sides if not c.pole])


def _disc_cap(builder: BatchBuilder, edge: int, centre: Array, radial: Array, radius: float, flip: bool) -> None:
    """A disc across a tube: its circle C + r (cos v radial + sin v Z) is the edge."""
    form = SurfaceForm.framed(
        SurfaceKind.PLANE, centre, radial, Z, np.cross(radial, Z), domain=(-radius, radius, -radius, radius)
    )
    builder.surface(form, reversed=flip)
    builder.loop([Coedge(edge, CurveForm.ellipse((0.0, 0.0), (radius, 0.0), (0.0, radius)))])


def torus_chain(builder: BatchBuilder, radii: tuple[float, ...], angles: tuple[float, ...], minor: float) -> None:
    """Torus arcs one after the other, joined along shared circles, closed by two discs."""
    at, centre = 0.0, ORIGIN.copy()
    circles, vertices = [], []

    def circle(angle: float, around: Array, major: float) -> None:
        radial = np.array([np.cos(angle), np.sin(angle), 0.0])
        vertices.append(builder.vertex(around + (major + minor) * radial))
        curve = CurveForm.ellipse(around + major * radial, minor * radial, minor * Z)
        circles.append((builder.edge(curve, vertices[-1], vertices[-1]), around + major * radial, radial))

    circle(at, centre, radii[0])
    for i, (major, angle) in enumerate(zip(radii, angles, strict=True)):
        if i:
            centre = centre + (radii[i - 1] - major) * circles[-1][2]
        end = at + angle
        form = SurfaceForm.framed(SurfaceKind.TORUS, centre, X, Y, Z, major, minor, domain=(at, end, 0.0, TURN))
        circle(end, centre, major)
        seam = builder.edge(form.iso_v(0.0), vertices[-2], vertices[-1])
        builder.surface(form)
        bottom, top = CurveForm.line((at, 0.0), (end, 0.0), at, end), CurveForm.line((at, TURN), (end, TURN), at, end)
        left, right = (CurveForm.line((u, 0.0), (u, TURN), 0.0, TURN) for u in (at, end))
        builder.loop(
            [
                Coedge(seam, bottom, seam=True),
                Coedge(circles[-1][0], right),
                Coedge(seam, top, reversed=True, seam=True),
                Coedge(circles[-2][0], left, reversed=True),
            ]
        )
        at = end
    for (edge, middle, radial), flip in ((circles[0], False), (circles[-1], True)):
        _disc_cap(builder, edge, middle, radial, minor, flip)


CHAIN = ((3.0, 1.5, 4.0, 2.0), (0.7, 1.1, 0.4, 0.9), 0.5)
CHAIN_VOLUME = PI * 0.25 * sum(r * a for r, a in zip(CHAIN[0], CHAIN[1], strict=True))


def _face(form: SurfaceForm, builder: BatchBuilder) -> None:
    add_face(builder, form)


def _inside_out(form: SurfaceForm, builder: BatchBuilder) -> None:
    add_face(builder, form, reversed=True)


def closed_surface_cases() -> list[HardCase]:
    """All cases of this module."""
    ball = {"area": 4 * PI, "volume": 4 * PI / 3, "euler": 2, "components": 1, "closed": True, "distance": off_sphere}
    octant = {"area": PI / 2, "euler": 1, "components": 1, "distance": off_sphere}
    window = SurfaceForm.framed(
        SurfaceKind.CYLINDER, ORIGIN, X, Y, Z, domain=(np.radians(350.0), np.radians(370.0), 0.0, 2.0)
    )
    seen = {
        "area": 2 * PI / 9,
        "euler": 1,
        "components": 1,
        "distance": lambda p: np.abs(np.hypot(p[:, 0], p[:, 1]) - 1),
    }
    citrus = {
        "distance": lambda p: off_torus(p, 0.5, 1.0),
        "normals_deg": 75.0,
        "area": LEMON_AREA,
        "volume": LEMON_VOLUME,
        "euler": 2,
        "components": 1,
        "closed": True,
    }
    nurbs_sphere = as_nurbs(sphere())
    cone = {"area": PI / np.sin(0.5), "euler": 1, "components": 1, "distance": off_cone, "normals_deg": 60.0}
    return [
        HardCase("sphere", partial(_face, sphere()), **ball),
        HardCase("rational_sphere", partial(_face, nurbs_sphere), **ball),
        HardCase("sphere_degree_25", partial(_face, elevated(nurbs_sphere, 25)), **ball),
        HardCase("sphere_knots_0_to_1e-12", partial(_face, with_knots_over(nurbs_sphere, 0.0, 1e-12)), **ball),
        HardCase("sphere_knots_1e9_to_1e9+1", partial(_face, with_knots_over(nurbs_sphere, 1e9, 1e9 + 1)), **ball),
        HardCase("cone", partial(_cone, False), **cone),
        HardCase("rational_cone", partial(_cone, True), **cone),
        HardCase("lemon", partial(_inside_out, lemon()), **citrus),
        HardCase("rational_lemon", partial(_inside_out, as_nurbs(lemon())), **citrus),
        HardCase("octant", partial(_face, sphere(0.0, PI / 2, 0.0, PI / 2)), **octant),
        HardCase("rational_octant", partial(_face, as_nurbs(sphere(0.0, PI / 2, 0.0, PI / 2))), **octant),
        HardCase("octant_without_pole_edge", _octant_without_pole, **octant),
        HardCase("window_across_the_seam", partial(_face, window), **seen),
        HardCase("rational_window_across_the_seam", partial(_face, as_nurbs(window)), **seen),
        HardCase(
            "half_torus", lambda b: torus_chain(b, (2.0,), (PI,), 0.5), area=2 * PI * PI + PI / 2,
            volume=PI * PI * 0.5, euler=2, components=1, closed=True,
        ),
        HardCase(
            "chained_torus_arcs", lambda b: torus_chain(b, *CHAIN), volume=CHAIN_VOLUME,
            area=4 * CHAIN_VOLUME + PI / 2, euler=2, components=1, closed=True,
        ),
    ]  # fmt: skip
