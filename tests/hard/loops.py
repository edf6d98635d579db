"""Loops by hand: polygons and circles in the plane, edges shared between faces, gaps on purpose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm

Array = npt.NDArray[np.float64]

X, Y, Z = np.eye(3)
TURN = 2.0 * np.pi


def plane(low: Sequence[float], high: Sequence[float], z: float = 0.0) -> SurfaceForm:
    """The plane z = ``z`` over a box in x and y."""
    domain = (low[0], high[0], low[1], high[1])
    return SurfaceForm.framed(SurfaceKind.PLANE, (0.0, 0.0, z), X, Y, Z, domain=domain)


def circle_loop(builder: BatchBuilder, centre: Sequence[float], radius: float, ccw: bool = True) -> int:
    """A full circle in a plane z = 0 whose parameters are x and y: one edge, one vertex."""
    cx, cy = centre
    a, b = (radius, 0.0), (0.0, radius)
    curve = CurveForm.ellipse((cx, cy, 0.0), (*a, 0.0), (*b, 0.0))
    vertex = builder.vertex((cx + radius, cy, 0.0))
    edge = builder.edge(curve, vertex, vertex)
    return builder.loop([Coedge(edge, CurveForm.ellipse(centre, a, b), reversed=not ccw)])


def shrunk_polygon_loop(builder: BatchBuilder, form: SurfaceForm, polygon: Array, gap: float) -> int:
    """A polygon whose sides all end ``gap`` before its corners, in (u, v) and in space."""
    vertices = [builder.vertex(form.point(*uv)) for uv in polygon]
    coedges = []
    for i, start in enumerate(polygon):
        end = polygon[(i + 1) % len(polygon)]
        step = gap * (end - start) / np.linalg.norm(end - start)
        a, b = start + step, end - step
        edge = builder.edge(CurveForm.line(form.point(*a), form.point(*b)), vertices[i], vertices[(i + 1) % 4], gap)
        coedges.append(Coedge(edge, CurveForm.line(a, b)))
    return builder.loop(coedges)


def hermite_edge(
    builder: BatchBuilder, nodes: Array, points: Array, first: Array, second: Array
) -> tuple[int, CurveForm]:
    """An edge through ``points`` (n, 3) with given first and second derivatives at parameters ``nodes``.

    Quintic Bézier pieces. Source: G. Farin, "Curves and Surfaces for CAGD", 5th ed. 2002, section 7.6.
    """
    rows = [points[:1]]
    for i in range(len(nodes) - 1):
        h = nodes[i + 1] - nodes[i]
        p0, p1, d0, d1, s0, s1 = points[i], points[i + 1], first[i], first[i + 1], second[i], second[i + 1]
        rows.append(
            np.stack(
                [
                    p0 + h * d0 / 5, p0 + 2 * h * d0 / 5 + h * h * s0 / 20, p1 - 2 * h * d1 / 5 + h * h * s1 / 20,
                    p1 - h * d1 / 5, p1,
                ]
            )
        )  # fmt: skip
    knots = np.concatenate([[nodes[0]], np.repeat(nodes, 5), [nodes[-1]]])
    curve = CurveForm.nurbs(5, knots, np.concatenate(rows))
    edge = builder.edge(curve, builder.vertex(points[0]), builder.vertex(points[-1]))
    return edge, curve
