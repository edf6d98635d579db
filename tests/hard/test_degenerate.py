"""Records of which no face can be made, or hardly one: a code for each, and nothing of it in the faces beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import CurveForm
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.geometry.sample_faces import add_plane, add_sphere
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.apart import tessellate_apart
from tests.hard.catalogue import DEGENERATE
from tests.hard.splines import two_pieces
from tests.hard.variants import joined

LIMIT_S = 60  # a mesh of these is a matter of milliseconds; this only ends what does not end by itself


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Kernels are compiled, so that a child's time is its part's alone."""
    builder = BatchBuilder()
    add_plane(builder)
    tessellate(builder.build(), 1.0)


@pytest.mark.parametrize("name", DEGENERATE)
def test_bad_face_has_its_code(name: str, tmp_path: Path) -> None:
    case = DEGENERATE[name]
    geometry = case.geometry()
    mesh = tessellate_apart(geometry, 1e-2, tmp_path, LIMIT_S)
    if mesh is None:
        return
    assert mesh.status[0] != FaceStatus.EXACT
    assert mesh.reason[0] in case.reasons
    assert np.isfinite(mesh.positions).all()
    assert np.isfinite(mesh.normals).all()
    if case.flat:
        assert attack_mesh(geometry, mesh, 200).violations == []


@pytest.mark.parametrize("name", ["nan_in_a_control_point", "nan_in_an_edge", "infinite_vertex"])
def test_a_bad_face_spoils_no_other(name: str, tmp_path: Path) -> None:
    builder = BatchBuilder()
    add_sphere(builder)
    alone = builder.build()
    mesh = tessellate_apart(joined([alone, DEGENERATE[name].geometry()]), 1e-2, tmp_path, LIMIT_S)
    assert mesh is not None, "one bad face refuses the part"
    expected = tessellate(alone, 1e-2)
    end = mesh.vertex_start[1]
    assert np.array_equal(mesh.positions[:end], expected.positions)
    assert mesh.status[0] == FaceStatus.EXACT


def test_a_record_that_its_knots_tear_is_refused() -> None:
    builder = BatchBuilder()
    builder.surface(two_pieces())
    builder.loop(natural_loop(builder, two_pieces()))
    mesh = tessellate(builder.build(), 1e-2)
    assert (mesh.status[0], mesh.reason[0]) == (FaceStatus.FAILED, FaceReason.BAD_KNOTS)


def test_a_curve_of_impossible_degree_costs_its_face_alone() -> None:
    builder = BatchBuilder()
    add_plane(builder)
    add_sphere(builder)
    degree = 60
    line = np.linspace([0.0, 0.0], [1.0, 0.0], degree + 1)
    form = CurveForm.nurbs(degree, np.repeat([0.0, 1.0], degree + 1), line)
    row = builder.curve(form)
    geometry = builder.build()
    geometry.coedges["pcurve"][geometry.loops["first_coedge"][0]] = row
    mesh = tessellate(geometry, 1e-2)
    assert (mesh.status[0], mesh.reason[0]) == (FaceStatus.FAILED, FaceReason.BAD_KNOTS)
    assert mesh.status[1] == FaceStatus.EXACT
