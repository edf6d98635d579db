"""Surfaces taken from several parts are the same surfaces."""

from __future__ import annotations

import math

import numpy as np

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.measure.exact_surface import points
from nurbs_ooc.measure.gathered import gathered
from nurbs_ooc.measure.trim_region import TrimRegion
from tests.ooc.measure_shapes import Shape, random_nurbs, sphere


def _mixed() -> GeometryBatch:
    """Every way to point into the tables: frames, profiles, splines, holes."""
    shape = Shape()
    shape.polygon([[0, 0], [9, 0], [9, 8], [0, 8]])
    shape.loop([shape.conic(CurveKind.ELLIPSE, [5, 4], [3, 0], [0, 2], 0.0, 2 * math.pi)])
    shape.analytic(SurfaceKind.PLANE, (0, 9, 0, 8))
    profile = shape.curve([[1, 0, 0], [2, 0, 1], [1, 0, 3]], 2, [0, 0, 0, 1, 1, 1], 3)
    shape.polygon([[0.1, 0.1], [3, 0.2], [2, 0.9]])
    shape.analytic(SurfaceKind.REVOLUTION, (0, 6, 0, 1), profile=profile)
    shape.analytic(SurfaceKind.EXTRUSION, (0, 1, 0, 2), profile=profile)
    shape.polygon([[0, 0], [1, 0], [1, 2]])
    shape.analytic(SurfaceKind.CYLINDER, (0, 1, 0, 2))
    return shape.batch()


def test_points_and_loops_are_those_of_the_parts() -> None:
    rng = np.random.default_rng(8)
    parts = {
        0: _mixed(),
        3: random_nurbs(rng, (3, 2), (6, 5), rational=True),
        4: sphere(2.0),
        7: random_nurbs(rng, (2, 2), (4, 4), rational=False),
    }
    part, row = np.array([3, 0, 7, 0, 0, 4, 0, 0, 3]), np.array([0, 2, 0, 0, 1, 0, 3, 0, 0])
    together = gathered(parts, part, row)
    region = TrimRegion(together, np.arange(len(part)), 1e-4)
    for i, (p, r) in enumerate(zip(part.tolist(), row.tolist(), strict=True)):
        alone = TrimRegion(parts[p], [r], 1e-4)
        np.testing.assert_array_equal(region.bounds[i], alone.bounds[0])
        low, high = alone.bounds[0, :2], alone.bounds[0, 2:]
        uv = low + rng.random((500, 2)) * (high - low)
        np.testing.assert_array_equal(points(together, i, uv), points(parts[p], r, uv))
        np.testing.assert_array_equal(region.contains(i, uv), alone.contains(0, uv))


def test_nothing() -> None:
    none = np.zeros(0, np.int64)
    assert len(gathered({}, none, none)) == 0
