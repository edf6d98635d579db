"""The benchmark's car body: counts, gaps, closedness and reproducibility."""

from __future__ import annotations

import dataclasses

import numpy as np

from nurbs_cache.surface_record import FaceStatus, GeometryBatch
from nurbs_ooc.geometry.curve import evaluate_curve
from nurbs_ooc.geometry.surface import evaluate
from nurbs_ooc.synth.car_body import car_body
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate


def test_counts_are_those_that_the_benchmark_asks_for() -> None:
    surfaces = car_body().surfaces
    assert len(surfaces) == 2000
    assert (surfaces["n_u"] * surfaces["n_v"]).sum() == 73 * 2000
    assert set(surfaces["degree_u"]) == set(surfaces["degree_v"]) == {3, 4, 5}
    assert abs(surfaces["rational"].mean() - 1 / 3) < 1e-3
    assert abs((surfaces["n_loops"] == 2).mean() - 1 / 3) < 1e-3


def test_the_same_seed_gives_the_same_bytes() -> None:
    assert car_body(3).to_bytes() == car_body(3).to_bytes()
    assert car_body(3).to_bytes() != car_body(4).to_bytes()


def worst_gap(geometry: GeometryBatch, face: int) -> float:
    """Largest distance of the face's edges to their p-curves on the surface, less the edges' tolerance, mm."""
    t = np.linspace(0.0, 1.0, 9)
    worst = -np.inf
    surface = geometry.surfaces[face]
    for loop in geometry.loops[surface["first_loop"] : surface["first_loop"] + surface["n_loops"]]:
        for coedge in geometry.coedges[loop["first_coedge"] : loop["first_coedge"] + loop["n_coedges"]]:
            edge = geometry.edges[coedge["edge"]]
            rows = int(coedge["pcurve"]), int(edge["curve"])
            at = [geometry.curves[row]["t0"] * (1 - t) + geometry.curves[row]["t1"] * t for row in rows]
            uv, _ = evaluate_curve(geometry, rows[0], at[0])
            on_edge, _ = evaluate_curve(geometry, rows[1], at[1])
            on_surface, _ = evaluate(geometry, face, uv)
            gap = np.linalg.norm(on_surface - on_edge, axis=1).max()
            worst = max(worst, float(gap - 1.5 * edge["tolerance"]))
    return worst


def test_pcurves_lie_on_their_edges() -> None:
    geometry = car_body()
    assert max(worst_gap(geometry, face) for face in range(0, 2000, 37)) < 1e-9
    assert np.median(geometry.edges["tolerance"]) == 0.0
    assert geometry.edges["tolerance"].max() < 5e-3


def test_closed_but_for_its_border_and_its_holes() -> None:
    geometry = car_body()
    mesh = tessellate(geometry, 0.5)
    assert (mesh.status <= FaceStatus.HEALED).all()
    points, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    triangles = weld.reshape(-1)[mesh.triangles]
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    sides, uses = np.unique(sides, axis=0, return_counts=True)
    assert set(uses) == {1, 2}
    # Free sides are those on the sheet's border and, seen from above, closed polygons around the holes.
    free = sides[uses == 1]
    size = points.max(axis=0)[:2]
    on_border = ((points[:, :2] < 1e-9) | (points[:, :2] > size - 1e-9)).any(axis=1)
    holes = ~on_border[free].all(axis=1)
    degree = np.bincount(free[holes].reshape(-1))
    assert set(degree) == {0, 2}
    assert len(np.unique(free[~holes])) == (~holes).sum()


def test_the_mesh_does_not_depend_on_threads() -> None:
    geometry = car_body()
    one = tessellate(geometry, 0.5)
    for workers in (2, 5):
        many = tessellate(geometry, 0.5, workers=workers)
        for field in dataclasses.fields(MeshBatch):
            assert np.array_equal(getattr(one, field.name), getattr(many, field.name)), field.name
