"""Bounds of derivatives: never below sampled ones, and near them where rational patches are long and thin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BPoly

from nurbs_cache.jit import kernel
from nurbs_ooc.bounds.derivatives import BOXES, MUU, MUV, MVV, net_bounds

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
