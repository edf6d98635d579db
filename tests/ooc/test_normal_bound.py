"""The bound of interpolated normals: it holds on any triangle of any kind of surface, and it is not wasteful."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp
import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.bounds.circle_turn import turn_of_circle
from nurbs_ooc.bounds.normal_bound import SIZE, normal_bound
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.bounds.spline_slopes import pole_sides
from nurbs_ooc.bounds.strips import surface_pieces
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face, uniform_knots
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.measure.exact_surface import derivatives
from tests.hard.nets import as_nurbs, elevated

Floats = npt.NDArray[np.float64]
X, Y, Z = np.eye(3)
ORIGIN = np.array([3.0, -2.0, 5.0])
RNG_KEY = 0x0A31


@kernel
def _bounds(g: Tables, p: Pieces, uv: Floats, normals: Floats, steps: Floats) -> Floats:
    out = np.empty(len(uv))
    m = np.empty(SIZE)
    sides = pole_sides(g, 0) if g.surfaces[0].kind == 0 else 0
    for i in range(len(uv)):
        out[i] = normal_bound(g, p, 0, sides, uv[i], normals[i], steps[i], m)
    return out


@kernel
def _turns(a: Floats) -> Floats:
    out = np.empty(len(a))
    for i in range(len(a)):
        out[i] = turn_of_circle(a[i])
    return out


def batch_of(form: SurfaceForm) -> GeometryBatch:
    builder = BatchBuilder()
    add_face(builder, form)
    return builder.build()


def unit_normals(batch: GeometryBatch, uv: Floats) -> Floats:
    """By the measuring code's derivatives."""
    flat = uv.reshape(-1, 2)
    d = derivatives(batch, np.zeros(len(flat), np.int64), flat)
    n = np.cross(d[:, 1], d[:, 2])
    return np.asarray((n / np.linalg.norm(n, axis=1)[:, None]).reshape(*uv.shape[:-1], 3))


def bounds_of(batch: GeometryBatch, uv: Floats, normals: Floats, steps: Floats | None = None) -> Floats:
    g = tables(batch)
    steps = np.zeros_like(uv) if steps is None else steps
    return _bounds(g, surface_pieces(g, 0.0), np.ascontiguousarray(uv), np.ascontiguousarray(normals), steps)


def angles(a: Floats, b: Floats) -> Floats:
    chord = np.linalg.norm(a - b, axis=-1)
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0)))


def weights(n: int) -> Floats:
    """Barycentric weights of a grid of points in a triangle."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    keep = i + j <= n
    return np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n


def worst_angles(batch: GeometryBatch, uv: Floats, normals: Floats, n: int = 12) -> Floats:
    """(n_triangles,) largest sampled angle between interpolated and true normal, corners aside."""
    w = weights(n)
    w = w[w.max(axis=1) < 1.0]
    drawn = np.einsum("pk,tki->tpi", w, normals)
    drawn /= np.linalg.norm(drawn, axis=2)[..., None]
    return angles(drawn, unit_normals(batch, np.einsum("pk,tki->tpi", w, uv))).max(axis=1)


def triangles_in(form: SurfaceForm, rng: np.random.Generator, n: int, smallest: float = 1e-4) -> Floats:
    """(n, 3, 2) random triangles of many sizes and shapes inside the domain."""
    size = 10.0 ** rng.uniform(np.log10(smallest), -0.5, (n, 1, 1)) * 10.0 ** rng.uniform(-1.0, 0.0, (n, 1, 2))
    place = rng.random((n, 1, 2)) * (1.0 - size)
    at = place + size * rng.random((n, 3, 2))
    low, high = np.array([form.u0, form.v0]), np.array([form.u1, form.v1])
    return np.asarray(low + at * (high - low))


def wavy(p: int, q: int, seed: int, rational: bool, spans: int = 2, multiplicity: int = 1) -> SurfaceForm:
    rng = np.random.default_rng([seed, p, q])
    inner = np.repeat(np.linspace(0, 1, spans + 1)[1:-1], multiplicity)
    knots_u = np.concatenate([np.zeros(p + 1), inner, np.ones(p + 1)])
    knots_v = uniform_knots(q + spans, q)
    n_u, n_v = len(knots_u) - p - 1, len(knots_v) - q - 1
    x, y = np.meshgrid(np.linspace(0, 8, n_u), np.linspace(0, 5, n_v), indexing="ij")
    points = np.stack([x, y, 0.7 * rng.normal(size=x.shape)], axis=2) + 0.2 * rng.normal(size=(n_u, n_v, 3))
    weights = rng.uniform(0.5, 2.0, (n_u, n_v)) if rational else None
    return SurfaceForm.nurbs(p, q, knots_u, knots_v, points + np.array([20.0, 0.0, -3.0]), weights)


def framed(kind: SurfaceKind, domain: tuple[float, ...], a: float = 1.0, b: float = 0.0, **more: object) -> SurfaceForm:
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    if np.linalg.det(turn) < 0:
        turn[2] *= -1
    return SurfaceForm.framed(kind, ORIGIN, *turn, a, b, domain=domain, **more)  # type: ignore[arg-type]


def _profile() -> CurveForm:
    points = np.array([[2, 0, 0], [3, 0.2, 1], [2.5, 0.1, 2], [1, 0, 3], [2, 0, 4.0]])
    return CurveForm.nurbs(3, [0, 0, 0, 0, 0.4, 1, 1, 1, 1], points + ORIGIN, [1, 2, 1, 0.7, 1])


def _straight_frame(kind: SurfaceKind, domain: tuple[float, ...], profile: CurveForm) -> SurfaceForm:
    return SurfaceForm.framed(kind, ORIGIN, X, Y, Z, profile=profile, domain=domain)


SMOOTH: dict[str, Callable[[], SurfaceForm]] = {
    "cubic": lambda: wavy(3, 3, 1, False),
    "rational 3 x 2": lambda: wavy(3, 2, 2, True),
    "bilinear": lambda: wavy(1, 1, 3, False, spans=1),
    "degrees 5 x 4": lambda: wavy(5, 4, 4, False),
    "rational 4 x 6": lambda: wavy(4, 6, 5, True),
    "finely cut": lambda: wavy(3, 3, 6, False, spans=9),
    "curvature jumps": lambda: wavy(3, 2, 7, False, multiplicity=2),
    "cylinder": lambda: framed(SurfaceKind.CYLINDER, (0.0, 5.0, -1.0, 2.0)),
    "oblique cylinder": lambda: SurfaceForm.framed(
        SurfaceKind.CYLINDER, ORIGIN, 3 * X, Y + 0.5 * X, Z + 0.3 * X, domain=(0.0, 6.0, 0.0, 4.0)
    ),
    "cone": lambda: framed(SurfaceKind.CONE, (0.0, 6.0, 0.5, 3.0), 1.0, 0.5),
    "sphere": lambda: framed(SurfaceKind.SPHERE, (0.0, 6.0, -1.4, 1.5), 2.0),
    "torus": lambda: framed(SurfaceKind.TORUS, (0.0, 6.0, 0.0, 6.0), 3.0, 1.0),
    "inner torus": lambda: framed(SurfaceKind.TORUS, (0.0, 6.0, 2.2, 4.0), 0.5, 1.0),
    "revolution": lambda: _straight_frame(SurfaceKind.REVOLUTION, (0.0, 6.0, 0.0, 1.0), _profile()),
    "ellipse turned": lambda: _straight_frame(
        SurfaceKind.REVOLUTION, (0.0, 6.0, 0.0, 6.0), CurveForm.ellipse(ORIGIN + 4 * X, X + 0.2 * Y, 2 * Z)
    ),
    "extrusion": lambda: _straight_frame(SurfaceKind.EXTRUSION, (0.0, 1.0, 0.0, 4.0), _profile()),
    "hyperbola extruded": lambda: _straight_frame(
        SurfaceKind.EXTRUSION, (-1.0, 2.0, 0.0, 4.0), CurveForm.hyperbola(ORIGIN, X, 2 * Y, -1.0, 2.0)
    ),
    "rational sphere": lambda: as_nurbs(framed(SurfaceKind.SPHERE, (0.0, 6.0, -1.4, 1.5), 2.0)),
    "sphere of degree 8": lambda: elevated(as_nurbs(framed(SurfaceKind.SPHERE, (0.0, 6.0, -1.4, 1.5), 2.0)), 8),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_bound_holds(name: str) -> None:
    form = SMOOTH[name]()
    batch = batch_of(form)
    rng = np.random.default_rng([RNG_KEY, len(name)])
    uv = triangles_in(form, rng, 400)
    normals = unit_normals(batch, uv)
    bound, worst = bounds_of(batch, uv, normals), worst_angles(batch, uv, normals)
    assert (worst <= bound + 1e-12).all(), np.max(worst / bound)
    small = worst < 0.05
    assert np.isfinite(bound[small & (worst > 1e-9)]).mean() > 0.9
    assert small.sum() > 100


@pytest.mark.parametrize("name", SMOOTH)
def test_bound_is_not_wasteful(name: str) -> None:
    """Of small triangles the median of bound / worst sample is small, and half the size makes a quarter of it."""
    form = SMOOTH[name]()
    batch = batch_of(form)
    rng = np.random.default_rng([RNG_KEY, 2])
    uv = triangles_in(form, rng, 300, smallest=1e-2)
    middle = uv.mean(axis=1, keepdims=True)
    found = []
    for share in (0.1, 0.05):
        corners = middle + share * (uv - middle)
        normals = unit_normals(batch, corners)
        found.append((bounds_of(batch, corners, normals), worst_angles(batch, corners, normals)))
    (coarse, worst), (fine, _) = found
    seen = worst > 1e-8
    if seen.any():
        assert np.median(coarse[seen] / worst[seen]) < 1.5
    assert np.median(coarse / fine) > 3.0 or np.median(coarse) < 1e-9


def test_a_long_thin_arc_does_not_pay_for_its_length() -> None:
    """A rational cylinder of radius 1e-3: its weights change along u, and its length has nothing to do with normals."""
    found = []
    for length in (1.0, 1e5):
        form = as_nurbs(
            SurfaceForm.framed(SurfaceKind.CYLINDER, ORIGIN, 1e-3 * X, 1e-3 * Y, Z, domain=(0, 3, 0, length))
        )
        batch = batch_of(form)
        u = form.u0 + (form.u1 - form.u0) * np.array([0.3, 0.4, 0.35])
        uv = np.stack([u, form.v0 + (form.v1 - form.v0) * np.array([0.0, 0.0, 1.0])], axis=1)[None]
        normals = unit_normals(batch, uv)
        found.append(float(bounds_of(batch, uv, normals)[0]))
        assert worst_angles(batch, uv, normals)[0] <= found[-1] + 1e-12
    assert found[1] <= 1.05 * found[0]


@pytest.mark.kernel
def test_an_arc_in_fifty_digits() -> None:
    a = np.array([1e-6, 1e-4, 1e-2, 0.5, 1.0, 2.0])
    found = _turns(a)
    with mp.workdps(50):
        for angle, bound in zip(a, found, strict=True):
            h = mp.mpf(float(angle)) / 2
            worst = max(abs(mp.atan(w * mp.tan(h)) - w * h) for w in mp.linspace(0, 1, 2001))
            assert worst <= bound * (1 + 1e-6) + 1e-25
            assert bound <= worst * (1 + 1e-2) + mp.mpf("1e-22")
