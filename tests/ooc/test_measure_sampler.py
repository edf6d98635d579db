"""Trimmed regions and the samples drawn from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.measure.exact_surface import points
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.trim_region import TrimRegion
from tests.ooc.measure_shapes import Shape, plate_with_hole, random_nurbs, sphere

TAU = 2 * math.pi


def test_hole_is_outside() -> None:
    region = TrimRegion(plate_with_hole(), [0], 1e-6)
    uv = np.random.default_rng(2).random((5000, 2)) * 12 - 1
    r = np.hypot(*(uv - 5).T)
    want = ((uv > 0) & (uv < 10)).all(1) & (r > 3)
    clear = np.abs(r - 3) > 1e-5
    np.testing.assert_array_equal(region.contains(0, uv)[clear], want[clear])


def test_area_of_samples_is_the_area_of_the_face() -> None:
    g = plate_with_hole()
    region = TrimRegion(g, [0], 1e-5)
    uv = np.random.default_rng(3).random((200_000, 2)) * 10
    assert region.contains(0, uv).mean() * 100 == pytest.approx(100 - 9 * math.pi, rel=5e-3)


@pytest.mark.parametrize("tolerance", [10.0, 1e-2])
def test_inside_is_exact_however_coarse_the_pieces(tolerance: float) -> None:
    region = TrimRegion(plate_with_hole(), [0], tolerance)
    assert len(region.segments) < 100
    angle = np.random.default_rng(4).random(4000) * TAU
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    for step in (1e-1, 1e-6, 1e-11, 1e-14):
        assert not region.contains(0, 5 + (3 - step) * ring).any()
        assert region.contains(0, 5 + (3 + step) * ring).all()


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_rays_along_a_boundary_that_they_touch(degree: int) -> None:
    """v = t^degree: rays at and beside the height of contact, starting on either side of it and on it."""
    net = np.zeros((degree + 1, 2))
    net[:, 0] = np.linspace(0, 1, degree + 1)
    net[-1, 1] = 1.0
    shape = Shape()
    power = shape.curve(net, degree, np.repeat([0.0, 1.0], degree + 1), 2)
    sides = [shape.curve(line, 1, [0, 0, 1, 1], 2) for line in ([[1, 1], [0, 1]], [[0, 1], [0, 0]])]
    shape.loop([power, *sides])
    shape.analytic(SurfaceKind.PLANE, (0, 1, 0, 1))
    region = TrimRegion(shape.batch(), [0], 1e-3)
    u = np.concatenate([[0.0, 1.0], np.random.default_rng(1).random(500)])
    for height in (0.0, 1e-300, 1e-16, 1e-12, 1e-6, 0.1):
        v = np.full(len(u), height)
        clear = (np.abs(u - height ** (1 / degree)) > 1e-3) & (u > 1e-9) & (u < 1.0)
        want = (u**degree < v)[clear]
        np.testing.assert_array_equal(region.contains(0, np.stack([u, v], 1))[clear], want)


def test_boundary_samples_lie_on_the_exact_curves() -> None:
    g = plate_with_hole()
    samples = sample_faces(TrimRegion(g, [0], 1e-2), 400, seed=1)
    uv = samples.uv[samples.on_boundary]
    on_circle = np.abs(np.hypot(*(uv - 5).T) - 3)
    on_side = np.minimum(np.abs(uv), np.abs(uv - 10)).min(1)
    assert np.minimum(on_circle, on_side).max() < 1e-12
    assert (on_circle < 1e-12).any()
    assert (on_side < 1e-12).any()


def test_inner_samples_are_inside_and_everywhere() -> None:
    g = plate_with_hole()
    samples = sample_faces(TrimRegion(g, [0], 1e-7), 2000, seed=1)
    uv = samples.uv[~samples.on_boundary]
    assert (np.hypot(*(uv - 5).T) > 3 - 1e-6).all()
    cells = np.floor(uv / 2.5).astype(int)
    assert len(np.unique(cells, axis=0)) == 16
    np.testing.assert_array_equal(samples.points, points(g, 0, samples.uv))


def test_same_seed_same_samples() -> None:
    region = TrimRegion(plate_with_hole(), [0], 1e-4)
    a, b, c = (sample_faces(region, 100, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.uv, b.uv)
    assert not np.array_equal(a.uv[: len(c)], c.uv[: len(a)])


def test_untrimmed_sphere_is_its_whole_domain() -> None:
    region = TrimRegion(sphere(), [0], 1e-3)
    np.testing.assert_allclose(region.bounds[0], [0, -math.pi / 2, TAU, math.pi / 2])
    samples = sample_faces(region, 3000, seed=4)
    assert np.abs(samples.uv[:, 1]).max() > math.pi / 2 - 1e-3  # the poles are visited
    assert samples.uv[:, 0].min() < 1e-3
    assert samples.uv[:, 0].max() > TAU - 1e-3


def test_a_needle_still_gets_samples() -> None:
    shape = Shape()
    shape.polygon([[0, 0], [10, 10], [10, 10 + 1e-7]])
    shape.analytic(SurfaceKind.PLANE, (0, 10, 0, 11))
    samples = sample_faces(TrimRegion(shape.batch(), [0], 1e-5), 100, seed=0)
    assert samples.on_boundary.sum() >= 25


def test_rounding_in_the_corners_does_not_leak() -> None:
    """Corners that miss one another by 1e-14 along a side of height 1e-18: rays pass exactly through them."""
    low, lower = -7.819796425209045e-18, -7.819796425207224e-18
    lines = [
        ([1.0, 1.28e-14], [1.4, 0.7]),
        ([1.4, 0.7], [-1.4, 0.7]),
        ([-1.4, 0.7], [-1.0, 3.75e-14]),
        ([-1.0, lower], [1.0, low]),
    ]
    shape = Shape()
    shape.loop([shape.curve(list(line), 1, [0, 0, 1, 1], 2) for line in lines])
    shape.analytic(SurfaceKind.PLANE, (-1.4, 1.4, low, 0.7))
    region = TrimRegion(shape.batch(), [0], 1e-5)
    outside = [[-1.4, low], [-1.4, lower], [-1.4, 0.0], [1.4, low], [-1.2, 1e-15]]
    assert not region.contains(0, outside).any()
    assert region.contains(0, [[0.0, 1e-13], [0.0, 0.3]]).all()


def test_a_gap_in_a_loop_is_closed_straight() -> None:
    shape = Shape()
    lines = [([0, 0], [10, 0]), ([10, 0.5], [10, 10]), ([10, 10], [0, 10]), ([0, 10], [0, 0])]
    shape.loop([shape.curve(list(line), 1, [0, 0, 1, 1], 2) for line in lines])
    shape.analytic(SurfaceKind.PLANE, (0, 10, 0, 10))
    region = TrimRegion(shape.batch(), [0], 1e-5)
    np.testing.assert_array_equal(region.contains(0, [[5, 0.2], [9.999, 0.2], [10.5, 0.2], [5, 11]]), [1, 1, 0, 0])


def test_knot_lines_are_visited() -> None:
    g = random_nurbs(np.random.default_rng(1), (3, 3), (9, 9), False)
    samples = sample_faces(TrimRegion(g, [0], 1e-4), 1000, seed=0)
    knots = g.values[int(g.surfaces["knots_u"][0]) + 3 :][:7]
    assert np.isin(samples.uv[:, 0], knots[1:-1]).any()


def test_many_faces_keep_their_own_samples() -> None:
    shape = Shape()
    for i in range(20):
        shape.polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + np.array([3 * i, 0]))
        shape.analytic(SurfaceKind.PLANE, (3 * i, 3 * i + 1, 0, 1))
    samples = sample_faces(TrimRegion(shape.batch(), np.arange(20), 1e-3), 60, seed=5)
    np.testing.assert_array_equal(np.floor((samples.points[:, 0] + 1) / 3).astype(int), samples.face)
    assert (np.bincount(samples.face) >= 30).all()
    assert (np.diff(samples.face) >= 0).all()
