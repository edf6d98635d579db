"""Where a surface has several normals at a point, each triangle's corner has the one of its own side or direction."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.export.part_mesh import part_mesh
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_cone, add_face, add_sphere
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.catalogue import CASES
from tests.hard.nets import as_nurbs

Array = npt.NDArray[np.float64]

FOLDS = np.array([[0, 0, 0], [1, 1, 0], [2, 0, 0], [3, 1, 0.0]])


def batch_of(form: SurfaceForm) -> GeometryBatch:
    builder = BatchBuilder()
    add_face(builder, form)
    return builder.build()


def folded_sheet(extruded: bool) -> GeometryBatch:
    """Three strips at right angles, as a B-spline of degree 1 or as an extruded profile."""
    knots = np.array([0, 0, 1 / 3, 0.9, 1, 1.0])
    if extruded:
        profile = CurveForm.nurbs(1, knots, FOLDS)
        form = SurfaceForm.framed(SurfaceKind.EXTRUSION, np.zeros(3), *np.eye(3), profile=profile, domain=(0, 1, 0, 2))
        return batch_of(form)
    net = np.stack([FOLDS, FOLDS + np.array([0, 0, 2.0])], axis=1)
    return batch_of(SurfaceForm.nurbs(1, 1, knots, np.array([0, 0, 1, 1.0]), net))


def facet_normals(mesh: MeshBatch) -> Array:
    p = mesh.positions[mesh.triangles]
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.asarray(cross / np.linalg.norm(cross, axis=1)[:, None])


@pytest.mark.parametrize("extruded", [False, True])
def test_folds_are_sharp(extruded: bool) -> None:
    mesh = tessellate(folded_sheet(extruded), 1e-3)
    cosine = np.einsum("tk,tik->ti", facet_normals(mesh), mesh.normals[mesh.triangles])
    assert cosine.min() > 1.0 - 1e-12
    # Two normals at each fold, and no more vertices than that: four lines of points, the inner two twice.
    places = np.unique(mesh.positions, axis=0)
    assert len(mesh.positions) == len(places) + (np.abs(places[:, :1] - [1.0, 2.0]) < 1e-7).sum()


def test_a_smooth_knot_of_full_multiplicity_is_not_split() -> None:
    points = np.array([[0, 0, 0], [1, 1, 0], [2, 1, 0], [3, 1, 0], [4, 0, 0.0]])
    net = np.stack([points, points + np.array([0, 0, 2.0])], axis=1)
    knots = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1.0])
    mesh = tessellate(batch_of(SurfaceForm.nurbs(2, 1, knots, np.array([0, 0, 1, 1.0]), net)), 1e-3)
    assert len(np.unique(mesh.positions, axis=0)) == len(mesh.positions)


@pytest.mark.parametrize("rational", [False, True])
def test_every_corner_at_an_apex_has_the_normal_of_its_direction(rational: bool) -> None:
    half = 0.5
    builder = BatchBuilder()
    add_cone(builder, 1.0, half)
    geometry = builder.build()
    if rational:
        domain = (0.0, 2 * np.pi, 0.0, 1.0 / np.sin(half))
        geometry = batch_of(
            as_nurbs(SurfaceForm.framed(SurfaceKind.CONE, np.zeros(3), *np.eye(3), 1.0, -half, domain=domain))
        )
    mesh = tessellate(geometry, 1e-2)
    apex = np.array([0.0, 0.0, 1.0 / np.tan(half)])
    p = mesh.positions[mesh.triangles]
    at_apex = np.linalg.norm(p - apex, axis=2) < 1e-9
    fan, corner = np.nonzero(at_apex)
    assert len(fan) >= 8
    others = (p.sum(axis=1) - apex)[fan] / 2.0
    turn = np.arctan2(others[:, 1], others[:, 0])
    expected = np.stack([np.cos(half) * np.cos(turn), np.cos(half) * np.sin(turn), np.full(len(turn), np.sin(half))], 1)
    normals = mesh.normals[mesh.triangles[fan, corner]]
    # Half way in u is half way in angle on the tagged cone; a rational parametrisation is a little off.
    assert np.einsum("ni,ni->n", expected, normals).min() > np.cos(np.radians(2.0 if rational else 1e-3))
    assert len({tuple(x) for x in mesh.positions[mesh.triangles[fan, corner]]}) == 1


def test_a_smooth_pole_has_one_normal() -> None:
    builder = BatchBuilder()
    add_sphere(builder)
    mesh = tessellate(builder.build(), 1e-2)
    at_pole = np.abs(np.abs(mesh.positions[:, 2]) - 1.0) < 1e-12
    assert at_pole.sum() == (np.abs(np.abs(mesh.parameters[:, 1]) - np.pi / 2) < 1e-9).sum() >= 2
    places_in_u = mesh.parameters[at_pole]
    assert len(np.unique(places_in_u, axis=0)) == len(places_in_u)  # no corner has got a vertex of its own
    assert np.abs(np.linalg.norm(mesh.positions, axis=1) - 1).max() < 1e-12
    assert np.einsum("ni,ni->n", mesh.positions, mesh.normals).min() > 1.0 - 1e-12


@pytest.mark.parametrize("name", ["lemon", "rational_lemon", "half_torus"])
def test_split_vertices_leave_solids_closed(name: str) -> None:
    geometry = CASES[name].geometry()
    part = part_mesh(tessellate(geometry, 1e-2), np.zeros(len(geometry), np.int64))
    assert (part.boundary_edges, part.nonmanifold_edges) == (0, 0)


def test_a_steep_step_between_close_knots_is_drawn() -> None:
    # The wall is 8 mm high and takes 1e-4 of the parameters; its ends are kinks.
    step = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 8], [8, 0, 8.0]])
    net = np.stack([step, step + np.array([0, 1.0, 0])], axis=1)
    knots = np.array([0, 0, 0.5, 0.5001, 1, 1.0])
    mesh = tessellate(batch_of(SurfaceForm.nurbs(1, 1, knots, np.array([0, 0, 1, 1.0]), net)), 0.1)
    p = mesh.positions[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum()
    assert area == pytest.approx(16.0, abs=1e-6)
    assert len(mesh.triangles) < 200 and mesh.certified_error.max() <= 0.1
