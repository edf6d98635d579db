"""Bounds of derivatives: never below sampled ones, and near them where rational patches are long and thin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BPoly

from nurbs_cache.jit import kernel
from nurbs_ooc.bounds.derivatives import BOXES, MUU, MUV, MVV, net_bounds
from nurbs_ooc.bounds.quotient_bounds import quotient_bounds

pytestmark = pytest.mark.kernel

Floats = npt.NDArray[np.float64]


@kernel
def _bounds(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float) -> Floats:
    out = np.empty(5)
    net_bounds(net, p, q, dim, h_u, h_v, out, np.empty(BOXES))
    return out


@kernel
def _boxes(net: Floats, p: int, q: int, dim: int, h_u: float, h_v: float) -> Floats:
    out = np.empty(BOXES)
    net_bounds(net, p, q, dim, h_u, h_v, np.empty(5), out)
    return out


@kernel
def _quotients(net: Floats, p: int, q: int, h_u: float, h_v: float, center: Floats, boxes: Floats) -> Floats:
    out = np.empty(5)
    quotient_bounds(net, p, q, h_u, h_v, center, True, out, boxes)
    return out


def quotients(net: Floats) -> tuple[Floats, Floats]:
    """Bounds (5,) and boxes (3, 2, 3) of a net (p + 1, q + 1, 4) over the unit square by its quotients."""
    boxes = np.empty(BOXES)
    center = (net[..., :3] / net[..., 3:]).mean(axis=(0, 1))
    bounds = _quotients(net.ravel(), len(net) - 1, net.shape[1] - 1, 1.0, 1.0, center, boxes)
    return bounds, boxes.reshape(3, 2, 3)


def derivatives(net: Floats, u: Floats, v: Floats) -> Floats:
    """(5, n) norms of S_u, S_v, S_uu, S_uv, S_vv of a homogeneous net (p + 1, q + 1, 4)."""
    return np.linalg.norm(derivative_vectors(net, u, v), axis=2)


def derivative_vectors(net: Floats, u: Floats, v: Floats) -> Floats:
    """(5, n, 3) S_u, S_v, S_uu, S_uv, S_vv of a homogeneous net (p + 1, q + 1, 4) by the quotient rule."""

    def at(du: int, dv: int) -> Floats:
        along_v = np.stack([BPoly(net[i][:, None], [0.0, 1.0])(v, dv) for i in range(len(net))])
        return np.stack([BPoly(along_v[:, k][:, None], [0.0, 1.0])(u[k], du) for k in range(len(u))])

    h, hu, hv, huu, huv, hvv = at(0, 0), at(1, 0), at(0, 1), at(2, 0), at(1, 1), at(0, 2)
    w, wu, wv = h[:, 3:], hu[:, 3:], hv[:, 3:]
    s = h[:, :3] / w
    su, sv = (hu[:, :3] - wu * s) / w, (hv[:, :3] - wv * s) / w
    suu = (huu[:, :3] - 2.0 * wu * su - huu[:, 3:] * s) / w
    svv = (hvv[:, :3] - 2.0 * wv * sv - hvv[:, 3:] * s) / w
    suv = (huv[:, :3] - wu * sv - wv * su - huv[:, 3:] * s) / w
    return np.stack([su, sv, suu, suv, svv])


def half_cylinder(radius: float, length: float) -> Floats:
    """(2, 4, 4): degree 1 along the axis, cubic half circle across."""
    circle = np.array([[-1.0, 0.0, 1.0], [-1.0, -2.0, 1.0 / 3.0], [1.0, -2.0, 1.0 / 3.0], [1.0, 0.0, 1.0]])
    net = np.zeros((2, 4, 4))
    for i in range(2):
        net[i, :, :2] = radius * circle[:, :2] * circle[:, 2:]
        net[i, :, 2] = i * length * circle[:, 2]
        net[i, :, 3] = circle[:, 2]
    net[:, 1:3, 0] = radius * circle[1:3, 0] / 3.0
    net[:, 1:3, 1] = radius * circle[1:3, 1] / 3.0
    return net


@pytest.mark.parametrize(("p", "q"), [(1, 1), (1, 3), (3, 2), (5, 4)])
def test_never_below_sampled_derivatives(p: int, q: int) -> None:
    rng = np.random.default_rng(10 * p + q)
    u, v = rng.uniform(0, 1, 60), rng.uniform(0, 1, 60)
    for spread in (0.0, 0.3, 3.0):
        net = np.empty((p + 1, q + 1, 4))
        net[..., 3] = np.exp(spread * rng.normal(size=(p + 1, q + 1)))
        net[..., :3] = (rng.normal(size=(p + 1, q + 1, 3)) * [100.0, 1.0, 10.0] + 1000.0) * net[..., 3:]
        vectors = derivative_vectors(net, u, v)
        assert (
            np.linalg.norm(vectors, axis=2).max(axis=1) <= _bounds(net.ravel(), p, q, 4, 1.0, 1.0) * (1 + 1e-9)
        ).all()
        boxes = _boxes(net.ravel(), p, q, 4, 1.0, 1.0).reshape(3, 2, 3)
        slack = 1e-9 * np.abs(boxes).max()
        assert (vectors[2:].min(axis=1) >= boxes[:, 0] - slack).all()
        assert (vectors[2:].max(axis=1) <= boxes[:, 1] + slack).all()


def test_equal_weights_agree_with_the_polynomial() -> None:
    net = np.ones((4, 3, 4))
    net[..., :3] = np.random.default_rng(5).normal(size=(4, 3, 3))
    plain = _bounds(np.ascontiguousarray(net[..., :3]).ravel(), 3, 2, 3, 2.0, 3.0)
    rational = _bounds(net.ravel(), 3, 2, 4, 2.0, 3.0)
    assert (rational[2:] <= plain[2:] * (1 + 1e-12)).all()  # one degree more is never worse
    assert (rational[:2] <= 2.0 * plain[:2]).all()


@pytest.mark.parametrize("length", [1.0, 200.0, 1e5])
def test_length_of_a_cylinder_does_not_matter(length: float) -> None:
    net = half_cylinder(5.0, length)
    bounds = _bounds(net.ravel(), 1, 3, 4, length, 1.0)
    u = v = np.linspace(0, 1, 101)
    true = derivatives(net, u, v).max(axis=1)
    assert bounds[MUU] <= 1e-9 and bounds[MUV] <= 1e-9
    assert true[4] <= bounds[MVV]


def weights_of(kind: str, p: int, q: int, spread: float, rng: np.random.Generator) -> Floats:
    """(p + 1, q + 1) weights: any, products, the same along u or v, or products spoiled far above roundoff."""
    by_row, by_column = np.exp(spread * rng.normal(size=(p + 1, 1))), np.exp(spread * rng.normal(size=(1, q + 1)))
    if kind == "any":
        return np.exp(spread * rng.normal(size=(p + 1, q + 1)))
    if kind == "same along u":
        return np.repeat(by_column, p + 1, axis=0)
    if kind == "same along v":
        return np.repeat(by_row, q + 1, axis=1)
    product = by_row * by_column
    return product if kind == "products" else product * (1.0 + 1e-6 * rng.normal(size=product.shape))


@pytest.mark.parametrize("kind", ["any", "products", "same along u", "same along v", "spoiled"])
@pytest.mark.parametrize(("p", "q"), [(1, 1), (2, 1), (1, 3), (2, 2), (3, 2), (5, 4), (4, 5)])
def test_quotients_hold_sampled_derivatives(p: int, q: int, kind: str) -> None:
    rng = np.random.default_rng(100 * p + q)
    ends = np.linspace(0, 1, 9)
    u, v = np.repeat(ends, 9), np.tile(ends, 9)
    for spread in (0.0, 0.2, 1.0):
        for _ in range(4):
            net = np.empty((p + 1, q + 1, 4))
            net[..., 3] = weights_of(kind, p, q, spread, rng)
            net[..., :3] = (rng.normal(size=(p + 1, q + 1, 3)) * [100.0, 1.0, 10.0] + 1000.0) * net[..., 3:]
            vectors = derivative_vectors(net, u, v)
            bounds, boxes = quotients(net)
            slack = 1e-9 * np.abs(bounds).max()
            assert (np.linalg.norm(vectors, axis=2).max(axis=1) <= bounds + slack).all()
            assert (vectors[2:].min(axis=1) >= boxes[:, 0] - slack).all()
            assert (vectors[2:].max(axis=1) <= boxes[:, 1] + slack).all()


def quarter_circle() -> Floats:
    """(3, 4) homogeneous."""
    c = np.sqrt(0.5)
    return np.array([[1.0, 0.0, 0.0, 1.0], [c, c, 0.0, c], [0.0, 1.0, 0.0, 1.0]])


def test_quotients_are_near_the_truth_on_arcs() -> None:
    """Of a quarter circle, a cylinder and an octant of a sphere, where the quotient rule alone gives 2.5 to 4.5."""
    arc = quarter_circle()
    ends = np.linspace(0, 1, 101)
    true = derivatives(np.stack([arc, arc], axis=1), ends, np.zeros(101)).max(axis=1)
    bounds, _ = quotients(arc[:, None])
    assert true[2] <= bounds[2] <= 1.22 * true[2] and true[0] <= bounds[0] <= 1.18 * true[0]
    assert bounds[1] <= 1e-9 and bounds[3] <= 1e-9 and bounds[4] <= 1e-9
    cylinder = np.stack([arc, arc + np.array([0.0, 0.0, 9.0, 0.0]) * arc[:, 3:]])
    bounds, _ = quotients(cylinder)
    assert bounds[MVV] <= 1.22 * true[2] and bounds[MUU] <= 1e-9 and bounds[MUV] <= 1e-9
    octant = np.empty((3, 3, 4))
    for i, a in enumerate(arc):
        octant[i] = np.stack([arc[:, 0] * a[0], arc[:, 0] * a[1], arc[:, 1] * a[3], arc[:, 3] * a[3]], axis=1)
    true = derivatives(octant, np.repeat(ends, 101), np.tile(ends, 101)).max(axis=1)
    bounds, _ = quotients(octant)
    assert (true[2:] <= bounds[2:]).all() and (bounds[2:] <= 1.6 * true[2:]).all()
