"""Bounds of interpolated attributes against samples of splines that scipy evaluates, and what functions become."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.interpolate import BSpline

from nurbs_cache.jit import kernel
from nurbs_ooc.bounds.attribute_bound import attribute_bound
from nurbs_ooc.bounds.triangle_bound import MEASURES, largest_mean
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.tessellation.attribute_fit import fit

Floats = np.ndarray
NOTHING = np.zeros(0)


@kernel
def _bound(g: Tables, missed: Floats, missed_from: int, uv: Floats, m: Floats) -> tuple[float, float]:
    return attribute_bound(g, 0, missed, missed_from, uv, m)


@kernel
def _largest_mean(p: float, q: float, r: float) -> float:
    return largest_mean(p, q, r)


def bound(form: SurfaceForm, uv: Floats) -> float:
    builder = BatchBuilder()
    builder.surface(form)
    return _bound(tables(builder.build()), NOTHING, -1, uv, np.zeros(MEASURES + 1))[0]


def values(form: SurfaceForm, uv: Floats) -> Floats:
    """By tensor products of scipy's B-splines."""
    points = np.asarray(form.points)
    by_u = BSpline(form.knots_u, points, form.degree_u, axis=0)(uv[:, 0])
    homogeneous = np.array([
        BSpline(form.knots_v, line, form.degree_v, axis=0)(v) for line, v in zip(by_u, uv[:, 1], strict=True)
    ])  # fmt: skip
    return homogeneous[:, :3] / homogeneous[:, 3:] if form.rational else homogeneous


def spline(rng: np.random.Generator, degree: int, times: int, rational: bool = False) -> SurfaceForm:
    """Over 0..1, with inner knots at thirds, each ``times`` times."""
    knots = [0.0] * (degree + 1) + [1 / 3] * times + [2 / 3] * times + [1.0] * (degree + 1)
    n = len(knots) - degree - 1
    weights = rng.uniform(0.7, 1.4, (n, n)) if rational else None
    return SurfaceForm.nurbs(degree, degree, knots, knots, rng.normal(size=(n, n, 3)), weights)


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("degree", "times"), [(1, 1), (2, 1), (2, 2), (3, 1), (3, 3)])
def test_no_sample_exceeds_the_bound(degree: int, times: int, rational: bool) -> None:
    """Smooth splines and ones with kinks, and triangles from large to small."""
    rng = np.random.default_rng(degree * 10 + times)
    weight = np.concatenate([rng.dirichlet((1, 1, 1), 300), [[0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]])
    for _ in range(6):
        form = spline(rng, degree, times, rational)
        for size in (1.0, 0.3, 0.05):
            uv = rng.uniform(0.0, 1.0 - size, 2) + size * rng.random((3, 2))
            off = np.linalg.norm(values(form, weight @ uv) - weight @ values(form, uv), axis=1).max()
            assert off <= bound(form, uv) * (1.0 + 1e-9) + 1e-12


def test_a_kink_costs_what_it_must() -> None:
    """|u - 1/2| over a triangle across it: the exact deviation is x y / (x + y) times the jump of 2."""
    form = SurfaceForm.nurbs(
        1, 1, [0, 0, 0.5, 1, 1], [0, 0, 1, 1], np.array([[[0.5, 0, 0]] * 2, [[0, 0, 0]] * 2, [[0.5, 0, 0]] * 2])
    )
    uv = np.array([[0.2, 0.1], [0.9, 0.1], [0.9, 0.4]])
    assert bound(form, uv) == pytest.approx(2.0 * 0.3 * 0.4 / 0.7, rel=1e-9)


@pytest.mark.parametrize("beyond", [1e-9, 1e-12, 1e-15])
def test_a_hair_beyond_a_knot_changes_nothing(beyond: float) -> None:
    """Second differences over a sliver of a knot span were roundoff over its square."""
    form = spline(np.random.default_rng(5), 3, 1)
    uv = np.array([[0.1, 0.1], [1 / 3, 0.2], [0.2, 1 / 3]])
    reached = uv + np.array([[0, 0], [beyond, 0], [0, beyond]])
    assert bound(form, reached) < 2.0 * bound(form, uv)


@pytest.mark.parametrize("small", [1e-3, 1e-12, 1e-17, 1e-40])
def test_largest_mean_of_nearly_nothing_and_two_alike(small: float) -> None:
    """Exact rational arithmetic; the plain formula loses all digits here, and its sign."""
    p, q, r = Fraction(small), Fraction(1), Fraction(1) + Fraction(small) / 2
    exact = p * q * r / (2 * (p * q + p * r + q * r) - p * p - q * q - r * r)
    for numbers in ((p, q, r), (q, p, r), (r, q, p), (q, r, p)):
        found = _largest_mean(*(float(x) for x in numbers))
        assert found == pytest.approx(float(exact), rel=max(1e-12, small))


def test_a_function_with_a_kink_is_followed() -> None:
    def ask(u: Floats, v: Floats) -> Floats:
        value = np.abs(u - 0.3)[:, None] + np.sin(3.0 * v)[None]
        return np.stack([value, 0 * value, 0 * value], axis=2)

    known, unknown = (fit(ask, kinks, frozenset(), 1e-4) for kinks in (frozenset([0.3]), frozenset()))
    assert known.missed.max() <= 1e-4
    assert len(known.knots_u) < len(unknown.knots_u)
    t = np.linspace(0.01, 0.99, 97)
    for made in (known, unknown):
        form = SurfaceForm.nurbs(3, 3, made.knots_u, made.knots_v, made.net)
        uv = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
        off = np.abs(values(form, uv) - ask(t, t).reshape(-1, 3)).max(axis=1)
        span = (
            np.searchsorted(k, x, side="right") - 4 for k, x in ((made.knots_u, uv[:, 0]), (made.knots_v, uv[:, 1]))
        )
        # Far below the tolerance samples may lie where the error changes its sign.
        assert (off <= np.maximum(made.missed[tuple(span)], 1e-6)).all()


def test_a_function_without_end_is_missed_at_its_border_alone() -> None:
    def ask(u: Floats, v: Floats) -> Floats:
        value = (1.0 / u)[:, None] + 0.0 * v[None]
        return np.stack([value, 0 * value, 0 * value], axis=2)

    made = fit(ask, frozenset(), frozenset(), 0.01)
    spans = made.knots_u[3:-3]
    bad = made.missed.max(axis=1) > 0.01
    assert bad[0]
    assert not bad[spans[:-1] > 0.1].any()
