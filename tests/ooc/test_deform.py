"""A face with moved control points: the bound holds on the moved surface, seams and poles open and close."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import ON_SURFACE, POLE, FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_face, add_patch, add_polygon_trimmed, uniform_knots
from nurbs_ooc.geometry.surface import evaluate
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.tessellation.deform import deformed_face, tessellate_deformed
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.nets import as_nurbs

Array = npt.NDArray[np.float64]
EYE = np.eye(3)


def flat_net(n: int, size: float = 10.0) -> Array:
    x, y = np.meshgrid(np.linspace(0, size, n), np.linspace(0, size, n), indexing="ij")
    return np.stack([x, y, np.zeros_like(x)], axis=2)


def bumped(net: Array, seed: int = 1) -> Array:
    return net + np.random.default_rng(seed).normal(size=net.shape) * [0.1, 0.1, 0.6]


def patch(net: Array, weights: Array | None = None) -> GeometryBatch:
    builder = BatchBuilder()
    add_patch(builder, 3, 2, net, weights)
    return builder.build()


def euler(mesh: MeshBatch) -> tuple[int, int]:
    """Euler number and number of open edges after welding equal positions."""
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    edges, count = np.unique(
        np.sort(np.concatenate([t[:, :2], t[:, 1:], t[:, ::2]]), axis=1), axis=0, return_counts=True
    )
    return len(np.unique(t)) - len(edges) + len(t), int((count == 1).sum())


def check(geometry: GeometryBatch, mesh: MeshBatch, error: float) -> None:
    """The promise against the independent attack, on a batch that was built with the moved net."""
    assert mesh.certified_error.max() <= error
    assert (mesh.status == FaceStatus.EXACT).all()
    assert attack_mesh(geometry, mesh, 3000, requested=error).violations == []


@pytest.mark.parametrize("rational", [False, True])
def test_bound_holds_on_a_freshly_built_batch_with_that_net(rational: bool) -> None:
    net = bumped(flat_net(8))
    weights = np.random.default_rng(2).uniform(0.3, 3.0, (8, 8)) if rational else None
    mesh = tessellate_deformed(patch(flat_net(8), weights), 0, net, 1e-3)
    fresh = patch(net, weights)
    check(fresh, mesh, 1e-3)
    assert mesh.pcurve_error.max() == 0.0
    assert len(mesh.triangles) < 1.2 * len(tessellate(fresh, 1e-3).triangles)


def test_weights_move_too() -> None:
    net = bumped(flat_net(6))
    weights = np.random.default_rng(3).uniform(0.2, 5.0, (6, 6))
    homogeneous = np.concatenate([net * weights[..., None], weights[..., None]], axis=2)
    mesh = tessellate_deformed(patch(flat_net(6)), 0, homogeneous, 1e-3)
    check(patch(net, weights), mesh, 1e-3)


def test_hyperbolic_paraboloid_in_closed_form() -> None:
    corners = flat_net(2, 1.0)
    geometry = BatchBuilder()
    add_patch(geometry, 1, 1, corners)
    moved = corners.copy()
    moved[1, 1, 2] = 1.0
    mesh = tessellate_deformed(geometry.build(), 0, moved, 1e-3)
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), 20)
    p = np.einsum("nk,tki->tni", weights, mesh.positions[mesh.triangles]).reshape(-1, 3)
    assert np.abs(p[:, 2] - p[:, 0] * p[:, 1]).max() <= np.sqrt(3.0) * 1e-3  # |grad (z - x y)| <= sqrt 3
    areas = np.cross(*(mesh.positions[mesh.triangles[:, i]] - mesh.positions[mesh.triangles[:, 0]] for i in (1, 2)))
    assert 0.5 * np.linalg.norm(areas, axis=1).sum() == pytest.approx(1.2807892753, abs=2e-3)


def test_trimmed_face_keeps_its_pcurves() -> None:
    square = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])
    hole = np.array([[0.4, 0.3], [0.5, 0.7], [0.7, 0.5]])
    knots_u, knots_v = uniform_knots(8, 3), uniform_knots(8, 2)

    def trimmed(net: Array) -> GeometryBatch:
        builder = BatchBuilder()
        add_polygon_trimmed(builder, SurfaceForm.nurbs(3, 2, knots_u, knots_v, net), [square, hole])
        return builder.build()

    net = bumped(flat_net(8))
    mesh = tessellate_deformed(trimmed(flat_net(8)), 0, net, 1e-3)
    check(trimmed(net), mesh, 1e-3)
    assert euler(mesh)[0] == 0
    rim = np.unique(mesh.segments)
    on_surface = evaluate(trimmed(net), 0, mesh.parameters[rim])[0]
    assert np.abs(on_surface - mesh.positions[rim]).max() < 1e-6  # grid points lie on a lattice of 2^-29
    for corner in np.concatenate([square, hole]):
        assert np.abs(mesh.parameters[rim] - corner).max(axis=1).min() < 1e-7


def test_one_face_of_several_is_returned_under_its_row() -> None:
    builder = BatchBuilder()
    for k in range(3):
        add_patch(builder, 3, 2, flat_net(6) + np.array([0.0, 0.0, k]))
    mesh = tessellate_deformed(builder.build(), 1, bumped(flat_net(6)), 1e-2)
    assert mesh.faces.tolist() == [1]
    assert np.array_equal(
        mesh.positions, tessellate_deformed(patch(flat_net(6)), 0, bumped(flat_net(6)), 1e-2).positions
    )


def cylinder() -> GeometryBatch:
    form = SurfaceForm.framed(SurfaceKind.CYLINDER, np.zeros(3), *EYE, domain=(0.0, 2 * np.pi, 0.0, 1.0))
    builder = BatchBuilder()
    add_face(builder, as_nurbs(form))
    return builder.build()


def net_of(geometry: GeometryBatch) -> Array:
    s = geometry.surfaces[0]
    n = int(s["n_u"] * s["n_v"]) * (4 if s["rational"] else 3)
    return geometry.values[s["points"] : s["points"] + n].reshape(s["n_u"], s["n_v"], -1).copy()


def test_a_seam_stays_closed_while_both_sides_move_alike_and_opens_when_they_do_not() -> None:
    geometry = cylinder()
    net = net_of(geometry)
    scaled = net * [2.0, 2.0, 2.0, 1.0]
    assert euler(tessellate_deformed(geometry, 0, scaled, 1e-2))[0] == 0
    opened = scaled.copy()
    opened[-1, :, 2] += 0.5 * opened[-1, :, 3]
    face = deformed_face(geometry, 0, opened)
    assert len(face.edges) == 4 and not face.coedges["seam"].any() and len(face.vertices) == 4
    mesh = tessellate_deformed(geometry, 0, opened, 1e-2)
    assert euler(mesh)[0] == 1
    assert mesh.certified_error.max() <= 1e-2


def test_a_side_shrinks_to_a_pole_and_a_pole_opens() -> None:
    net = flat_net(6)
    collapsed = net.copy()
    collapsed[0] = collapsed[0, 0]
    face = deformed_face(patch(net), 0, collapsed)
    assert sorted(face.edges["curve"].tolist()) == [ON_SURFACE] * 3 + [POLE]
    assert len(face.vertices) == 3
    mesh = tessellate_deformed(patch(net), 0, collapsed, 1e-3)
    check(patch(collapsed), mesh, 1e-3)
    back = deformed_face(patch(collapsed), 0, net)
    assert (back.edges["curve"] == ON_SURFACE).all() and len(back.vertices) == 4
    check(patch(net), tessellate_deformed(patch(collapsed), 0, net, 1e-3), 1e-3)


def test_the_original_is_left_alone() -> None:
    geometry = patch(flat_net(6))
    before = geometry.to_bytes()
    tessellate_deformed(geometry, 0, bumped(flat_net(6)), 1e-2)
    assert geometry.to_bytes() == before


def with_entry(value: float, column: int) -> Array:
    net = np.concatenate([flat_net(6), np.ones((6, 6, 1))], axis=2)
    net[2, 3, column] = value
    return net


@pytest.mark.parametrize(
    ("net", "words"),
    [
        (flat_net(5), r"shape \(5, 5, 3\), must be \(6, 6, 3 or 4\)"),
        (flat_net(6)[..., :2], r"shape \(6, 6, 2\)"),
        (with_entry(np.nan, 0), r"control point \(2, 3\) .* not finite"),
        (with_entry(np.inf, 3), r"control point \(2, 3\) .* not finite"),
        (with_entry(0.0, 3), r"control point \(2, 3\) .* weight 0.0, must be above 0"),
        (with_entry(-1.0, 3), r"weight -1.0, must be above 0"),
    ],
)
def test_bad_nets_are_refused(net: Array, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        tessellate_deformed(patch(flat_net(6)), 0, net, 1e-2)


def test_what_has_no_control_points_is_refused() -> None:
    builder = BatchBuilder()
    add_cylinder(builder)
    with pytest.raises(UsageError, match="surface 0 is a CYLINDER"):
        tessellate_deformed(builder.build(), 0, flat_net(6), 1e-2)
    with pytest.raises(UsageError, match="outside 0"):
        tessellate_deformed(builder.build(), 4, flat_net(6), 1e-2)
