"""Triangles of surfaces whose area, volume and distance are known in closed form."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.sample_faces import (
    add_cone,
    add_cylinder,
    add_face,
    add_patch,
    add_plane,
    add_sphere,
    add_torus,
    uniform_knots,
)
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.tessellation.face_runs import MOST_FACES
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import Tessellator, tessellate

ERRORS = (0.1, 1e-2, 1e-3)


def _batch(*adds: Callable[[BatchBuilder], int]) -> GeometryBatch:
    builder = BatchBuilder()
    for add in adds:
        add(builder)
    return builder.build()


def _area(mesh: MeshBatch) -> float:
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _volume(mesh: MeshBatch) -> float:
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def _edge_counts(mesh: MeshBatch) -> np.ndarray:
    """How many triangles meet at each edge after welding equal positions."""
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def _inside_triangles(mesh: MeshBatch, n: int) -> np.ndarray:
    """``n`` random points of every triangle."""
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), n)
    return np.einsum("nk,tkd->tnd", weights, mesh.positions[mesh.triangles]).reshape(-1, 3)


@pytest.mark.parametrize("error", ERRORS)
def test_sphere_is_closed_and_within_the_error(error: float) -> None:
    mesh = tessellate(_batch(add_sphere), error)
    assert (_edge_counts(mesh) == 2).all()
    assert mesh.certified_error.max() <= error
    depth = 1.0 - np.linalg.norm(_inside_triangles(mesh, 8), axis=1)
    assert depth.min() >= -1e-12
    assert depth.max() <= mesh.certified_error.max()
    # Euler 2, and no more volume lost than the error allows.
    counts = _edge_counts(mesh)
    corners = len(np.unique(mesh.positions[mesh.triangles.reshape(-1)], axis=0))
    assert corners - len(counts) + len(mesh.triangles) == 2
    assert 4 * math.pi / 3 * (1 - error) ** 3 <= _volume(mesh) <= 4 * math.pi / 3


@pytest.mark.parametrize("error", ERRORS)
def test_torus_is_closed_and_within_the_error(error: float) -> None:
    mesh = tessellate(_batch(add_torus), error)
    assert (_edge_counts(mesh) == 2).all()
    p = _inside_triangles(mesh, 8)
    off = np.abs(np.hypot(np.hypot(p[:, 0], p[:, 1]) - 2.0, p[:, 2]) - 0.5)
    assert off.max() <= mesh.certified_error.max() <= error
    assert abs(_area(mesh) / (4 * math.pi**2 * 2.0 * 0.5) - 1) < 4 * error


def test_cylinder_costs_what_its_circle_costs() -> None:
    mesh = tessellate(_batch(add_cylinder), 1e-3)
    needed = math.pi / math.acos(1 - 1e-3)
    assert len(mesh.triangles) <= 2 * (needed + 2)
    p = _inside_triangles(mesh, 8)
    assert (1.0 - np.hypot(p[:, 0], p[:, 1])).max() <= mesh.certified_error.max() <= 1e-3


def test_cone_to_its_apex() -> None:
    mesh = tessellate(_batch(add_cone), 1e-3)
    assert mesh.certified_error.max() <= 1e-3
    assert np.isfinite(mesh.normals).all()
    assert len(mesh.triangles) < 100
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


def test_plane_is_two_triangles() -> None:
    mesh = tessellate(_batch(add_plane), 1e-6)
    assert len(mesh.triangles) == 2
    assert _area(mesh) == 1.0


def test_hyperbolic_paraboloid_needs_its_vertical_error() -> None:
    # z = xy: two triangles are off by exactly 1/4.
    points = np.array([[[x, y, x * y] for y in (0.0, 1.0)] for x in (0.0, 1.0)])
    batch = _batch(lambda b: add_patch(b, 1, 1, points))
    assert len(tessellate(batch, 0.26).triangles) == 2
    fine = tessellate(batch, 1e-3)
    p = _inside_triangles(fine, 8)
    assert np.abs(p[:, 2] - p[:, 0] * p[:, 1]).max() <= fine.certified_error.max() <= 1e-3
    assert abs(_area(tessellate(batch, 1e-4)) - 1.2807892753) < 2e-4


@pytest.mark.parametrize("kind", [SurfaceKind.CONE, SurfaceKind.SPHERE, SurfaceKind.TORUS])
def test_boundary_aslant_on_a_surface_of_revolution_keeps_its_bound(kind: SurfaceKind) -> None:
    # The 3D edges are chords with no error of their own: only the p-curve's image leaves them, sideways too.
    form = SurfaceForm.framed(kind, (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), 5.4, 1.18, domain=(0.0, 0.5, -1.0, 0.5))
    corners = np.array([[0.0, -0.9], [0.5, -0.9], [0.04, 0.0]])
    builder = BatchBuilder()
    builder.surface(form)
    places = np.array([_on_turned(kind, 5.4, 1.18, u, v) for u, v in corners])
    vertices = [builder.vertex(p) for p in places]
    coedges = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        edge = builder.edge(CurveForm.line(places[i], places[j]), vertices[i], vertices[j])
        coedges.append(Coedge(edge, CurveForm.line(corners[i], corners[j])))
    builder.loop(coedges)
    batch = builder.build()
    for error in (0.1, 0.03, 0.004):
        mesh = tessellate(batch, error)
        report = attack_mesh(batch, mesh, samples=4000)
        assert not report.violations


def _on_turned(kind: SurfaceKind, a: float, b: float, u: float, v: float) -> tuple[float, float, float]:
    rho, z = {
        SurfaceKind.CONE: (a + v * math.sin(b), v * math.cos(b)),
        SurfaceKind.SPHERE: (a * math.cos(v), a * math.sin(v)),
        SurfaceKind.TORUS: (a + b * math.cos(v), b * math.sin(v)),
    }[kind]
    return rho * math.cos(u), rho * math.sin(u), z


def test_result_does_not_depend_on_workers_or_on_the_faces_asked_for() -> None:
    batch = _batch(*[add_sphere, add_torus, add_cylinder] * 30)
    one, two = tessellate(batch, 1e-2), tessellate(batch, 1e-2, workers=2)
    assert np.array_equal(one.positions, two.positions)
    assert np.array_equal(one.triangles, two.triangles)
    rows = np.array([70, 1, 5])
    some = tessellate(batch, 1e-2, faces=rows)
    for i, row in enumerate(rows):
        mine = some.positions[some.triangles[some.triangle_start[i] : some.triangle_start[i + 1]]]
        whole = one.positions[one.triangles[one.triangle_start[row] : one.triangle_start[row + 1]]]
        assert np.array_equal(mine, whole)


def _equal(a: MeshBatch, b: MeshBatch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(MeshBatch))


def test_more_faces_than_a_chunk_has() -> None:
    builder = BatchBuilder()
    for _ in range(MOST_FACES + 100):
        add_plane(builder)
    batch = builder.build()
    one, two = tessellate(batch, 1e-2), tessellate(batch, 1e-2, workers=2)
    assert _equal(one, two)
    alone = _batch(add_plane)
    area = _area(tessellate(alone, 1e-2))
    assert area > 0.0
    assert _area(one) == pytest.approx(len(batch) * area, rel=1e-9)


@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_while_compiled_code_runs_is_an_interrupt(workers: int) -> None:
    code = (
        "import os, signal, sys, threading, time\n"
        "from nurbs_ooc.synth.car_body import car_body\n"
        "from nurbs_ooc.tessellation.tessellate import tessellate\n"
        "g, workers = car_body(), int(sys.argv[1])\n"
        "tessellate(g, 5.0, workers=workers)\n"
        "threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "try: tessellate(g, 0.01, workers=workers)\n"  # about two seconds
        "except KeyboardInterrupt: print('interrupted')\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(workers)], check=False, capture_output=True, text=True)
    assert done.stdout == "interrupted\n", done.stderr


def add_strips(builder: BatchBuilder) -> int:
    """A wavy patch with knots so close together that they matter to small errors alone."""
    knots_u = np.array([0, 0, 0, 0, 0.25, 0.4999, 0.49995, 0.5, 0.75, 1, 1, 1, 1])
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 5), indexing="ij")
    net = np.stack([x, y, np.sin(7.0 * x * y)], axis=2)
    return add_face(builder, SurfaceForm.nurbs(3, 3, knots_u, uniform_knots(5, 3), net))


def test_a_tessellator_gives_what_single_calls_do() -> None:
    batch = _batch(add_sphere, add_strips, add_cylinder, add_strips)
    tessellator = Tessellator(batch)
    meshes = {}
    for error in (10.0, 1e-4, 0.1, 10.0, 1e-3):
        meshes[error], alone = tessellator.mesh(error), tessellate(batch, error)
        for field in dataclasses.fields(MeshBatch):
            assert np.array_equal(getattr(meshes[error], field.name), getattr(alone, field.name)), (error, field.name)
    assert len(meshes[10.0].triangles) < len(meshes[0.1].triangles) < len(meshes[1e-4].triangles)


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_rational_patch_within_its_bound(degree: int) -> None:
    rng = np.random.default_rng(degree)
    grid = np.stack(np.meshgrid(np.arange(degree + 4.0), np.arange(degree + 3.0), indexing="ij"), axis=2)
    points = np.concatenate([grid, rng.normal(0, 0.5, (*grid.shape[:2], 1))], axis=2)
    batch = _batch(lambda b: add_patch(b, degree, degree, points, rng.uniform(0.5, 2.0, grid.shape[:2])))
    mesh = tessellate(batch, 0.02)
    assert mesh.status[0] == FaceStatus.EXACT
    assert mesh.certified_error[0] <= 0.02


@pytest.mark.parametrize("error", [0.0, -1.0, math.nan, math.inf])
def test_senseless_errors_are_refused(error: float) -> None:
    with pytest.raises(UsageError, match="chord error"):
        tessellate(_batch(add_plane), error)
