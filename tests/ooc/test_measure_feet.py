"""Feet and the proof that there are none, against closed forms and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face
from nurbs_ooc.measure.certify_far import FarProof
from nurbs_ooc.measure.face_cells import face_cells
from nurbs_ooc.measure.foot_point import FootFinder
from nurbs_ooc.measure.trim_region import TrimRegion
from tests.ooc.measure_shapes import Shape, plate_with_hole, random_nurbs, sphere

TAU = 2 * math.pi


def _nearest(region: TrimRegion, p: np.ndarray) -> np.ndarray:
    """Distances to face 0; each foot must lie on it."""
    finder = FootFinder(region)
    face, uv, distance = finder.nearest(p, np.arange(len(p) + 1), np.zeros(len(p), np.int64))
    np.testing.assert_allclose(np.linalg.norm(region.placed.points(face, uv) - p, axis=1), distance, rtol=1e-9)
    return distance


def _around(rng: np.random.Generator, n: int) -> np.ndarray:
    p = rng.normal(size=(n, 3))
    return p / np.linalg.norm(p, axis=1)[:, None]


def test_sphere_and_torus() -> None:
    rng = np.random.default_rng(1)
    height = rng.uniform(-0.5, 0.5, 2000)
    p = _around(rng, 2000) * (10.0 + height)[:, None]
    np.testing.assert_allclose(_nearest(TrimRegion(sphere(10.0), [0], 1e-6), p), np.abs(height), rtol=1e-6, atol=1e-9)
    shape = Shape()
    shape.analytic(SurfaceKind.TORUS, (0, TAU, 0, TAU), a=10.0, b=3.0, u_period=TAU, v_period=TAU)
    u, v = rng.random((2, 2000)) * TAU
    r = 10.0 + (3.0 + height) * np.cos(v)
    p = np.stack([r * np.cos(u), r * np.sin(u), (3.0 + height) * np.sin(v)], 1)
    np.testing.assert_allclose(_nearest(TrimRegion(shape.batch(), [0], 1e-6), p), np.abs(height), rtol=1e-6, atol=1e-9)


def test_a_search_finds_what_two_tries_miss() -> None:
    """Far from a sphere, beside its seam, the first foot can end at the seam."""
    finder = FootFinder(TrimRegion(sphere(10.0), [0], 1e-6))
    for p in _around(np.random.default_rng(1), 200) * 14.0:
        assert finder.search(p, 0, 5.0)[0] == pytest.approx(4.0, rel=1e-9)


def test_a_hole_and_a_placement() -> None:
    rng = np.random.default_rng(2)
    p = rng.uniform(-3, 13, (3000, 3)) * [1, 1, 0.3]
    flat = np.maximum(np.abs(p[:, :2] - 5) - 5, 0)
    r = np.hypot(*(p[:, :2] - 5).T)
    aside = np.where(r < 3, 3 - r, np.hypot(*flat.T))
    want = np.hypot(aside, p[:, 2])
    np.testing.assert_allclose(_nearest(TrimRegion(plate_with_hole(), [0], 1e-6), p), want, rtol=1e-6, atol=1e-9)
    turned = np.array([[0.0, -2, 0, 7], [2, 0, 0, -1], [0, 0, -2, 3]])
    moved = p @ turned[:, :3].T + turned[:, 3]
    region = TrimRegion(plate_with_hole(), [0], 1e-6, turned[None])
    np.testing.assert_allclose(_nearest(region, moved), 2 * want, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("rational", [False, True])
def test_splines_by_brute_force(rational: bool) -> None:
    g = random_nurbs(np.random.default_rng(5), (3, 2), (9, 7), rational)
    region = TrimRegion(g, [0], 1e-6)
    u, v = np.meshgrid(np.linspace(0, 1, 500), np.linspace(0, 1, 500))
    dense = region.placed.points(0, np.stack([u.ravel(), v.ravel()], 1))
    rng = np.random.default_rng(6)
    p = dense[rng.integers(0, len(dense), 300)] + rng.normal(size=(300, 3)) * 0.3
    brute = np.array([np.linalg.norm(dense - q, axis=1).min() for q in p])
    distance = _nearest(region, p)
    searched = np.array([FootFinder(region).search(q, 0, 2.0)[0] for q in p[:50]])
    assert (distance < brute * 1.05 + 1e-3).mean() > 0.98  # two tries can end in a neighbouring valley
    assert (searched <= brute[:50] * (1 + 1e-9)).all()
    assert (searched <= distance[:50] * (1 + 1e-9)).all()


def test_candidates_compete() -> None:
    shape = Shape()
    for x in (0, 5):
        shape.polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + np.array([x, 0]))
        shape.analytic(SurfaceKind.PLANE, (x, x + 1, 0, 1))
    finder = FootFinder(TrimRegion(shape.batch(), [0, 1], 1e-6))
    p = np.array([[4.8, 0.5, 0.0], [4.8, 0.5, 0.0], [4.8, 0.5, 0.0]])
    face, _, distance = finder.nearest(p, np.array([0, 2, 3, 3]), np.array([0, 1, 0]))
    assert face.tolist() == [1, 0, -1]
    np.testing.assert_allclose(distance, [0.2, 3.8, np.inf])


def test_cells_cover_what_is_inside_and_little_else() -> None:
    region = TrimRegion(plate_with_hole(), [0], 1e-6)
    assert np.diff(face_cells(region).cell_start) == [1]  # a plane needs no more
    g = sphere(10.0)
    cells = face_cells(TrimRegion(g, [0], 1e-6))
    assert cells.leave.max() < 0.35
    centre = cells.positions[cells.triangles].mean(1)
    assert (10.0 - np.linalg.norm(centre, axis=1) <= np.repeat(cells.leave, 2) + 1e-9).all()


@pytest.mark.parametrize("gap", [3e-3, 1e-1, 1.0])
def test_what_is_far_is_proven_and_what_is_near_never(gap: float) -> None:
    region = TrimRegion(plate_with_hole(), [0], 1e-6)
    finder, far = FootFinder(region), FarProof(region)
    inside_hole = np.array([8.0 - 0.5, 5.0, 0.0])  # half a millimetre from the rim
    above = np.array([1.0, 1.0, 0.5])
    for p in (inside_hole, above):
        _, to_boundary = finder.search(p, 0, 1.0)
        assert far.nowhere_near(0, p, 0.5 / (1 + gap), to_boundary)
        assert not far.nowhere_near(0, p, 0.5 * (1 + 1e-6), to_boundary)


def test_a_strip_between_close_knots_is_not_overlooked() -> None:
    # A wall of 8 mm within 1e-6 of the parameters: points on it are near the face.
    step = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 8], [8, 0, 8.0]])
    net = np.stack([step, step + np.array([0, 1.0, 0])], axis=1)
    builder = BatchBuilder()
    knots = np.array([0, 0, 0.3, 0.300001, 1, 1.0])
    add_face(builder, SurfaceForm.nurbs(1, 1, knots, np.array([0, 0, 1, 1.0]), net))
    far = FarProof(TrimRegion(builder.build(), [0], 1e-6))
    for height in (2.0, 4.0, 7.0):
        assert not far.nowhere_near(0, np.array([4.0, 0.5, height]), 0.1, 0.5)
    assert far.nowhere_near(0, np.array([5.0, 0.5, 4.0]), 0.5, 1.0)
