"""Every kind of surface, against the kernel's own evaluation and the layouts' formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from OCP.BRep import BRep_Tool

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.readers.part_geometry import part_geometry
from tests.ooc.kernel_shapes import SURFACES, face_of, offset_of, spline_surface
from tests.ooc.native_forms import edge_gap, loop_jump, loops_of, surface_points


def recorded(face: Any) -> GeometryBatch:
    """The one face as a batch."""
    return part_geometry(face, [0], "test")


def samples(box: Any, n: int = 60) -> Any:
    random = np.random.default_rng(5).uniform(size=(n, 2))
    return np.array([box[0], box[2]]) + random * np.array([box[1] - box[0], box[3] - box[2]])


def kernel_points(surface: Any, uv: Any) -> Any:
    return np.array([surface.Value(float(u), float(v)).Coord() for u, v in uv])


@pytest.mark.parametrize("name", SURFACES)
def test_same_points_at_same_parameters(name: str) -> None:
    make, box = SURFACES[name]
    face = face_of(make(), box)
    batch = recorded(face)
    assert len(batch) == 1
    s = batch.surfaces[0]
    assert (s["status"], s["reason"]) == (FaceStatus.EXACT, FaceReason.NONE), batch.sources
    np.testing.assert_allclose([s["u0"], s["u1"], s["v0"], s["v1"]], box, atol=1e-9)
    uv = samples(box)
    expected = kernel_points(BRep_Tool.Surface_s(face), uv)
    np.testing.assert_allclose(surface_points(batch, 0, uv), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", SURFACES)
def test_loops_close_and_lie_on_their_edges(name: str) -> None:
    make, box = SURFACES[name]
    batch = recorded(face_of(make(), box))
    assert edge_gap(batch, 0) <= 1.0
    assert loop_jump(batch, 0) < 1e-9
    used = np.bincount(np.concatenate(loops_of(batch, 0))["edge"])
    seams = {int(c["edge"]) for c in batch.coedges if c["seam"]}
    assert seams == set(np.flatnonzero(used == 2))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("cylinder", SurfaceKind.CYLINDER),
        ("extruded B-spline", SurfaceKind.EXTRUSION),
        ("revolved arc", SurfaceKind.REVOLUTION),
        ("Bezier", SurfaceKind.NURBS),
        ("offset cone", SurfaceKind.CONE),
        ("trimmed cylinder", SurfaceKind.CYLINDER),
        ("offset plane", SurfaceKind.PLANE),
    ],
)
def test_native_kind_is_kept(name: str, kind: SurfaceKind) -> None:
    make, box = SURFACES[name]
    assert recorded(face_of(make(), box)).surfaces[0]["kind"] == kind


def test_full_sphere_has_poles_and_a_seam() -> None:
    make, box = SURFACES["sphere"]
    batch = recorded(face_of(make(), box))
    assert batch.coedges["pole"].sum() == 2
    assert batch.coedges["seam"].sum() == 2
    assert (batch.edges["curve"] < 0).sum() == 2


def test_polynomial_stays_polynomial() -> None:
    make, box = SURFACES["B-spline"]
    assert not recorded(face_of(make(), box)).surfaces[0]["rational"]


def test_free_form_offset_is_approximated_within_the_stated_error() -> None:
    surface, box = offset_of(spline_surface(), 0.5), (0.0, 5.0, 0.0, 3.0)
    face = face_of(surface, box)
    batch = recorded(face)
    s = batch.surfaces[0]
    assert (s["status"], s["reason"]) == (FaceStatus.HEALED, FaceReason.OFFSET_APPROXIMATED)
    assert 0.0 < s["approximation_error"] < 2e-2
    uv = samples(box, 400)
    gaps = np.linalg.norm(surface_points(batch, 0, uv) - kernel_points(surface, uv), axis=1)
    assert gaps.max() <= s["approximation_error"]
