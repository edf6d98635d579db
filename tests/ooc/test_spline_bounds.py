"""Bounds of B-spline surfaces and curves on their knot spans, and of triangles on them, against scipy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BSpline, NdBSpline

from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.bounds.creases import HIDDEN, JUMP, REACH
from nurbs_ooc.bounds.curve_bounds import D1, D2, D2_X, HIGH, LOW
from nurbs_ooc.bounds.curve_pieces import curve_pieces
from nurbs_ooc.bounds.derivatives import BOXES, MUU, MUV, MVV, net_bounds
from nurbs_ooc.bounds.piece_boxes import box_bounds, box_boxes, creases_in_box
from nurbs_ooc.bounds.pieces import BREAK_U, N_U, N_V, Pieces
from nurbs_ooc.bounds.strips import surface_pieces
from nurbs_ooc.bounds.triangle_bound import MEASURES, box_radii, largest_mean, norm_bound, vector_bound
from nurbs_ooc.geometry.bezier_net import bezier_net
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables

pytestmark = pytest.mark.kernel

Floats = npt.NDArray[np.float64]


def clamped(degree: int, inner: list[float]) -> Floats:
    """Knots on [0, 1]."""
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def one_surface(
    p: int, q: int, inner_u: list[float], inner_v: list[float], seed: int
) -> tuple[GeometryBatch, NdBSpline]:
    """A wavy polynomial surface as a part, and as scipy sees it."""
    rng = np.random.default_rng(seed)
    knots = clamped(p, inner_u), clamped(q, inner_v)
    shape = len(knots[0]) - p - 1, len(knots[1]) - q - 1
    x, y = np.meshgrid(*(np.linspace(0, 50, n) for n in shape), indexing="ij")
    points = np.stack([x, y, 0.0 * x], axis=-1) + rng.normal(size=(*shape, 3)) * [2.0, 2.0, 8.0]
    builder = BatchBuilder()
    builder.surface(SurfaceForm.nurbs(p, q, *knots, points))
    return builder.build(), NdBSpline(knots, points, (p, q))


@kernel
def _over(g: Tables, p: Pieces, box: Floats) -> tuple[Floats, Floats, float]:
    bounds = np.empty(5)
    boxes = np.empty(BOXES)
    box_bounds(g, p, 0, box[0], box[1], box[2], box[3], bounds)
    box_boxes(p, 0, box[0], box[1], box[2], box[3], boxes)
    return bounds, boxes, creases_in_box(p, 0, box[0], box[1], box[2], box[3])


@kernel
def _net(g: Tables, box: Floats) -> Floats:
    out = np.empty((MAX_DEGREE + 1) * (MAX_DEGREE + 1) * 4)
    bezier_net(g, 0, box[0], box[1], box[2], box[3], out)
    return out


@kernel
def _net_bounds(g: Tables, box: Floats) -> Floats:
    """What ``_triangle`` takes, over a box inside one span."""
    net = np.empty((MAX_DEGREE + 1) * (MAX_DEGREE + 1) * 4)
    bounds = np.empty(5)
    out = np.empty(MEASURES)
    s = g.surfaces[0]
    dim = bezier_net(g, 0, box[0], box[1], box[2], box[3], net)
    net_bounds(net, s.degree_u, s.degree_v, dim, box[1] - box[0], box[3] - box[2], bounds, out[3:])
    out[0], out[1], out[2] = bounds[MUU], bounds[MUV], bounds[MVV]
    box_radii(out)
    return out


@kernel
def _triangle(m: Floats, t: Floats, vectors: bool) -> float:
    if vectors:
        return vector_bound(m, t[0, 0], t[0, 1], t[1, 0], t[1, 1], t[2, 0], t[2, 1], 0.0, 0.0)
    return norm_bound(m, t[0, 0], t[0, 1], t[1, 0], t[1, 1], t[2, 0], t[2, 1], 0.0, 0.0)


@kernel
def _largest_mean(p: float, q: float, r: float) -> float:
    return largest_mean(p, q, r)


def weights(n: int) -> Floats:
    """Barycentric weights of a grid on a triangle."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    i, j = i[i + j <= n], j[i + j <= n]
    return np.stack([i, j, n - i - j], axis=1) / n


def test_largest_mean_is_the_largest_over_all_weights() -> None:
    rng = np.random.default_rng(1)
    w = weights(60)
    for p, q, r in rng.exponential(size=(40, 3)):
        sampled = (w[:, 0] * w[:, 1] * p + w[:, 0] * w[:, 2] * q + w[:, 1] * w[:, 2] * r).max()
        assert sampled <= _largest_mean(p, q, r) * (1 + 1e-12)
        assert sampled >= 0.99 * _largest_mean(p, q, r)


@pytest.mark.parametrize(("p", "q"), [(1, 2), (2, 3), (3, 3), (5, 4)])
def test_bounds_hold_on_every_span(p: int, q: int) -> None:
    geometry, spline = one_surface(p, q, [0.2, 0.45, 0.5, 0.9], [0.3, 0.3, 0.6] if q > 2 else [0.3], 10 * p + q)
    g = tables(geometry)
    pieces = surface_pieces(g, 1e-3)
    rng = np.random.default_rng(3)
    for _ in range(12):
        u, v = np.sort(rng.uniform(size=2)), np.sort(rng.uniform(size=2))
        bounds, boxes, _ = _over(g, pieces, np.array([*u, *v]))
        at = np.stack([rng.uniform(*u, 50), rng.uniform(*v, 50)], axis=1)
        for which, order in ((MUU, (2, 0)), (MUV, (1, 1)), (MVV, (0, 2))):
            true = spline(at, nu=order)
            assert np.linalg.norm(true, axis=1).max() <= bounds[which] * (1 + 1e-9) + 1e-9
            low, high = boxes.reshape(3, 2, 3)[which - MUU]
            assert (true >= low - 1e-7).all() and (true <= high + 1e-7).all()


def measures(bounds: Floats, boxes: Floats) -> Floats:
    """What ``_triangle`` takes: norms, boxes and half their diagonals."""
    radii = 0.5 * np.linalg.norm(np.diff(boxes.reshape(3, 2, 3), axis=1)[:, 0], axis=1)
    return np.concatenate([bounds[[MUU, MUV, MVV]], boxes, radii])


def test_triangles_are_as_near_as_their_bounds_say() -> None:
    geometry, spline = one_surface(3, 4, [0.5], [0.25, 0.7], 5)
    g = tables(geometry)
    pieces = surface_pieces(g, 1e-3)
    rng = np.random.default_rng(7)
    w = weights(12)
    nearest = 0.0

    def find_piece(uv: Floats) -> tuple[int, int]:
        return int(np.searchsorted([0.5], uv[0])), int(np.searchsorted([0.25, 0.7], uv[1]))

    for _ in range(80):
        t = rng.uniform(0, 0.8, 2) + rng.uniform(0, 0.2, (3, 2)) * rng.choice([1.0, 0.1])
        low, high = t.min(axis=0), t.max(axis=0)
        bounds, boxes, creases = _over(g, pieces, np.array([low[0], high[0], low[1], high[1]]))
        m = measures(bounds, boxes)
        off = np.linalg.norm(spline(w @ t) - w @ spline(t), axis=1).max()
        assert creases == 0.0
        assert off <= _triangle(m, t, False) and off <= _triangle(m, t, True)
        if find_piece(low) == find_piece(high):
            own = np.concatenate([low, high])[[0, 2, 1, 3]]
            nearest = max(nearest, off / _triangle(_net_bounds(g, own), t, True))
    # Bounds over the triangle's own box, as a cell that fits it has them.
    assert 0.8 < nearest <= 1.0


def test_a_strip_between_close_knots_is_charged_as_a_crease() -> None:
    inner = [0.25, 0.4999, 0.49995, 0.5, 0.75]
    geometry, spline = one_surface(3, 3, inner, [0.5], 11)
    g = tables(geometry)
    loose, strict = surface_pieces(g, 1e3), surface_pieces(g, 1e-9)
    breaks = loose.breaks[loose.table[0, BREAK_U] : loose.table[0, BREAK_U] + loose.table[0, N_U] + 1]
    assert breaks[:, HIDDEN].sum() == 2.0 and breaks[:, REACH].max() == pytest.approx(1e-4)
    assert strict.breaks[:, JUMP].max() == 0.0
    w = weights(40)
    for t in (np.array([[0.3, 0.1], [0.7, 0.2], [0.45, 0.4]]), np.array([[0.49993, 0.1], [0.7, 0.2], [0.6, 0.4]])):
        low, high = t.min(axis=0), t.max(axis=0)
        bounds, boxes, creases = _over(g, loose, np.array([low[0], high[0], low[1], high[1]]))
        off = np.linalg.norm(spline(w @ t) - w @ spline(t), axis=1).max()
        bound = creases + _triangle(measures(bounds, boxes), t, True)
        assert creases > 0.0 and off <= bound
        sharp, _, _ = _over(g, strict, np.array([low[0], high[0], low[1], high[1]]))
        assert bound < 0.1 * sharp[MUU] * (high[0] - low[0]) ** 2 / 8.0


def test_bezier_net_is_the_surface() -> None:
    geometry, spline = one_surface(4, 3, [0.3, 0.8], [0.5], 2)
    box = np.array([0.35, 0.7, 0.55, 0.9])
    net = _net(tables(geometry), box)[: 5 * 4 * 3].reshape(5, 4, 3)
    s = np.linspace(0, 1, 9)
    bernstein = [BSpline.design_matrix(s, clamped(d, []), d).toarray() for d in (4, 3)]
    ours = np.einsum("ai,bj,ijk->abk", *bernstein, net)
    u, v = box[0] + s * (box[1] - box[0]), box[2] + s * (box[3] - box[2])
    theirs = spline(np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1))
    np.testing.assert_allclose(ours, theirs, atol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
def test_curve_pieces_bound_their_curves(dim: int) -> None:
    rng = np.random.default_rng(4)
    knots = clamped(3, [0.2, 0.2, 0.5, 0.8])
    points = rng.normal(size=(len(knots) - 4, dim)) * 10.0
    builder = BatchBuilder()
    row = builder.curve(CurveForm.nurbs(3, knots, points))
    pieces = curve_pieces(tables(builder.build()))
    spline = BSpline(knots, points, 3)
    assert pieces.start[pieces.first[row] : pieces.first[row + 1]].tolist() == [0.0, 0.2, 0.5, 0.8]
    ends = [0.2, 0.5, 0.8, 1.0]
    for k, (start, end) in enumerate(zip([0.0, 0.2, 0.5, 0.8], ends, strict=True)):
        b = pieces.bounds[pieces.first[row] + k]
        t = np.linspace(start, np.nextafter(end, 0), 100)
        assert np.linalg.norm(spline(t, 1), axis=1).max() <= b[D1] * (1 + 1e-9)
        assert np.linalg.norm(spline(t, 2), axis=1).max() <= b[D2] * (1 + 1e-9)
        low, high = b[LOW : LOW + dim], b[HIGH : HIGH + dim]
        assert (spline(t) >= low - 1e-9).all() and (spline(t) <= high + 1e-9).all()
        if dim == 2:
            # Ends, and the largest deviation from their chord that the second derivative allows.
            chord = np.abs(np.diff(spline(np.array([start, np.nextafter(end, 0)])), axis=0)[0])
            assert np.allclose(high - low, chord + b[D2_X : D2_X + 2] * (end - start) ** 2 / 4.0)


def test_bounds_of_a_rational_part_follow_it() -> None:
    """A cylinder's quarter, cut down: its radius is bounded the better, the smaller the part."""
    w = np.sqrt(0.5)
    points = np.array([[[5, 0, z], [5, 5, z], [0, 5, z]] for z in (0.0, 200.0)])
    builder = BatchBuilder()
    weights_ = np.array([[1.0, w, 1.0]] * 2)
    builder.surface(SurfaceForm.nurbs(1, 2, [0, 0, 1, 1], [0, 0, 0, 1, 1, 1], points, weights_))
    g = tables(builder.build())
    t = np.linspace(0.25, 0.5, 200)
    circle = BSpline(clamped(2, []), points[0, :, :2] * weights_[0][:, None], 2)
    scale = BSpline(clamped(2, []), weights_[0], 2)
    first = (circle(t, 1) - scale(t, 1)[:, None] * circle(t) / scale(t)[:, None]) / scale(t)[:, None]
    second = circle(t, 2) - 2 * scale(t, 1)[:, None] * first - (scale(t, 2) / scale(t))[:, None] * circle(t)
    true = np.linalg.norm(second / scale(t)[:, None], axis=1).max()
    found = _net_bounds(g, np.array([0.0, 1.0, 0.25, 0.5]))
    assert found[0] <= 1e-9 and found[1] <= 1e-9
    assert true <= found[2] <= 2.0 * true


def test_spans_of_a_part_of_the_domain() -> None:
    geometry, _ = one_surface(2, 2, [0.25, 0.5, 0.75], [0.5], 3)
    geometry.surfaces["u0"], geometry.surfaces["u1"] = 0.3, 0.6
    pieces = surface_pieces(tables(geometry), 1e-3)
    assert pieces.table[0, N_U] == 2 and pieces.table[0, N_V] == 2
