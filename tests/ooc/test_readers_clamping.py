"""Knot changes keep every point at its parameter; scipy is the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from nurbs_ooc.readers.clamping import clamp, cut, extend, insert_knot, unroll, used_spans

KNOTS = np.array([0, 0, 0, 0, 0.4, 1.0, 1.0, 1.7, 2.5, 2.5, 2.5, 2.5])
POINTS = np.random.default_rng(0).normal(size=(8, 3))


def at(knots: np.ndarray, points: np.ndarray, t: np.ndarray, degree: int = 3) -> np.ndarray:
    return np.asarray(BSpline(knots, points, degree)(t))


@pytest.mark.parametrize("t", [0.2, 0.4, 1.0, 2.3])
def test_inserted_knot_keeps_the_curve(t: float) -> None:
    knots, points = insert_knot(KNOTS, 3, POINTS, t)
    assert len(knots) == len(points) + 4
    s = np.linspace(0, 2.499, 50)
    np.testing.assert_allclose(at(knots, points, s), at(KNOTS, POINTS, s), atol=1e-13)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.4, 1.7), (0.1, 2.2), (1.0, 2.5), (0.0, 2.5)])
def test_cut_is_clamped_and_the_same(low: float, high: float) -> None:
    knots, points = cut(KNOTS, 3, POINTS, low, high)
    assert (knots[:4] == low).all()
    assert (knots[-4:] == high).all()
    assert len(knots) == len(points) + 4
    s = np.linspace(low, high, 50)[:-1]
    np.testing.assert_allclose(at(knots, points, s), at(KNOTS, POINTS, s), atol=1e-13)


def test_unclamped_ends_are_clamped() -> None:
    knots = np.arange(12.0)
    new_knots, points = clamp(knots, 3, POINTS)
    s = np.linspace(3, 7.999, 60)
    np.testing.assert_allclose(at(new_knots, points, s), at(knots, POINTS, s), atol=1e-13)
    assert new_knots[0] == new_knots[3] == 3.0
    assert new_knots[-1] == new_knots[-4] == 8.0


@pytest.mark.parametrize(("low", "high"), [(2.0, 3.5), (-1.0, 0.5), (-3.0, 6.0), (2.6, 4.9)])
def test_closed_curve_goes_on_over_its_origin(low: float, high: float) -> None:
    ring = np.concatenate([POINTS[:-1], POINTS[:1]])
    knots, points = unroll(KNOTS, 3, ring, low, high)
    assert knots[0] <= low
    assert knots[-1] >= high
    s = np.linspace(low, high, 80)[1:-1]
    np.testing.assert_allclose(at(knots, points, s), at(KNOTS, ring, np.mod(s, 2.5)), atol=1e-12)


@pytest.mark.parametrize(("low", "high"), [(-0.2, 2.5), (0.0, 2.8), (-0.3, 2.9)])
def test_extended_curve_follows_its_end_polynomials(low: float, high: float) -> None:
    knots, points = extend(KNOTS, 3, POINTS, low, high)
    assert (knots[0], knots[-1]) == (low, high)
    s = np.linspace(low, high, 70)[:-1]
    np.testing.assert_allclose(at(knots, points, s), BSpline(KNOTS, POINTS, 3, extrapolate=True)(s), atol=1e-11)


def test_used_spans_reach_to_the_next_knots() -> None:
    knots, _ = used_spans(KNOTS, 3, POINTS, 0.5, 1.2)
    assert (knots[0], knots[-1]) == (0.4, 1.7)


def test_rows_of_a_net_are_points_too() -> None:
    net = np.random.default_rng(1).normal(size=(8, 5, 4))
    _, rows = cut(KNOTS, 3, net, 0.3, 2.0)
    _, single = cut(KNOTS, 3, net[:, 2], 0.3, 2.0)
    np.testing.assert_allclose(rows[:, 2], single)
