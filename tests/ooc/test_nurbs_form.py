"""The exact NURBS of tagged surfaces against their closed forms, and B-splines against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.nurbs_form import NurbsSurface, nurbs_form, to_nurbs
from nurbs_ooc.geometry.sample_faces import add_cone, add_cylinder, add_patch, add_plane, add_sphere, add_torus
from nurbs_ooc.geometry.surface import evaluate, evaluate_partials


def _batch(add: object, *args: object) -> GeometryBatch:
    builder = BatchBuilder()
    add(builder, *args)  # type: ignore[operator]
    return builder.build()


def _scipy_points(form: NurbsSurface, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Tensor product by scipy's basis, shares nothing with the project."""
    bu = BSpline.design_matrix(u, form.knots_u, form.degree_u).toarray()
    bv = BSpline.design_matrix(v, form.knots_v, form.degree_v).toarray()
    w = np.einsum("ni,nj,ijk->nk", bu, bv, form.points_w)
    return w[:, :3] / w[:, 3:]


@pytest.mark.parametrize("add", [add_plane, add_cylinder, add_cone, add_sphere, add_torus])
def test_tagged_surface_is_its_nurbs(add: object) -> None:
    batch = _batch(add)
    s = batch.surfaces[0]
    form = nurbs_form(batch, 0)
    rng = np.random.default_rng(3)
    uv = np.stack([rng.uniform(s["u0"], s["u1"], 400), rng.uniform(s["v0"], s["v1"], 400)], axis=1)
    expected, _ = evaluate(batch, 0, uv)
    u, v = to_nurbs(form.knots_u, form.map_u, uv[:, 0]), to_nurbs(form.knots_v, form.map_v, uv[:, 1])
    assert np.abs(_scipy_points(form, u, v) - expected).max() < 1e-13 * (1 + np.abs(expected).max())


@pytest.mark.parametrize(("p", "q", "rational"), [(1, 1, False), (3, 3, False), (2, 5, True), (7, 4, True)])
def test_bspline_points_and_partials_agree_with_scipy(p: int, q: int, rational: bool) -> None:
    rng = np.random.default_rng(p * 10 + q)
    points = rng.normal(size=(p + 5, q + 4, 3))
    weights = rng.uniform(0.2, 5.0, points.shape[:2]) if rational else None
    batch = _batch(add_patch, p, q, points, weights)
    s = batch.surfaces[0]
    uv = np.stack([rng.uniform(s["u0"], s["u1"], 200), rng.uniform(s["v0"], s["v1"], 200)], axis=1)
    got, _, partials = evaluate_partials(batch, 0, uv)
    form = nurbs_form(batch, 0)
    assert np.abs(got - _scipy_points(form, uv[:, 0], uv[:, 1])).max() < 1e-12
    step = 1e-6 * (s["u1"] - s["u0"])
    inside = (uv[:, 0] > s["u0"] + 2 * step) & (uv[:, 0] < s["u1"] - 2 * step)
    ahead = _scipy_points(form, uv[inside, 0] + step, uv[inside, 1])
    behind = _scipy_points(form, uv[inside, 0] - step, uv[inside, 1])
    slope = (ahead - behind) / (2 * step)
    assert np.median(np.abs(slope - partials[inside, 0])) < 1e-6 * np.abs(slope).max()
