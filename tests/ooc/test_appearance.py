"""The appearance-preserving mode: distance and shading within one error, for normals and other attributes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.curvature import mean_curvature
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_cone, add_cylinder, add_plane, add_sphere, add_torus
from nurbs_ooc.measure.attack_appearance import attack_appearance
from nurbs_ooc.measure.attack_normals import attack_normals
from nurbs_ooc.tessellation.appearance import Appearance
from nurbs_ooc.tessellation.attributes import attribute_tables
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.ooc.test_shading import wave


def _batch(*adds: object) -> GeometryBatch:
    builder = BatchBuilder()
    for add in adds:
        add(builder)  # type: ignore[operator]
    return builder.build()


def combined(geometry: GeometryBatch, mesh: object, unseen_deg: float) -> float:
    """Largest combined error at random points of the triangles, from exact normals and places of the surface."""
    from nurbs_ooc.measure.exact_surface import normals, points

    m = mesh
    rng = np.random.default_rng(1)
    w = rng.dirichlet((1, 1, 1), (len(m.triangles), 12))  # type: ignore[attr-defined]
    rows = m.triangles  # type: ignore[attr-defined]
    corner, normal, uv = m.positions[rows], m.normals[rows], m.parameters[rows]  # type: ignore[attr-defined]
    way = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
    turn = np.linalg.norm(normal - np.roll(normal, 1, axis=1), axis=2)
    steepest = (turn / way).max(axis=1)[:, None]
    at = np.einsum("tpk,tki->tpi", w, uv)
    drawn = np.einsum("tpk,tki->tpi", w, normal)
    drawn /= np.linalg.norm(drawn, axis=2)[..., None]
    row = np.zeros(at.shape[0] * at.shape[1], np.int64)
    exact = normals(geometry, row, at.reshape(-1, 2)).reshape(drawn.shape)
    place = points(geometry, row, at.reshape(-1, 2)).reshape(drawn.shape)
    off = np.linalg.norm(place - np.einsum("tpk,tki->tpi", w, corner), axis=2)
    shade = np.linalg.norm(drawn - exact, axis=2)
    shade = np.where(shade <= np.radians(unseen_deg), 0.0, shade) / steepest
    return float(np.sqrt(off**2 + shade**2).max())


@pytest.mark.parametrize("error", [0.2, 0.02])
def test_distance_and_shading_stay_within_the_error(error: float) -> None:
    g = wave()
    look = Appearance()
    mesh = tessellate(g, error, appearance=look)
    assert mesh.appearance_error.max() <= error
    assert mesh.certified_error.max() <= error
    assert combined(g, mesh, look.unseen_deg) <= error
    plain = tessellate(g, error)
    assert len(plain.appearance_error) == 0
    assert combined(g, plain, look.unseen_deg) > error
    assert attack_normals(g, mesh, 1000).mean < attack_normals(g, plain, 1000).mean


def test_planes_look_right_at_once() -> None:
    plain, kept = (tessellate(_batch(add_plane), 0.1, appearance=a) for a in (None, Appearance()))
    assert np.array_equal(plain.triangles, kept.triangles)
    assert kept.appearance_error.max() == 0.0


def test_mean_curvature_of_a_sphere_and_a_torus() -> None:
    uv = np.array([[0.3, 0.2], [1.0, 0.7]])
    g = _batch(add_sphere)
    radius = np.linalg.norm(tessellate(g, 0.1).positions[0])
    assert np.abs(mean_curvature(g, 0, uv)) == pytest.approx(1.0 / radius, rel=1e-6)
    g = _batch(add_torus)
    a, b = g.values[int(g.surfaces[0]["frame"]) + 12 : int(g.surfaces[0]["frame"]) + 14]
    expected = 0.5 * (1.0 / b + np.cos(uv[:, 1]) / (a + b * np.cos(uv[:, 1])))
    assert np.abs(mean_curvature(g, 0, uv)) == pytest.approx(expected, rel=1e-6)


def test_an_attribute_is_followed() -> None:
    """A hill of temperature on a flat sheet: distance asks for two triangles, the attribute for many."""
    g = _batch(add_plane)
    s = g.surfaces[0]
    low, size = np.array([s["u0"], s["v0"]], float), np.array([s["u1"] - s["u0"], s["v1"] - s["v0"]], float)

    def hill(_geometry: GeometryBatch, _row: int, uv: np.ndarray) -> np.ndarray:
        x = (uv - low) / size - 0.5
        return np.exp(-20.0 * (x**2).sum(axis=1))

    counts = []
    for share in (0.05, 0.005):
        error = share * float(size.min())
        mesh = tessellate(g, error, appearance=Appearance(normals=False, attribute=hill, unseen_share=0.0))
        assert mesh.appearance_error.max() <= error
        counts.append(len(mesh.triangles))
    assert counts[0] > 50
    assert counts[1] > 2 * counts[0]


def test_an_attribute_as_a_spline_is_a_bound() -> None:
    """u^2 over a flat sheet: the interpolated value is off by an eighth of the square of a triangle's width."""
    g = _batch(add_plane)
    s = g.surfaces[0]
    u0, u1, v0, v1 = (float(s[k]) for k in ("u0", "u1", "v0", "v1"))
    net = np.zeros((3, 2, 3))
    net[:, :, 0] = np.array([u0 * u0, u0 * u1, u1 * u1])[:, None]
    form = SurfaceForm.nurbs(2, 1, [u0] * 3 + [u1] * 3, [v0, v0, v1, v1], net)
    error = 0.02 * (u1 - u0)
    mesh = tessellate(g, error, appearance=Appearance(False, {0: form}, unseen_share=0.0))
    assert mesh.appearance_error.max() <= error
    value = mesh.parameters[:, 0] ** 2
    w = np.random.default_rng(1).dirichlet((1, 1, 1), 50)
    rows = mesh.triangles
    off = np.abs((w @ value[rows].T).T - ((w @ mesh.parameters[rows][..., 0].T).T) ** 2)
    # Of u^2 the largest rate between two places of a triangle, see ``shading_length``.
    steepest = 2.0 * np.abs(mesh.parameters[rows][..., 0]).max(axis=1)
    assert (off.max(axis=1) <= error * steepest + 1e-12).all()


SURFACES = {
    "torus": lambda: _batch(add_torus),
    "cylinder": lambda: _batch(add_cylinder),
    "cone": lambda: _batch(add_cone),
    "sphere": lambda: _batch(add_sphere),
    "spline": wave,
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("both", [False, True])
def test_curvature_is_kept_where_it_is_finite_and_never_exceeded(name: str, both: bool) -> None:
    g = SURFACES[name]()
    size = float(np.linalg.norm(np.ptp(tessellate(g, 1.0).positions, axis=0)))
    look = Appearance(both, "curvature")
    mesh = tessellate(g, 0.01 * size, appearance=look)
    kept = mesh.appearance_error <= 0.01 * size
    assert kept.all() or name == "cone"
    assert (mesh.reason[~kept] == FaceReason.APPEARANCE_NOT_KEPT).all()
    # What cannot be kept, at an apex, is off by no more than the triangles there are large.
    assert mesh.appearance_error.max() <= size
    unseen = attribute_tables(g, mean_curvature, look.unseen_share).unseen
    assert attack_appearance(g, mesh, look, unseen, 200).violations == []


def test_a_false_promise_is_found() -> None:
    g = _batch(add_torus)
    look = Appearance(False, "curvature")
    mesh = tessellate(g, 0.05, appearance=look)
    lie = replace(mesh, appearance_error=0.25 * mesh.appearance_error)
    unseen = attribute_tables(g, mean_curvature, look.unseen_share).unseen
    assert len(attack_appearance(g, lie, look, unseen, 400).violations) == 1


def test_what_was_not_asked_for_is_not_certified() -> None:
    g = _batch(add_torus)
    assert len(tessellate(g, 0.05, appearance=Appearance(False, "curvature")).normal_error) == 0
    assert tessellate(g, 0.05, appearance=Appearance()).normal_error[0] > 0.0


def test_what_makes_no_sense_is_refused() -> None:
    for bad in ({"unseen_deg": -1.0}, {"unseen_share": np.nan}, {"attribute": "taste"}):
        with pytest.raises(UsageError):
            Appearance(**bad)  # type: ignore[arg-type]
    g = _batch(add_plane)
    with pytest.raises(UsageError, match="finite"):
        tessellate(g, 0.1, appearance=Appearance(attribute=lambda _g, _r, uv: uv[:, 0] * np.nan))
    outside = SurfaceForm.nurbs(1, 1, [9, 9, 10, 10], [9, 9, 10, 10], np.zeros((2, 2, 3)))
    with pytest.raises(UsageError, match="must be a finite, continuous B-spline"):
        tessellate(g, 0.1, appearance=Appearance(attribute={0: outside}))
