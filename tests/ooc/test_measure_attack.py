"""The attacker must find every planted fault and none in honest meshes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.measure.attack_mesh import AttackReport, attack_mesh
from nurbs_ooc.tessellation.mesh import MeshBatch
from tests.ooc.measure_shapes import Shape, grid_mesh, mesh_of, octasphere, random_nurbs, sagitta, sphere


def _kinds(report: AttackReport) -> set[str]:
    return {v.kind for v in report.violations}


@pytest.mark.parametrize("levels", [1, 3, 5])
def test_sphere_measures_its_sagitta(levels: int) -> None:
    v, t = octasphere(10.0, levels)
    truth = sagitta(10.0, v, t)
    report = attack_mesh(sphere(), mesh_of(v, t, truth), samples=2000)
    assert report.violations == []
    assert report.measured[0] == pytest.approx(truth, rel=2e-2)
    assert report.measured[0] <= truth * (1 + 1e-9)
    assert report.mesh_to_surface_max[0] == pytest.approx(truth, rel=2e-2)


@pytest.mark.parametrize("levels", [1, 3, 5])
def test_a_promise_a_little_too_small_is_broken(levels: int) -> None:
    v, t = octasphere(10.0, levels)
    report = attack_mesh(sphere(), mesh_of(v, t, 0.95 * sagitta(10.0, v, t)), samples=2000)
    assert _kinds(report) == {"surface to mesh", "mesh to surface"}


def test_the_climb_reaches_what_few_samples_miss() -> None:
    v, t = octasphere(10.0, 3)
    report = attack_mesh(sphere(), mesh_of(v, t, 1.0), samples=40)
    a, b, c = v[t].transpose(1, 0, 2)
    n = np.cross(b - a, c - a)
    depth = 10.0 - np.abs((n * a).sum(1)) / np.linalg.norm(n, axis=1)  # of the sphere over each triangle
    assert np.abs(depth - report.surface_to_mesh_max[0]).min() < 1e-3 * depth.max()


def _displaced(mesh: MeshBatch) -> MeshBatch:
    p = mesh.positions.copy()
    p[len(p) // 2] += [0.0, 0.0, 3.0]
    return dataclasses.replace(mesh, positions=p)


def _with_a_hole(mesh: MeshBatch) -> MeshBatch:
    i, j = np.divmod(np.arange(61 * 61), 61)  # of a 60 x 60 grid
    gone = np.flatnonzero((abs(i - 20) < 5) & (abs(j - 30) < 5))
    t = mesh.triangles[~np.isin(mesh.triangles, gone).any(1)]
    return dataclasses.replace(mesh, triangles=t, triangle_start=np.array([0, len(t)]))


@pytest.mark.parametrize(("spoil", "kind"), [(_displaced, "mesh to surface"), (_with_a_hole, "surface to mesh")])
@pytest.mark.parametrize("rational", [False, True])
def test_planted_faults_are_found(spoil: object, kind: str, rational: bool) -> None:
    g = random_nurbs(np.random.default_rng(4), (3, 2), (7, 6), rational)
    honest = grid_mesh(g, 60, 60, 0.12)
    assert attack_mesh(g, honest, samples=500).violations == []
    found = attack_mesh(g, spoil(honest), samples=3000).violations  # type: ignore[operator]
    assert kind in {v.kind for v in found}
    assert all(v.value > v.limit for v in found)


def _holed_plate() -> GeometryBatch:
    shape = Shape()
    shape.polygon([[0, 0], [10, 0], [10, 10], [0, 10]])
    shape.loop([shape.conic(CurveKind.ELLIPSE, [5, 5], [3, 0], [0, 3], 0.0, 2 * math.pi)])
    shape.analytic(SurfaceKind.PLANE, (0, 10, 0, 10))
    return shape.batch()


def _plate_mesh(radius: float, error: float) -> MeshBatch:
    """The plate with a polygonal hole of this radius: rings of 96 vertices, square outside."""
    angle = np.arange(96) * 2 * math.pi / 96
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    outer = 5 * ring / np.abs(ring).max(1)[:, None]
    uv = np.concatenate([radius * ring, outer]) + 5
    i, j = np.arange(96), (np.arange(96) + 1) % 96
    t = np.concatenate([np.stack([i, i + 96, j + 96], 1), np.stack([i, j + 96, j], 1)])
    up = np.tile([0.0, 0.0, 1.0], (192, 1))
    return mesh_of(np.column_stack([uv, np.zeros(192)]), t, error, uv, up)


def test_a_hole_of_the_right_size_passes() -> None:
    assert attack_mesh(_holed_plate(), _plate_mesh(3.0, 0.01), samples=1000).violations == []


@pytest.mark.parametrize(
    ("radius", "kind"), [(2.9, "mesh to surface"), (3.1, "surface to mesh"), (0.0, "mesh to surface")]
)
def test_a_hole_of_the_wrong_size_is_found(radius: float, kind: str) -> None:
    report = attack_mesh(_holed_plate(), _plate_mesh(radius, 0.01), samples=1000)
    assert _kinds(report) == {kind}
    assert report.violations[0].value == pytest.approx(abs(3 - radius), rel=0.1)


def test_lost_and_malformed_faces_are_named() -> None:
    g = _holed_plate()
    mesh = _plate_mesh(3.0, 0.01)
    lost = dataclasses.replace(mesh, triangles=mesh.triangles[:0], triangle_start=np.array([0, 0]))
    assert _kinds(attack_mesh(g, lost)) == {"lost"}
    p = mesh.positions.copy()
    p[7, 1] = np.nan
    assert _kinds(attack_mesh(g, dataclasses.replace(mesh, positions=p))) == {"not finite"}
    assert _kinds(attack_mesh(g, dataclasses.replace(mesh, triangles=mesh.triangles + 100))) == {"bad index"}


def test_flipped_triangles_and_normals_are_seen() -> None:
    g = random_nurbs(np.random.default_rng(4), (3, 2), (7, 6), False)
    mesh = grid_mesh(g, 30, 30, 0.5)
    report = attack_mesh(g, mesh)
    assert report.inverted[0] == 0
    assert report.normal_error_deg[0] < 1e-3
    flipped = dataclasses.replace(mesh, triangles=mesh.triangles[:, ::-1], normals=-mesh.normals)
    report = attack_mesh(g, flipped)
    assert report.inverted[0] > 1750
    assert report.normal_error_deg[0] > 179.9


def test_the_same_seed_finds_the_same() -> None:
    v, t = octasphere(10.0, 2)
    one, two = (attack_mesh(sphere(), mesh_of(v, t, 1.0), samples=100, seed=9).as_json() for _ in range(2))
    assert one == two
