"""Synthetic parts: closed where they should be, exact counts, sane orientation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.synth.arched import Arch, add_arched_panel
from nurbs_ooc.synth.baked import Baker
from nurbs_ooc.synth.brackets import bracket
from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.car_shape import GOLF, Masters
from nurbs_ooc.synth.fasteners import MAKERS, fastener
from nurbs_ooc.synth.outline import Outline
from nurbs_ooc.synth.part_draft import MIRRORED, chained, turn
from nurbs_ooc.synth.patch_grid import Division
from nurbs_ooc.synth.pressings import labels, plan_pressing
from nurbs_ooc.synth.punched import Holes
from nurbs_ooc.synth.shell import Looks, add_sheet, add_shell, offset, sheet_counts, shell_counts
from nurbs_ooc.synth.solid import SolidBuilder, Steps
from nurbs_ooc.synth.tube import add_tube, tube_counts
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate


def edge_uses(mesh: MeshBatch) -> np.ndarray:
    """How many triangles meet at each edge, after welding equal positions."""
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    sides = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def volume(mesh: MeshBatch) -> float:
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def assert_closed(geometry: GeometryBatch, error: float) -> MeshBatch:
    mesh = tessellate(geometry, error)
    assert (mesh.status == 0).all()
    assert (edge_uses(mesh) == 2).all()
    assert volume(mesh) > 0.0
    return mesh


def wavy(columns: Division, rows: Division) -> np.ndarray:
    u, v = np.meshgrid(columns.nodes(), rows.nodes(), indexing="ij")
    return np.stack([300.0 * u, 200.0 * v, 40.0 * np.sin(3.0 * u + v)], axis=2)


DIVISIONS = (
    Division(np.linspace(0.0, 1.0, 4), (8, 5, 9), (3, 1, 5)),
    Division(np.array([0.0, 0.6, 1.0]), (7, 10), (2, 7)),
)


def test_plate_with_holes_boss_and_pocket_has_its_volume() -> None:
    solid = SolidBuilder(builder := BulkBuilder())
    steps = [Steps(0, -10, ((3, 0), (3, 5), (2, 5), (2, 8))), Steps(-20, 12, ((3, 0), (3, -2)), top=False)]
    solid.plate(Outline.rectangle(60, 40, 5), 0.0, 3.0, [Outline.circle(4, -15, 0)], steps)
    mesh = assert_closed(builder.build(), 1e-3)
    area = 60 * 40 - (4 - np.pi) * 25 - np.pi * 16
    exact = 3 * area + np.pi * (9 * 5 + 4 * 3) - np.pi * 9 * 2
    assert volume(mesh) == pytest.approx(exact, rel=1e-3)


def test_ring_has_its_volume() -> None:
    solid = SolidBuilder(builder := BulkBuilder(), turn(0, 0.3, 5.0, 6.0, 7.0))
    solid.revolved(Outline.rectangle(20.0, 8.0, 3.0, 50.0))
    exact = 2 * np.pi * 50.0 * (160.0 - (4 - np.pi) * 9.0)
    assert volume(assert_closed(builder.build(), 1e-3)) == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("kind", range(len(MAKERS)))
def test_fasteners_are_closed(kind: int) -> None:
    assert_closed(fastener(kind + 16, 0)[1].build(), 0.05)


def test_brackets_are_closed() -> None:
    rng = np.random.default_rng(3)
    for _ in range(6):
        assert_closed(bracket(rng, 0)[1].build(), 0.05)


def test_tube_is_closed_and_counted() -> None:
    t = np.linspace(0.0, 6.0, 20)
    add_tube(builder := BulkBuilder(), np.stack([100 * np.cos(t), 100 * np.sin(t), 20 * t], axis=1), 6.0)
    assert_closed(builder.build(), 0.1)
    assert (builder.n_surfaces, builder.n_control_points) == tube_counts(20)


def test_shell_is_closed_with_rational_patches_and_holes() -> None:
    rng = np.random.default_rng(1)
    cells = np.array([[False, True], [False, False], [True, True]])
    outside = wavy(*DIVISIONS)
    add_shell(
        builder := BulkBuilder(), outside, offset(outside, -2.0), *DIVISIONS, Looks(cells, 3, Holes.seeded(cells, rng))
    )
    geometry = builder.build()
    assert_closed(geometry, 0.1)
    assert (builder.n_surfaces, builder.n_control_points) == shell_counts(*DIVISIONS, n_holes=3)
    assert (geometry.surfaces["n_loops"] == 2).sum() == 6
    assert (geometry.surfaces["material"] == 3).all()


def test_sheet_is_open_at_border_and_holes_only() -> None:
    cells = np.ones((3, 2), np.bool_)
    holes = Holes.seeded(cells, np.random.default_rng(2))
    add_sheet(builder := BulkBuilder(), wavy(*DIVISIONS), *DIVISIONS, Looks(holes=holes))
    mesh = tessellate(builder.build(), 0.1)
    assert (builder.n_surfaces, builder.n_control_points) == sheet_counts(*DIVISIONS)
    points, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    sides = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    sides, uses = np.unique(sides, axis=0, return_counts=True)
    # Euler's number of a sheet with six holes: 1 - 6.
    assert len(points) - len(sides) + len(t) == 1 - 6
    assert set(uses) == {1, 2}


def test_neighbours_have_the_same_border_bit_for_bit() -> None:
    add_sheet(builder := BulkBuilder(), wavy(*DIVISIONS), *DIVISIONS, Looks(np.ones((3, 2), np.bool_)))
    g = builder.build()
    nets = [
        g.values[s["points"] :][: s["n_u"] * s["n_v"] * (3 + s["rational"])].reshape(s["n_u"], s["n_v"], -1)
        for s in g.surfaces
    ]
    starts = {net[0].tobytes() for net in nets}
    # Two of three columns begin where another ends; the border's weights are 1, so homogeneous and plain agree.
    assert sum(net[-1].tobytes() in starts for net in nets if net.shape[2] == 4) >= 1
    assert all((net[0, :, 3:] == 1.0).all() and (net[:, -1, 3:] == 1.0).all() for net in nets)


@pytest.mark.parametrize("flip", [False, True])
def test_wing_with_its_arch_is_closed(flip: bool) -> None:
    masters, builder = Masters(GOLF), BulkBuilder()
    s0, s1 = masters.s_at(400.0), masters.s_at(1326.0)

    def panel(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return masters.lower(s0 + (1.0 - u if flip else u) * (s1 - s0), v)

    add_arched_panel(builder, panel, (24, 14), (5, 5), Arch(885.0, 316.0, 350.0), 1.2, 0)
    geometry = builder.build()
    mesh = tessellate(geometry, 0.2)
    assert (edge_uses(mesh) == 2).all()
    # The arch is a circle seen from the side.
    distance = np.hypot(mesh.positions[:, 0] - 885.0, mesh.positions[:, 2] - 316.0)
    assert distance.min() == pytest.approx(350.0, abs=1.0)


def test_baked_part_is_the_placed_one() -> None:
    rng = np.random.default_rng(5)
    geometry = bracket(rng, 0)[1].build()
    place = chained(MIRRORED, turn(2, 0.7, 10.0, -20.0, 30.0))
    here, there = tessellate(geometry, 0.01), tessellate(Baker(geometry).moved(place), 0.01)
    assert volume(there) == pytest.approx(volume(here), rel=1e-3)
    assert (edge_uses(there) == 2).all()
    moved = here.positions @ place[:, :3].T + place[:, 3]
    assert np.abs(np.sort(moved.min(axis=0)) - np.sort(there.positions.min(axis=0))).max() < 0.02


@pytest.mark.parametrize("n_points", [1024, 1025, 1031, 4000])
def test_labels_make_any_total(n_points: int) -> None:
    builders = labels(24, n_points, 0)
    assert sum(b.n_surfaces for b in builders) == 24
    assert sum(b.n_control_points for b in builders) == n_points


def test_planned_counts_are_those_of_the_part() -> None:
    from nurbs_ooc.synth.pressings import make_pressing
    from nurbs_ooc.synth.volumes import volumes

    rng = np.random.default_rng(8)
    for _ in range(20):
        plan = plan_pressing(60, 0.5, 0.3, rng)
        builder, place, box = make_pressing(plan, 3.0, volumes(GOLF), 0)
        assert (builder.n_surfaces, builder.n_control_points) == (plan.n_surfaces, plan.n_points(3.0))
        vertices = builder.all_vertices() @ place[:, :3].T + place[:, 3]
        assert (vertices >= np.array(box.low) - 40.0).all() and (vertices <= np.array(box.high) + 40.0).all()


SEEDED: list[Callable[[], BulkBuilder]] = [lambda: fastener(9, 0)[1], lambda: bracket(np.random.default_rng(1), 0)[1]]


@pytest.mark.parametrize("make", SEEDED)
def test_equal_parts_are_equal_bytes(make: Callable[[], BulkBuilder]) -> None:
    assert make().build("x").to_bytes() == make().build("x").to_bytes()
