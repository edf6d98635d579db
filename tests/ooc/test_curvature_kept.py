"""Appearance with an attribute: what is promised holds, is kept on smooth faces, and is honest where it cannot be."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np
import pytest

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.curvature import mean_curvature
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_cone, add_cylinder, add_face, add_plane, add_sphere, add_torus
from nurbs_ooc.measure.attack_appearance import attack_appearance
from nurbs_ooc.measure.exact_attribute import exact_mean_curvature, precise_mean_curvature
from nurbs_ooc.readers.several import open_input
from nurbs_ooc.tessellation.appearance import Appearance
from nurbs_ooc.tessellation.attributes import attribute_tables
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.catalogue import CASES
from tests.ooc.test_shading import cusp, wave

ORIGIN, (X, Y, Z) = np.zeros(3), np.eye(3)
CURVATURE = Appearance(normals=False, attribute="curvature")


def _batch(*adds: Callable[[BatchBuilder], object]) -> GeometryBatch:
    builder = BatchBuilder()
    for add in adds:
        add(builder)
    return builder.build()


def frustum(builder: BatchBuilder) -> None:
    domain = (0.0, 2.0 * np.pi, 0.0, 1.5)
    add_face(builder, SurfaceForm.framed(SurfaceKind.CONE, ORIGIN, X, Y, Z, 1.0, -0.5, domain=domain))


SMOOTH: dict[str, Callable[[], GeometryBatch]] = {
    "torus": lambda: _batch(add_torus),
    "sphere": lambda: _batch(add_sphere),
    "rational sphere": CASES["rational_sphere"].geometry,
    "cylinder": lambda: _batch(add_cylinder),
    "frustum": lambda: _batch(frustum),
    "torus arcs": CASES["chained_torus_arcs"].geometry,
    "wave": wave,
}


def unseen(geometry: GeometryBatch, look: Appearance) -> float:
    source = mean_curvature if isinstance(look.attribute, str) else look.attribute
    return 0.0 if source is None else attribute_tables(geometry, source, look.unseen_share).unseen


def size(geometry: GeometryBatch) -> float:
    return float(np.linalg.norm(np.ptp(tessellate(geometry, 1.0).positions, axis=0)))


@pytest.mark.parametrize("share", [1e-2, 1e-3])
@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_faces_keep_it(name: str, share: float) -> None:
    g = SMOOTH[name]()
    error = share * size(g)
    mesh = tessellate(g, error, appearance=CURVATURE)
    assert mesh.status.max() == FaceStatus.EXACT
    assert mesh.appearance_error.max() <= error
    report = attack_appearance(g, mesh, CURVATURE, unseen(g, CURVATURE), 1500)
    assert report.violations == []
    # Cones without curvature take one row; with it 1/r is followed along them, and of a bicubic sheet every wave.
    most = {"frustum": 32, "wave": 8}.get(name, 3)
    assert len(mesh.triangles) < most * len(tessellate(g, error).triangles)


def test_the_measured_error_comes_near_the_promise() -> None:
    g = SMOOTH["torus"]()
    mesh = tessellate(g, 0.06, appearance=CURVATURE)
    report = attack_appearance(g, mesh, CURVATURE, unseen(g, CURVATURE), 2000)
    assert report.largest[0] > 0.5 * mesh.appearance_error[0]


def test_normals_and_curvature_together() -> None:
    look = Appearance(attribute="curvature")
    for name in ("torus", "wave", "sphere"):
        g = SMOOTH[name]()
        error = 1e-2 * size(g)
        mesh = tessellate(g, error, appearance=look)
        assert mesh.appearance_error.max() <= error
        assert attack_appearance(g, mesh, look, unseen(g, look), 1500).violations == []


def test_a_plain_mesh_does_not_keep_it_and_the_attack_says_so() -> None:
    g = SMOOTH["wave"]()
    error = 1e-2 * size(g)
    plain = tessellate(g, error)
    promised = dataclasses.replace(plain, appearance_error=np.array([error]))
    broken = attack_appearance(g, promised, CURVATURE, unseen(g, CURVATURE), 500).violations
    assert [v.kind for v in broken] == ["appearance"]
    assert broken[0].value > error
    kept = tessellate(g, error, appearance=CURVATURE)
    report = attack_appearance(g, kept, CURVATURE, unseen(g, CURVATURE), 500)
    too_good = dataclasses.replace(kept, appearance_error=0.5 * report.largest)
    assert attack_appearance(g, too_good, CURVATURE, unseen(g, CURVATURE), 500).violations


def torus_error(mesh: MeshBatch, major: float, minor: float, tolerance: float) -> float:
    """Largest shading error, mm, by the closed form of a torus's curvature and of the rate at which it changes."""

    def h(v: np.ndarray) -> np.ndarray:
        return -0.5 * (1.0 / minor + np.cos(v) / (major + minor * np.cos(v)))

    def rate(v: np.ndarray) -> np.ndarray:
        return 0.5 * major * np.abs(np.sin(v)) / (major + minor * np.cos(v)) ** 2 / minor

    v = mesh.parameters[mesh.triangles][..., 1]
    weight = np.random.default_rng(3).dirichlet((1, 1, 1), 200)
    off = np.abs(h(v @ weight.T) - h(v) @ weight.T).max(axis=1)
    along = np.linspace(v.min(axis=1), v.max(axis=1), 50, axis=1)
    return float(np.where(off > tolerance, off / rate(along).max(axis=1), 0.0).max())


def test_a_torus_by_its_closed_form() -> None:
    """Curvature is largest and smallest along whole circles; nobody may look away there."""
    g = SMOOTH["torus"]()
    for share in (1.0 / 256.0, 1e-4):
        look = dataclasses.replace(CURVATURE, unseen_share=share)
        mesh = tessellate(g, 0.03, appearance=look)
        assert mesh.status.tolist() == [FaceStatus.EXACT]
        assert torus_error(mesh, 2.0, 0.5, unseen(g, look)) <= mesh.appearance_error[0] * (1.0 + 1e-6)
        plain = tessellate(g, 0.03)
        assert torus_error(plain, 2.0, 0.5, unseen(g, look)) > 0.03


def test_extrema_of_an_attribute_end_the_refinement() -> None:
    """u^2 over a sheet around 0, to the last digit: triangles there are some errors wide, not endlessly small."""
    g = _batch(lambda b: add_plane(b, 2.0, 1.0))
    net = np.zeros((3, 2, 3))
    net[:, :, 0] = np.array([1.0, -1.0, 1.0])[:, None]
    form = SurfaceForm.nurbs(2, 1, [0, 0, 0, 2, 2, 2], [0, 0, 1, 1], net)
    look = Appearance(False, {0: form}, unseen_share=0.0)
    counts = []
    for error in (0.04, 0.01):
        mesh = tessellate(g, error, appearance=look)
        assert mesh.status.tolist() == [FaceStatus.EXACT]
        assert mesh.appearance_error.max() <= error
        assert attack_appearance(g, mesh, look, unseen(g, look), 1000).violations == []
        counts.append(len(mesh.triangles))
    assert counts[1] < 5000


def test_a_constant_costs_nothing() -> None:
    g = _batch(add_plane)
    look = Appearance(False, lambda _g, _r, uv: np.full(len(uv), 3.0), unseen_share=0.0)
    assert np.array_equal(tessellate(g, 0.01, appearance=look).triangles, tessellate(g, 0.01).triangles)


def test_vectors_and_functions_go_the_same_way() -> None:
    g = SMOOTH["torus"]()
    look = Appearance(False, lambda _g, _r, uv: np.stack([np.cos(uv[:, 1]), np.sin(uv[:, 1]), uv[:, 1] * 0], axis=1))
    mesh = tessellate(g, 0.05, appearance=look)
    assert mesh.appearance_error.max() <= 0.05
    assert attack_appearance(g, mesh, look, unseen(g, look), 1000).violations == []


@pytest.mark.parametrize("name", ["lemon", "cone", "cusp"])
def test_a_curvature_without_end_is_said(name: str) -> None:
    g = {"lemon": CASES["lemon"].geometry, "cone": lambda: _batch(add_cone), "cusp": cusp}[name]()
    d = size(g)
    error = 1e-3 * d
    mesh = tessellate(g, error, appearance=CURVATURE)
    assert mesh.status.tolist() == [FaceStatus.DEGRADED]
    assert mesh.reason.tolist() == [FaceReason.APPEARANCE_NOT_KEPT]
    assert error < mesh.appearance_error[0] < 0.1 * d
    assert mesh.certified_error[0] <= error
    assert len(mesh.triangles) < 20000
    assert attack_appearance(g, mesh, CURVATURE, unseen(g, CURVATURE), 1000).violations == []


def test_a_real_screw(data_file: Callable[[str], Path]) -> None:
    """Tori of a fillet, cones and a cylinder; half of them once came out degraded, with metres of error."""
    with open_input(data_file("occt_screw.step")) as assembly:
        (part,) = assembly.parts()
    mesh = tessellate(part.geometry, 0.1, appearance=CURVATURE)
    assert mesh.status.max() <= FaceStatus.HEALED
    assert mesh.appearance_error.max() <= 0.1
    assert len(mesh.triangles) < 2500
    report = attack_appearance(part.geometry, mesh, CURVATURE, unseen(part.geometry, CURVATURE), 500)
    assert report.violations == []


def test_curvatures_agree_with_closed_forms() -> None:
    """The tessellator's, the attack's and that of 50 digits, on a torus."""
    g = SMOOTH["torus"]()
    uv = np.random.default_rng(2).uniform(0.1, 6.1, (40, 2))
    with mpmath.workdps(50):
        true = np.array([
            float(-(2 + mpmath.cos(v) * mpmath.mpf("0.5") * 2) / (2 * mpmath.mpf("0.5") * (2 + mpmath.cos(v) / 2)))
            for v in uv[:, 1]
        ])  # fmt: skip
    assert mean_curvature(g, 0, uv) == pytest.approx(true, rel=1e-6)
    assert exact_mean_curvature(g, 0, uv) == pytest.approx(true, rel=1e-6)
    for (u, v), h in zip(uv[:5], true[:5], strict=True):
        assert precise_mean_curvature(g, 0, u, v, 50) == pytest.approx(h, rel=1e-12)
