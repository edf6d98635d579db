"""Profiles with kinks, extruded and turned: creases that no knot of the surface's own record tells of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face
from tests.hard.case import HardCase
from tests.hard.loops import TURN, X, Y, Z

Array = npt.NDArray[np.float64]

TEETH = 4
OUTLINE = np.array([[0.2, 0.1], [3.7, 0.6], [3.1, 3.8], [0.6, 3.3]])  # (u, v), aslant to all creases


def polygon(points: Array) -> CurveForm:
    """The polygon through ``points`` (n, 3) as a spline of degree 1 with knots 0, 1, 2 ..."""
    knots = np.arange(len(points), dtype=np.float64)
    return CurveForm.nurbs(1, np.concatenate([[knots[0]], knots, [knots[-1]]]), points)


def zigzag() -> SurfaceForm:
    """Four flat strips at right angles, x = u, between y = 0 and y = 1, extruded along z."""
    k = np.arange(TEETH + 1.0)
    profile = polygon(np.stack([k, k % 2, 0 * k], axis=1))
    return SurfaceForm.framed(SurfaceKind.EXTRUSION, np.zeros(3), X, Y, Z, profile=profile, domain=(0, TEETH, 0, 4))


def trimmed_zigzag(builder: BatchBuilder) -> None:
    """The zigzag inside ``OUTLINE``, whose sides in space are polygons with a corner on every crease."""
    form = zigzag()
    low, high = OUTLINE.min(axis=0), OUTLINE.max(axis=0)
    builder.surface(form.over(low[0], high[0], low[1], high[1]))
    vertices = [builder.vertex(form.point(*uv)) for uv in OUTLINE]
    coedges = []
    for i, start in enumerate(OUTLINE):
        end = OUTLINE[(i + 1) % len(OUTLINE)]
        crossed = (np.arange(1, TEETH) - start[0]) / (end[0] - start[0])
        t = np.concatenate([[0.0], np.sort(crossed[(crossed > 0) & (crossed < 1)]), [1.0]])
        points = np.array([form.point(*(start + s * (end - start))) for s in t])
        curve = CurveForm.nurbs(1, np.concatenate([[0.0], t, [1.0]]), points)
        edge = builder.edge(curve, vertices[i], vertices[(i + 1) % len(OUTLINE)])
        coedges.append(Coedge(edge, CurveForm.line(start, end)))
    builder.loop(coedges)


def off_zigzag(points: Array) -> Array:
    """Distance from the planes of the nearest strip; never more than from the strips themselves."""
    tooth = 1.0 - np.abs(points[:, 0] % 2 - 1.0)
    return np.asarray(np.abs(points[:, 1] - tooth) / np.sqrt(2.0))


def double_cone(builder: BatchBuilder) -> None:
    """Two cone frusta with radii 1, 2, 1 at heights 0, 1, 2: one surface, its profile has a kink."""
    profile = polygon(np.array([[1.0, 0, 0], [2, 0, 1], [1, 0, 2]]))
    add_face(
        builder,
        SurfaceForm.framed(SurfaceKind.REVOLUTION, np.zeros(3), X, Y, Z, profile=profile, domain=(0, TURN, 0, 2)),
    )


def off_double_cone(points: Array) -> Array:
    """Distance from the nearer frustum's cone."""
    rho = np.hypot(points[:, 0], points[:, 1])
    return np.asarray(np.abs(rho + np.abs(points[:, 2] - 1.0) - 2.0) / np.sqrt(2.0))


def swept_cases() -> list[HardCase]:
    """All cases of this module."""
    following = np.roll(OUTLINE, -1, axis=0)
    inside = 0.5 * float((OUTLINE[:, 0] * following[:, 1] - OUTLINE[:, 1] * following[:, 0]).sum())
    return [
        HardCase(
            "trimmed_zigzag", trimmed_zigzag, area=np.sqrt(2.0) * inside, euler=1, components=1, distance=off_zigzag,
        ),
        HardCase(
            "double_cone", double_cone, area=np.sqrt(2.0) * 3.0 * TURN, euler=0, components=1,
            distance=off_double_cone,
        ),
    ]  # fmt: skip
