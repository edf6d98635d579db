"""Round tubes, hoses and cables along a smooth course: a nine-point circle carried along a spline, capped.

The control net carries a circle at every control point of the course, so the tube is exact as a NURBS
and its ends are circles; between them it is as round as the course is straight.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.outline import CIRCLE_KNOTS, CIRCLE_POINTS, CIRCLE_WEIGHTS, LINE_KNOTS
from nurbs_ooc.synth.solid import four_sides
from nurbs_ooc.synth.spline import clamped_knots

Array = npt.NDArray[np.float64]


def frames(course: Array) -> tuple[Array, Array]:
    """Two unit vectors (n, 3) across a course (n, 3), turned as little as possible from point to point."""
    along = np.gradient(course, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.empty_like(along)
    first = np.eye(3)[np.argmin(np.abs(along[0]))]
    for i, direction in enumerate(along):
        side = first - (first @ direction) * direction
        across[i] = first = side / np.linalg.norm(side)
    return across, np.cross(along, across)


def add_tube(builder: BulkBuilder, course: Array, radius: float, degree: int = 3, material: int = 0) -> None:
    """A closed tube: 3 surfaces, 9 n + 8 control points.

    Args:
        course: (n, 3) control points of its middle, mm; n > degree.
        radius: mm, at every control point.
    """
    n = len(course)
    x, y = frames(course)
    flat = radius * CIRCLE_POINTS
    net = course[None] + flat[:, :1, None] * x[None] + flat[:, 1:, None] * y[None]
    rows = np.concatenate([net * CIRCLE_WEIGHTS[:, None, None], np.tile(CIRCLE_WEIGHTS[:, None, None], (1, n, 1))], 2)
    knots = clamped_knots(n, degree)
    side = builder.surfaces((2, degree), (CIRCLE_KNOTS, knots), rows[None], rational=True, material=material)
    vertices = builder.vertices(net[0, [0, -1]])
    circles = builder.curves(2, CIRCLE_KNOTS, rows[:, [0, -1]].transpose(1, 0, 2), rational=True)
    edges = builder.edges(circles, vertices, vertices)
    seam = builder.edges(builder.curves(degree, knots, net[:1]), vertices[:1], vertices[1:])
    four_sides(builder, side, edges[:1], seam, edges[1:], seam, seam=True)
    reach = 1.1 * radius
    for end, outward in ((0, False), (-1, True)):
        corners = np.array([[course[end] + reach * (i * x[end] + j * y[end]) for j in (-1, 1)] for i in (-1, 1)])
        cap = builder.surfaces((1, 1), (LINE_KNOTS, LINE_KNOTS), corners[None], reversed=not outward, material=material)
        uv = 0.5 + 0.5 * flat / reach
        pcurve = builder.curves(
            2, CIRCLE_KNOTS, np.concatenate([uv * CIRCLE_WEIGHTS[:, None], CIRCLE_WEIGHTS[:, None]], 1)[None],
            rational=True,
        )  # fmt: skip
        builder.coedges(cap, 0, 0, edges[[end]], pcurve)


def tube_counts(n: int) -> tuple[int, int]:
    """Surfaces and control points of ``add_tube`` with ``n`` points of its course."""
    return 3, 9 * n + 8
