"""The bound of a triangle from its deviation at a few points: never below dense samples, and near them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import NdBSpline

from nurbs_cache.jit import kernel
from nurbs_ooc.bounds.derivatives import BOXES, net_bounds
from nurbs_ooc.bounds.sampled_bound import evaluation_error, largest_deviation
from nurbs_ooc.bounds.triangle_bound import MEASURES, norm_bound
from nurbs_ooc.geometry.bezier_net import bezier_net
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables

pytestmark = pytest.mark.kernel

Floats = npt.NDArray[np.float64]


def patch(p: int, q: int, rational: bool, seed: int) -> tuple[Tables, NdBSpline]:
    """A wavy Bézier patch, and its homogeneous points as scipy sees them."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 40, p + 1), np.linspace(0, 30, q + 1), indexing="ij")
    points = np.stack([x, y, 0.0 * x], axis=-1) + rng.normal(size=(p + 1, q + 1, 3)) * [2.0, 2.0, 8.0]
    weights = rng.uniform(0.5, 2.0, (p + 1, q + 1)) if rational else np.ones((p + 1, q + 1))
    builder = BatchBuilder()
    knots = np.repeat([0.0, 1.0], p + 1), np.repeat([0.0, 1.0], q + 1)
    builder.surface(SurfaceForm.nurbs(p, q, *knots, points, weights if rational else None))
    homogeneous = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    return tables(builder.build()), NdBSpline(knots, homogeneous, (p, q))


@kernel
def _bound(g: Tables, t: Floats, dim: int) -> float:
    """The bound of triangle ``t`` (3, 2) from second derivatives over its box."""
    net, boxes = np.empty((MAX_DEGREE + 1) * (MAX_DEGREE + 1) * 4), np.empty(BOXES)
    s = g.surfaces[0]
    u0, u1, v0, v1 = t[:, 0].min(), t[:, 0].max(), t[:, 1].min(), t[:, 1].max()
    bezier_net(g, 0, u0, u1, v0, v1, net)
    bounds, m = np.empty(5), np.empty(MEASURES)
    net_bounds(net, s.degree_u, s.degree_v, dim, u1 - u0, v1 - v0, bounds, boxes)
    m[0], m[1], m[2] = bounds[2], bounds[3], bounds[4]
    return norm_bound(m, t[0, 0], t[0, 1], t[1, 0], t[1, 1], t[2, 0], t[2, 1], 0.0, 0.0)


@kernel
def _deviation(g: Tables, t: Floats, n: int, most: float) -> float:
    return largest_deviation(g, 0, t[0, 0], t[0, 1], t[1, 0], t[1, 1], t[2, 0], t[2, 1], n, most)


@kernel
def _roundoff(g: Tables) -> float:
    return evaluation_error(g, 0)


def measured(surface: NdBSpline, t: Floats, rng: np.random.Generator) -> float:
    """Largest |S - L| of many points of a triangle, by scipy."""

    def at(uv: Floats) -> Floats:
        found = surface(uv)
        return np.asarray(found[:, :3] / found[:, 3:])

    weights = np.concatenate([rng.dirichlet([1.0, 1.0, 1.0], 400), rng.dirichlet([0.3, 0.3, 0.3], 400)])
    return float(np.linalg.norm(at(weights @ t) - weights @ at(t), axis=1).max())


SHAPES = [(1, 1, False), (3, 3, False), (2, 5, False), (2, 2, True), (5, 3, True)]


@pytest.mark.parametrize(("p", "q", "rational"), SHAPES)
def test_it_holds_and_is_closer_than_the_bound(p: int, q: int, rational: bool) -> None:
    g, surface = patch(p, q, rational, 7 * p + q)
    rng = np.random.default_rng(p + q)
    gains = []
    for size in (1.0, 0.3, 0.05):
        for _ in range(12):
            t = rng.uniform(0, 1 - size, 2) + size * rng.uniform(0, 1, (3, 2))
            truth, bound = measured(surface, t, rng), _bound(g, t, 4 if rational else 3)
            assert truth <= bound
            for n in (2, 4):
                sampled = _deviation(g, t, n, math.inf) + bound / n**2 + _roundoff(g)
                assert truth <= sampled
                if n == 4:
                    gains.append(sampled / truth)
    assert np.median(gains) < 1.5


def test_points_of_a_saddle() -> None:
    # z = x y over the unit square: half of it is off by 1/4 in the middle of the diagonal.
    builder = BatchBuilder()
    points = np.array([[[0.0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]])
    builder.surface(SurfaceForm.nurbs(1, 1, np.array([0.0, 0, 1, 1]), np.array([0.0, 0, 1, 1]), points))
    g = tables(builder.build())
    t = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert _deviation(g, t, 2, 1.0) == pytest.approx(0.25)
    assert _deviation(g, t, 3, 1.0) == pytest.approx(2.0 / 9.0)
    assert _deviation(g, t, 2, 0.2) == math.inf
    assert 0.0 < _roundoff(g) < 1e-11


def test_a_parameter_far_from_0_is_charged() -> None:
    # The same saddle with parameters that a float64 resolves to 1e-6 only.
    at = 2.0**32
    builder = BatchBuilder()
    points = np.array([[[0.0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]])
    knots = np.array([at, at, at + 1, at + 1])
    builder.surface(SurfaceForm.nurbs(1, 1, knots, knots, points))
    t = at + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert 0.25 + 2.0**-20 < _deviation(tables(builder.build()), t, 2, 1.0) < 0.25 + 2.0**-15
