"""Weights over eight decades: bounds on any box, line or interval hold, and shrink to what the surface does there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.bounds.creases import JUMP
from nurbs_ooc.bounds.curve_bounds import D1, D2, SIZE, curve_bounds
from nurbs_ooc.bounds.piece_boxes import box_bounds
from nurbs_ooc.bounds.pieces import BREAK_U, Pieces
from nurbs_ooc.bounds.strips import surface_pieces
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face, uniform_knots
from nurbs_ooc.geometry.tables import Tables, tables
from tests.ooc.exact_rational import surface_derivatives

pytestmark = pytest.mark.kernel

Floats = npt.NDArray[np.float64]


@kernel
def _box(g: Tables, p: Pieces, u0: float, u1: float, v0: float, v1: float) -> Floats:
    out = np.empty(5)
    box_bounds(g, p, 0, u0, u1, v0, v1, out)
    return out


@kernel
def _interval(g: Tables, row: int, a: float, b: float) -> Floats:
    out = np.empty(SIZE)
    curve_bounds(g, row, a, b, out)
    return out


def wild_surface(rng: np.random.Generator, p: int, q: int, knots_u: Floats | None = None) -> SurfaceForm:
    """Random control points around (100, 0, 0), their weights over eight decades; two spans each way."""
    knots_u = uniform_knots(p + 2, p) if knots_u is None else knots_u
    knots_v = uniform_knots(q + 2, q)
    shape = (len(knots_u) - p - 1, q + 2)
    points = 10.0 * rng.normal(size=(*shape, 3)) + [100.0, 0.0, 0.0]
    return SurfaceForm.nurbs(p, q, knots_u, knots_v, points, 10.0 ** rng.uniform(-4, 4, shape))


def batch_of(form: SurfaceForm) -> GeometryBatch:
    builder = BatchBuilder()
    add_face(builder, form)
    return builder.build()


def exact_norms(form: SurfaceForm, u: float, v: float, from_left: bool = False) -> Floats:
    vectors = surface_derivatives(
        (form.degree_u, form.degree_v), (form.knots_u, form.knots_v), form.points, u, v, from_left
    )
    return np.asarray(np.linalg.norm(vectors, axis=1))


@pytest.mark.parametrize(("p", "q"), [(1, 1), (2, 1), (3, 2), (5, 4)])
def test_bounds_hold_on_boxes_lines_and_points(p: int, q: int) -> None:
    rng = np.random.default_rng(100 * p + q)
    form = wild_surface(rng, p, q)
    g = tables(batch_of(form))
    pieces = surface_pieces(g, 0.1)
    assert pieces.spread.max() > 1e3
    for k in range(12):
        size = 10.0 ** rng.uniform(-7, -0.3, 2) * [k % 4 != 1, k % 4 != 2]  # lines and boxes
        low = rng.uniform(0, 1, 2) * (1.0 - size) * (0 if k % 3 == 0 else 1)
        bounds = _box(g, pieces, low[0], low[0] + size[0], low[1], low[1] + size[1])
        for share in (0.0, 0.4, 1.0):
            u, v = np.minimum(low + share * size, 1.0 - 1e-15)
            assert (exact_norms(form, u, v) <= bounds * (1.0 + 1e-6)).all(), (k, size, low, share)


def test_bounds_shrink_with_the_box() -> None:
    # The hyperbolic paraboloid with weights k, 1, 1, k: near (1, 0) |S_uv| is about k^2, at (0, 0) 1 / k.
    k = 1e4
    net = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1.0]]])
    form = SurfaceForm.nurbs(1, 1, np.array([0, 0, 1, 1.0]), np.array([0, 0, 1, 1.0]), net, np.array([[k, 1], [1, k]]))
    g = tables(batch_of(form))
    pieces = surface_pieces(g, 0.1)
    for corner in ((0.0, 0.0), (1.0 - 2.0**-20, 0.0), (0.5, 0.5)):
        u, v = corner
        bounds = _box(g, pieces, u, u + 2.0**-20, v, v + 2.0**-20)
        true = exact_norms(form, u + 2.0**-21, v + 2.0**-21)
        assert (bounds <= 1.5 * true + 1e-3 * true.max()).all(), (corner, bounds, true)


def test_an_edge_is_bounded_by_what_the_surface_does_there() -> None:
    # Far weights in the second column alone: they must not count on the side v = 0.
    weights = np.array([[1.0, 1e4], [1.0, 1e-4], [1.0, 1e4]])
    x = np.stack(np.meshgrid([0.0, 0.5, 1.0], [0.0, 1.0], indexing="ij"), axis=2)
    points = np.concatenate([x, (x[..., :1] - 0.5) ** 2], axis=2)
    form = SurfaceForm.nurbs(2, 1, np.array([0, 0, 0, 1, 1, 1.0]), np.array([0, 0, 1, 1.0]), points, weights)
    g = tables(batch_of(form))
    along = _box(g, surface_pieces(g, 0.1), 0.0, 1.0, 0.0, 0.0)
    true = max(exact_norms(form, u, 0.0)[2] for u in np.linspace(0, 0.999, 9))
    assert true <= along[2] <= 10.0 * true


@pytest.mark.parametrize("seed", range(6))
def test_jumps_at_creases_are_bounded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, q = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    knots = np.concatenate([np.zeros(p + 1), np.full(p, 0.4), np.ones(p + 1)])
    form = wild_surface(rng, p, q, knots)
    if seed % 2:
        # Weights that separate: the bound need not pay for their kinks.
        form.points[...] *= (np.outer(10.0 ** rng.uniform(-1, 1, 2 * p + 1), np.ones(q + 2)) / form.points[..., 3])[
            ..., None
        ]
    pieces = surface_pieces(tables(batch_of(form)), 1e-9)
    jump = pieces.breaks[pieces.table[0, BREAK_U] + 1, JUMP]
    both = [
        [
            surface_derivatives((p, q), (form.knots_u, form.knots_v), form.points, 0.4, v, before)[0]
            for before in (True, False)
        ]
        for v in np.linspace(0, 0.9999, 15)
    ]
    true = max(float(np.linalg.norm(left - right)) for left, right in both)
    assert true <= jump * (1.0 + 1e-9)
    if seed % 2:
        assert jump <= 3.0 * true


def test_a_circle_of_two_halves_has_no_crease() -> None:
    circle = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0.0]])
    points = np.stack([np.column_stack([circle, np.full(5, z)]) for z in (0.0, 1.0)], axis=1)
    weights = np.outer([1, np.sqrt(0.5), 1, np.sqrt(0.5), 1], [1.0, 3.0])
    knots = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1.0])
    form = SurfaceForm.nurbs(2, 1, knots, np.array([0, 0, 1, 1.0]), points, weights)
    pieces = surface_pieces(tables(batch_of(form)), 1e-9)
    assert not pieces.breaks[:, JUMP].any()


@pytest.mark.parametrize("degree", [1, 2, 3, 6])
def test_curve_bounds_hold(degree: int) -> None:
    rng = np.random.default_rng(degree)
    form = wild_surface(rng, degree, 1)
    geometry = batch_of(form)
    g = tables(geometry)
    bottom = int(geometry.edges[geometry.coedges[0]["edge"]]["curve"])  # the side v = 0
    for _ in range(10):
        length = 10.0 ** rng.uniform(-7, -0.4)
        a = 0.5 * rng.uniform(0, 1) * (1.0 - length)
        b = min(a + length, 0.5)
        bounds = _interval(g, bottom, a, b)
        for share in (0.0, 0.5, 1.0):
            true = exact_norms(form, min(a + share * (b - a), 0.5 - 1e-15), 0.0)
            assert true[0] <= bounds[D1] * (1.0 + 1e-6)
            assert true[2] <= bounds[D2] * (1.0 + 1e-6)
