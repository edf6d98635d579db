"""The curves of error against cost: the meshes they compare, what they measure, and the files they write."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.accuracy.encoded import bits_for, quantisation_curve
from nurbs_ooc.accuracy.measured import measure_mesh
from nurbs_ooc.accuracy.number_types import number_curve
from nurbs_ooc.accuracy.open_cascade_mesh import build_shape, mesh_shape
from nurbs_ooc.accuracy.sampled_mesh import sampled_mesh, uniform_mesh
from nurbs_ooc.cli.main import main
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.sample_faces import add_cone, add_patch, add_polygon_trimmed, add_sphere, add_torus
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.loops import plane


def _batch(*adds: object) -> GeometryBatch:
    builder = BatchBuilder()
    for add in adds:
        add(builder)  # type: ignore[operator]
    return builder.build()


def _framed_hole(builder: BatchBuilder) -> None:
    outer = np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]])
    add_polygon_trimmed(builder, plane((0, 0), (4, 4)), [outer, 1.0 + outer[::-1] / 2])


def _ripple(builder: BatchBuilder) -> None:
    """z = 4 v (1 - v) u (1 - u)(1 - 2u): zero on the boundary and at all nine samples of the estimate."""
    points = np.zeros((4, 3, 3))
    points[..., 0], points[..., 1] = np.linspace(0, 1, 4)[:, None], np.linspace(0, 1, 3)
    points[:, 1, 2] = 2.0 * np.array([0.0, 1.0, -1.0, 0.0]) / 3.0
    add_patch(builder, 3, 2, points)


def _area(mesh: object) -> float:
    p = mesh.positions[mesh.triangles]  # type: ignore[attr-defined]
    return float(0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum())


@pytest.mark.parametrize("make", [lambda g: sampled_mesh(g, 1e-2), lambda g: uniform_mesh(g, 24)])
def test_unpromised_meshes_are_near_their_surfaces(make: object) -> None:
    geometry = _batch(add_sphere, add_torus, add_cone, _framed_hole)
    mesh = make(geometry)  # type: ignore[operator]
    found = measure_mesh(geometry, mesh, 1e-2, False, 100, 0)
    assert found.lost == 0
    assert found.largest.max() < 0.06
    expected = 4 * np.pi + 4 * np.pi**2 + np.pi / np.sin(0.5) + 12.0
    assert _area(mesh) == pytest.approx(expected, rel=0.03)


def test_trimming_of_a_regular_grid_is_exact_in_the_plane() -> None:
    assert _area(uniform_mesh(_batch(_framed_hole), 5)) == pytest.approx(12.0, rel=1e-12)


def test_an_estimate_by_samples_is_fooled_where_the_bound_is_not() -> None:
    geometry = _batch(_ripple)
    fooled = measure_mesh(geometry, sampled_mesh(geometry, 1e-3), 1e-3, False, 200, 0)
    assert fooled.largest[0] > 0.05
    kept = measure_mesh(geometry, tessellate(geometry, 1e-3), 1e-3, True, 200, 0)
    assert kept.largest[0] <= 1e-3
    assert kept.violations == 0


def test_open_cascade_gets_the_same_faces() -> None:
    geometry = _batch(add_sphere, add_torus, add_cone, _framed_hole, _ripple)
    mesh, _ = mesh_shape(build_shape(geometry), 1e-2)
    found = measure_mesh(geometry, mesh, 1e-2, False, 100, 0)
    assert found.lost == 0
    assert found.largest.max() < 0.05
    p = mesh.positions[mesh.triangles]
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    outward = np.einsum("ni,ni->n", flat, mesh.normals[mesh.triangles].sum(axis=1))
    assert (outward >= -1e-12).all()


@pytest.mark.parametrize(
    "call", [lambda g: sampled_mesh(g, 0.0), lambda g: sampled_mesh(g, np.nan), lambda g: uniform_mesh(g, 0)]
)
def test_senseless_dials_are_refused(call: object) -> None:
    with pytest.raises(UsageError, match="must be"):
        call(_batch(add_sphere))  # type: ignore[operator]


def test_a_bit_more_halves_what_quantisation_costs() -> None:
    # Many vertices, so that some come near the middle of a grid's cell whatever the grid.
    moved = np.array([p.moved_mm for p in quantisation_curve([tessellate(_batch(add_sphere), 1e-4)])])
    assert np.allclose(moved[:-1] / moved[1:], 2.0, rtol=0.1)
    mesh = tessellate(_batch(add_sphere), 1e-2)
    curve = quantisation_curve([mesh])
    assert (np.diff([p.bytes for p in curve]) > 0).all()
    bits = bits_for(mesh, 1e-2)
    assert next(p for p in curve if p.bits == bits).moved_mm <= 0.25e-2


def test_float32_fails_far_from_the_origin_unless_it_has_its_own() -> None:
    near, *_, far = number_curve([_batch(add_sphere)])
    assert near.float32_mm < 1e-6
    assert far.float32_mm > 1.0
    assert far.float32_own_origin_mm < 1e-5
    assert far.float64_mm < 1e-6


def test_the_command_writes_tables_and_a_page(small_step: Path, tmp_path: Path) -> None:
    out = tmp_path / "accuracy"
    arguments = ["accuracy", str(small_step), "-o", str(out), "--peers", "--max-triangles", "3000", "--samples", "30"]
    result = CliRunner().invoke(main, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads((out / "accuracy.json").read_text())
    assert json.loads(result.output.splitlines()[-1])["diagonal_mm"] == report["diagonal_mm"]
    names = {p["variant"] for p in report["points"]}
    assert names == {"certified", "appearance-preserving", "sampled estimate", "uniform", "Open CASCADE"}
    certified = [p for p in report["points"] if p["variant"] == "certified"]
    assert all(p["measured_max_mm"] <= p["certified_mm"] <= p["requested_mm"] for p in certified)
    assert all(p["violations"] == 0 for p in certified)
    with (out / "accuracy.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(report["points"])
    assert {"read", "tessellate", "total"} <= set(report["seconds"])
    assert (out / "accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_refuses_a_file_as_its_folder(small_step: Path, tmp_path: Path) -> None:
    target = tmp_path / "file"
    target.touch()
    result = CliRunner().invoke(main, ["accuracy", str(small_step), "-o", str(target)])
    assert result.exit_code == 2
    assert "is not a folder" in result.stderr
