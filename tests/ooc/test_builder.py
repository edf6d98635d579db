"""The builder's records against closed forms: corners, seams, poles, isoparametric curves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm, bspline_basis
from nurbs_ooc.geometry.sample_faces import (
    add_cone,
    add_cylinder,
    add_patch,
    add_plane,
    add_polygon_trimmed,
    add_sphere,
    add_torus,
)

X, Y, Z = np.eye(3)


def test_basis_agrees_with_scipy() -> None:
    knots = np.array([0, 0, 0, 0, 0.2, 0.5, 0.5, 0.9, 2, 2, 2, 2], float)
    for t in [0.0, 0.1, 0.2, 0.5, 0.7, 1.9, 2.0]:
        expected = BSpline(knots, np.eye(8), 3)(t)
        np.testing.assert_allclose(bspline_basis(knots, 3, t), expected, atol=1e-14)


@pytest.mark.parametrize("kind", [k for k in SurfaceKind if k != SurfaceKind.NURBS])
def test_isoparametric_curves_cross_in_the_point(kind: SurfaceKind) -> None:
    profile = CurveForm.nurbs(2, [0, 0, 0, 1, 1, 1], [[1, 0, 0], [2, 0, 1], [1.5, 0, 3]], [1.0, 0.5, 2.0])
    form = SurfaceForm.framed(kind, [1, 2, 3], X, Y, Z, 2.0, 0.4, profile=profile, domain=(0, 1, 0, 1))
    for u, v in [(0.0, 0.0), (0.3, 0.8), (1.0, 1.0)]:
        np.testing.assert_allclose(form.iso_u(u).point(v), form.iso_v(v).point(u), atol=1e-14)


def test_cylinder_has_one_seam_and_shared_vertices() -> None:
    builder = BatchBuilder(part=5)
    add_cylinder(builder, 2.0, 3.0)
    batch = builder.build()
    assert (len(batch.edges), len(batch.vertices), len(batch.coedges)) == (3, 2, 4)
    assert list(batch.coedges["seam"]) == [0, 1, 0, 1]
    assert batch.edges["id"][2] == (5 << 32) | 2
    np.testing.assert_allclose(batch.vertices, [[2, 0, 0], [2, 0, 3]], atol=1e-15)


def test_sphere_has_two_poles_and_a_seam() -> None:
    builder = BatchBuilder()
    add_sphere(builder, 2.0)
    batch = builder.build()
    assert list(batch.coedges["pole"]) == [1, 0, 1, 0]
    assert list(batch.coedges["seam"]) == [0, 1, 0, 1]
    assert (len(batch.edges), len(batch.vertices)) == (3, 2)
    assert sorted(batch.edges["curve"])[:2] == [-1, -1]
    np.testing.assert_allclose(sorted(batch.vertices[:, 2]), [-2, 2])


def test_torus_has_two_seams_and_one_vertex() -> None:
    builder = BatchBuilder()
    add_torus(builder)
    batch = builder.build()
    assert (len(batch.edges), len(batch.vertices)) == (2, 1)
    assert batch.coedges["seam"].all()


def test_cone_ends_in_a_pole() -> None:
    builder = BatchBuilder()
    add_cone(builder, 2.0, 0.5)
    batch = builder.build()
    assert list(batch.coedges["pole"]) == [0, 0, 1, 0]
    np.testing.assert_allclose(batch.vertices[1], [0, 0, 2 / np.tan(0.5)], atol=1e-14)


def test_patch_edges_are_the_outer_control_rows() -> None:
    points = np.random.default_rng(1).normal(size=(5, 4, 3))
    builder = BatchBuilder()
    add_patch(builder, 3, 2, points)
    batch = builder.build()
    bottom = batch.curves[batch.edges[0]["curve"]]
    row = batch.values[bottom["points"] : bottom["points"] + 15].reshape(5, 3)
    np.testing.assert_allclose(row, points[:, 0], atol=1e-15)
    assert not batch.coedges["seam"].any() and not batch.coedges["pole"].any()


def test_equal_weights_are_polynomial() -> None:
    points = np.random.default_rng(2).normal(size=(3, 3, 3))
    assert not SurfaceForm.nurbs(2, 2, [0, 0, 0, 1, 1, 1], [0, 0, 0, 1, 1, 1], points, np.full((3, 3), 0.7)).rational


def test_polygon_trim_on_a_sphere_stays_on_it() -> None:
    form = SurfaceForm.framed(SurfaceKind.SPHERE, [0, 0, 0], X, Y, Z, 2.0)
    outer = np.array([[0.2, -0.5], [1.5, -0.4], [1.2, 0.6]])
    builder = BatchBuilder()
    add_polygon_trimmed(builder, form, [outer, outer[::-1] * 0.2 + 0.5])
    batch = builder.build()
    assert list(batch.loops["n_coedges"]) == [3, 3]
    np.testing.assert_allclose(np.linalg.norm(batch.vertices, axis=1), 2.0)
    assert 0.0 < batch.edges["tolerance"].max() < 1e-5


def test_hull_of_an_arc_is_tight() -> None:
    low, high = CurveForm.ellipse([1.0, 0.0], [2.0, 0.0], [0.0, 1.0], 0.5, 3.5).hull()
    np.testing.assert_allclose(high, [1 + 2 * np.cos(0.5), 1.0])
    np.testing.assert_allclose(low, [-1.0, np.sin(3.5)])


def test_batch_round_trip_and_empty() -> None:
    builder = BatchBuilder()
    add_plane(builder, 2.0, 3.0)
    batch = builder.build()
    again = GeometryBatch.from_bytes(batch.to_bytes())
    assert again.surfaces.tobytes() == batch.surfaces.tobytes()
    assert batch.surfaces[0]["n_loops"] == 1 and batch.curves[0]["kind"] == CurveKind.NURBS
    assert len(GeometryBatch.from_bytes(BatchBuilder().build().to_bytes())) == 0
