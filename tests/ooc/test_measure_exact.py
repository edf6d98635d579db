"""The attacker's own evaluation against scipy, mpmath, closed forms and Open CASCADE."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from scipy.interpolate import BSpline

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.measure import exact_reference
from nurbs_ooc.measure.exact_curve import evaluate_curves
from nurbs_ooc.measure.exact_surface import derivatives, normals, points
from tests.ooc.measure_shapes import Shape, random_nurbs, sphere

DEGREES = [(1, 1), (2, 3), (3, 3), (5, 1), (9, 4), (0, 1)]


def _uv(geometry: GeometryBatch, rng: np.random.Generator, n: int = 200) -> np.ndarray:
    s = geometry.surfaces[0]
    share = rng.random((n, 2))
    share[:4] = [[0, 0], [0, 1], [1, 0], [1, 1]]
    return np.array([s["u0"], s["v0"]]) + share * np.array([s["u1"] - s["u0"], s["v1"] - s["v0"]])


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("rational", [False, True])
def test_tensor_product_equals_scipy(degrees: tuple[int, int], rational: bool) -> None:
    rng = np.random.default_rng(3)
    counts = (degrees[0] + 6, degrees[1] + 4)
    g = random_nurbs(rng, degrees, counts, rational)
    s = g.surfaces[0]
    uv = _uv(g, rng)
    ku = g.values[s["knots_u"] :][: counts[0] + degrees[0] + 1]
    kv = g.values[s["knots_v"] :][: counts[1] + degrees[1] + 1]
    width = 4 if rational else 3
    net = g.values[s["points"] :][: np.prod(counts) * width].reshape(*counts, width)

    def value(du: int, dv: int) -> np.ndarray:
        in_u = [BSpline(ku, np.eye(counts[0])[i], degrees[0])(uv[:, 0], du) for i in range(counts[0])]
        in_v = [BSpline(kv, np.eye(counts[1])[i], degrees[1])(uv[:, 1], dv) for i in range(counts[1])]
        return np.einsum("in,jn,ijk->nk", in_u, in_v, net)

    w = value(0, 0)[:, 3:] if rational else 1.0
    want = value(0, 0)[:, :3] / w
    got = derivatives(g, 0, uv)
    np.testing.assert_allclose(got[:, 0], want, atol=1e-12)
    for k, (du, dv) in enumerate([(1, 0), (0, 1)], start=1):
        d = value(du, dv)
        d = (d[:, :3] - d[:, 3:] * want) / w if rational else d
        np.testing.assert_allclose(got[:, k], d, atol=1e-9 * max(1.0, float(np.abs(d).max())))


def _one_of_each() -> GeometryBatch:
    shape = Shape()
    frame = {"origin": (1.0, 2.0, 3.0), "x": (0.6, 0.8, 0.0), "y": (0.0, 0.0, 1.0), "z": (0.8, -0.6, 0.0)}
    full = (0.0, 2 * math.pi, -1.0, 1.5)
    profile = shape.curve([[3, 1, 0], [4, 2, 1], [2, 2, 5], [1, 4, 4]], 2, [0, 0, 0, 0.3, 1, 1, 1], 3)
    round_profile = shape.conic(CurveKind.ELLIPSE, [3, 0, 0], [1, 0, 0], [0, 0.5, 1], 0.2, 2.0)
    open_profile = shape.conic(CurveKind.HYPERBOLA, [3, 0, 0], [1, 0, 0], [0, 0.5, 1], -1.0, 1.0)
    for kind in (SurfaceKind.PLANE, SurfaceKind.CYLINDER, SurfaceKind.CONE, SurfaceKind.SPHERE, SurfaceKind.TORUS):
        shape.analytic(kind, full, a=5.0, b=0.7, **frame)
    for row, t0, t1 in ((profile, 0.0, 1.0), (round_profile, 0.2, 2.0), (open_profile, -1.0, 1.0)):
        shape.analytic(SurfaceKind.REVOLUTION, (0.0, 6.0, t0, t1), profile=row, **frame)
        shape.analytic(SurfaceKind.EXTRUSION, (t0, t1, 0.0, 6.0), profile=row, **frame)
    return shape.batch()


@pytest.mark.parametrize("geometry", [_one_of_each(), random_nurbs(np.random.default_rng(5), (3, 4), (8, 9), True)])
def test_kernels_equal_fifty_digits(geometry: GeometryBatch) -> None:
    arithmetic = exact_reference.multiprecision(50)
    rng = np.random.default_rng(11)
    for row, s in enumerate(geometry.surfaces):
        for share in [(0.0, 0.0), (1.0, 1.0), *rng.random((4, 2))]:
            u, v = s["u0"] + share[0] * (s["u1"] - s["u0"]), s["v0"] + share[1] * (s["v1"] - s["v0"])
            want = exact_reference.surface_point(geometry, row, mpmath.mpf(float(u)), mpmath.mpf(float(v)), arithmetic)
            got = points(geometry, row, [[u, v]])[0]
            assert max(abs(float(a - b)) for a, b in zip(want, got, strict=True)) < 2e-14 * 20


def test_long_double_reference_agrees() -> None:
    g = random_nurbs(np.random.default_rng(7), (5, 2), (11, 6), True)
    u, v = np.longdouble("0.37"), np.longdouble("0.81")
    want = exact_reference.surface_point(g, 0, u, v, exact_reference.EXTENDED)
    np.testing.assert_allclose(points(g, 0, [[float(u), float(v)]])[0], np.array(want, float), atol=1e-13)


def test_derivatives_equal_differences() -> None:
    g = _one_of_each()
    h = 1e-6
    for row in range(len(g)):
        s = g.surfaces[row]
        uv = np.array([[0.4, 0.6], [0.77, 0.31]]) * [s["u1"] - s["u0"], s["v1"] - s["v0"]] + [s["u0"], s["v0"]]
        d = derivatives(g, row, uv)
        for k, step in enumerate(([h, 0.0], [0.0, h]), start=1):
            difference = (points(g, row, uv + step) - points(g, row, uv - step)) / (2 * h)
            np.testing.assert_allclose(d[:, k], difference, atol=1e-8)


def test_closed_forms() -> None:
    g = _one_of_each()
    uv = np.random.default_rng(0).random((50, 2)) * [6.0, 2.0] - [0.0, 1.0]
    o, z = np.array([1.0, 2.0, 3.0]), np.array([0.8, -0.6, 0.0])
    radius = np.linalg.norm(points(g, 3, uv) - o, axis=1)
    np.testing.assert_allclose(radius, 5.0, rtol=1e-15)
    on_cylinder = points(g, 1, uv) - o
    np.testing.assert_allclose(np.linalg.norm(on_cylinder - np.outer(on_cylinder @ z, z), axis=1), 1.0, rtol=1e-14)
    on_torus = points(g, 4, uv) - o
    flat = np.linalg.norm(on_torus - np.outer(on_torus @ z, z), axis=1)
    np.testing.assert_allclose(np.hypot(flat - 5.0, on_torus @ z), 0.7, rtol=1e-13)


def test_normals_point_outside_and_vanish_at_poles() -> None:
    g = sphere(2.0)
    uv = np.array([[1.0, 0.3], [4.0, -1.2], [0.5, math.pi / 2]])
    n = normals(g, 0, uv)
    np.testing.assert_allclose(n[:2], points(g, 0, uv[:2]) / 2.0, atol=1e-14)
    assert np.linalg.norm(n[2]) in (0.0, pytest.approx(1.0))
    flipped = sphere(2.0, reversed=1)
    np.testing.assert_allclose(normals(flipped, 0, uv[:2]), -n[:2])


def test_periodic_parameters_are_turned_into_the_knots() -> None:
    g = random_nurbs(np.random.default_rng(5), (3, 3), (8, 8), False)
    g.surfaces["u_period"] = 1.0
    np.testing.assert_allclose(
        points(g, 0, [[1.25, 0.5], [-0.75, 0.5]]), points(g, 0, [[0.25, 0.5], [0.25, 0.5]]), atol=1e-13
    )


def test_rational_circle_is_a_circle() -> None:
    shape = Shape()
    h = math.sqrt(0.5)
    shape.curve([[1, 0, 1], [h, h, h], [0, 1, 1]], 2, [0, 0, 0, 1, 1, 1], 2, rational=True)
    p, d = evaluate_curves(shape.batch(), 0, np.linspace(0, 1, 21))
    np.testing.assert_allclose(np.linalg.norm(p[:, :2], axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose((p * d).sum(1), 0.0, atol=1e-15)


def test_open_cascade_agrees() -> None:
    geom = pytest.importorskip("OCP.Geom")
    gp = pytest.importorskip("OCP.gp")
    frame = gp.gp_Ax3(gp.gp_Pnt(1, 2, 3), gp.gp_Dir(0.8, -0.6, 0), gp.gp_Dir(0.6, 0.8, 0))
    kernel = [geom.Geom_CylindricalSurface(frame, 1.0), geom.Geom_ConicalSurface(frame, 0.7, 5.0)]
    kernel += [geom.Geom_SphericalSurface(frame, 5.0), geom.Geom_ToroidalSurface(frame, 5.0, 0.7)]
    g = _one_of_each()
    uv = np.random.default_rng(1).random((20, 2)) * [6.0, 1.4]
    for row, surface in enumerate(kernel, start=1):
        theirs = np.array([[p.X(), p.Y(), p.Z()] for p in (surface.Value(u, v) for u, v in uv)])
        np.testing.assert_allclose(points(g, row, uv), theirs, atol=1e-13)
