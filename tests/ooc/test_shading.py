"""Normals and appearance as part of a tessellation's promise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_face, add_plane, add_torus
from nurbs_ooc.measure.attack_normals import attack_normals, exact_angle
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.catalogue import CASES
from tests.ooc.test_corner_normals import folded_sheet
from tests.ooc.test_normal_bound import wavy

ORIGIN, (X, Y, Z) = np.zeros(3), np.eye(3)


def _one(form: SurfaceForm) -> GeometryBatch:
    builder = BatchBuilder()
    add_face(builder, form)
    return builder.build()


def _batch(*adds: object) -> GeometryBatch:
    builder = BatchBuilder()
    for add in adds:
        add(builder)  # type: ignore[operator]
    return builder.build()


def _same(a: MeshBatch, b: MeshBatch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(MeshBatch))


def wave(seed: int = 1) -> GeometryBatch:
    return _one(wavy(3, 3, seed, False))


@pytest.mark.parametrize("degrees", [10.0, 1.0, 0.1])
def test_normals_are_kept(degrees: float) -> None:
    g = wave()
    mesh = tessellate(g, 0.5, normal_error_deg=degrees)
    assert mesh.status.max() == FaceStatus.EXACT
    assert mesh.normal_error.max() <= degrees
    report = attack_normals(g, mesh, 4000)
    assert report.violations == []
    assert report.largest.max() > 0.2 * degrees


def test_the_cost_is_that_of_a_second_order_bound() -> None:
    """A tenth of the angle takes about ten times the triangles, not a hundred."""
    counts = [len(tessellate(wave(), 10.0, normal_error_deg=d).triangles) for d in (1.0, 0.1)]
    assert 6.0 < counts[1] / counts[0] < 14.0


def test_a_cylinder_needs_few_segments() -> None:
    """Within one degree an arc may turn by 58 degrees: seven to a circle, and the chord error asks for fewer."""
    mesh = tessellate(_batch(add_cylinder), 10.0, normal_error_deg=1.0)
    assert mesh.normal_error.max() <= 1.0
    assert len(mesh.triangles) <= 24


def test_planes_cost_nothing() -> None:
    plain, kept = (tessellate(_batch(add_plane), 0.1, normal_error_deg=d) for d in (None, 0.001))
    assert np.array_equal(plain.triangles, kept.triangles)
    assert kept.normal_error.max() == 0.0
    assert len(plain.normal_error) == 0


def test_any_number_of_workers_gives_the_same() -> None:
    g = CASES["chained_torus_arcs"].geometry()
    one, two = (tessellate(g, 0.05, normal_error_deg=2.0, workers=n) for n in (1, 2))
    assert _same(one, two)


def test_neighbours_stay_joined() -> None:
    """Samples that one face asks for on a shared edge are the other's too."""
    g = CASES["half_torus"].geometry()
    mesh = tessellate(g, 1.0, normal_error_deg=1.0)
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("extruded", [False, True])
def test_creases_become_edges(extruded: bool) -> None:
    g = folded_sheet(extruded)
    mesh = tessellate(g, 1e3, normal_error_deg=0.5)
    assert mesh.normal_error.max() <= 0.5
    assert attack_normals(g, mesh, 2000).violations == []


def test_poles_have_a_bound_too() -> None:
    for name in ("sphere", "rational_sphere", "lemon", "rational_lemon", "cone", "rational_cone"):
        g = CASES[name].geometry()
        mesh = tessellate(g, 0.1, normal_error_deg=2.0)
        assert mesh.normal_error.max() <= 2.0, name
        report = attack_normals(g, mesh, 4000)
        assert report.violations == [], name


def cusp() -> GeometryBatch:
    """Two rows of control points are one point: there the normal has no limit that a patch of R could give."""
    x, y = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 4), indexing="ij")
    points = np.stack([x, y * x, 0.3 * np.sin(4 * x * y)], axis=2)
    points[0] = points[1] = 0.0
    return _one(SurfaceForm.nurbs(3, 3, [0, 0, 0, 0, 1, 1, 1, 1], [0, 0, 0, 0, 1, 1, 1, 1], points))


def test_what_cannot_be_kept_is_said() -> None:
    mesh = tessellate(cusp(), 0.1, normal_error_deg=1.0)
    assert mesh.status.tolist() == [FaceStatus.DEGRADED]
    assert mesh.reason.tolist() == [FaceReason.NORMALS_NOT_KEPT]
    assert mesh.normal_error.tolist() == [180.0]
    assert mesh.certified_error.max() <= 0.1
    assert len(mesh.triangles) < 5000


@pytest.mark.parametrize("degrees", [0.0, -1.0, 91.0, np.nan])
def test_senseless_angles_are_refused(degrees: float) -> None:
    with pytest.raises(UsageError, match="degrees"):
        tessellate(wave(), 0.1, normal_error_deg=degrees)


def test_the_attack_finds_broken_promises() -> None:
    g = _batch(add_torus)
    mesh = tessellate(g, 0.1, normal_error_deg=3.0)
    report = attack_normals(g, mesh, 2000)
    assert report.violations == []
    too_good = dataclasses.replace(mesh, normal_error=0.5 * report.largest)
    broken = attack_normals(g, too_good, 2000).violations
    assert broken
    assert broken[0].kind == "normal"
    assert "degrees" in str(broken[0])
    turned = mesh.normals.copy()
    turned[7] = np.cross(turned[7], turned[8])
    turned[7] /= np.linalg.norm(turned[7])
    assert attack_normals(g, dataclasses.replace(mesh, normals=turned), 2000).violations


def test_fifty_digits_agree_with_a_sphere() -> None:
    form = SurfaceForm.framed(SurfaceKind.SPHERE, ORIGIN, X, Y, Z, 2.0, domain=(0.0, 1.0, 0.0, 1.0))
    g = _one(form)
    uv = np.array([[0.1, 0.2], [0.4, 0.3], [0.2, 0.6]])

    def normal(u: float, v: float) -> np.ndarray:
        return np.array([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])

    drawn = np.array([normal(*p) for p in uv])
    weight = np.array([0.3, 0.3, 0.4])
    m = weight @ drawn
    angle, at = exact_angle(g, 0, uv, drawn, weight)
    assert at == pytest.approx(weight @ uv)
    assert angle == pytest.approx(np.degrees(np.arccos(m @ normal(*(weight @ uv)) / np.linalg.norm(m))), rel=1e-9)
