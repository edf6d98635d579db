"""Budget, eviction, priorities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nurbs_client.camera import Camera
from nurbs_client.prefetch import prefetch_requests, priority_bins, visible_requests
from nurbs_client.residency import BudgetGovernor, ResidencyTable, TileKey, TileState, drawn_lods, nearby_tiles
from nurbs_client.selection import LEVEL_BIAS, select
from nurbs_client.tile_mesh import TileMesh, make_mesh


def mesh_of(n_triangles: int, error: float = 0.1) -> TileMesh:
    corners = np.zeros((3, 3), np.float32)
    triangles = np.tile(np.arange(3, dtype=np.uint32), (n_triangles, 1))
    none = np.zeros(0, np.uint32)
    return make_mesh(np.zeros(3), corners, corners, triangles, none.reshape(0, 2), none, error)


def table_of(world: Any, budget: int = 1 << 20) -> tuple[ResidencyTable, list[int]]:
    released: list[int] = []
    return ResidencyTable(world.scene(), budget, released.append), released


def test_states_of_a_tile(grid_world: Any) -> None:
    table, _ = table_of(grid_world)
    key = TileKey.of_node(3)
    assert table.state(key) == TileState.ABSENT
    assert table.want(key)
    assert table.state(key) == TileState.WANTED
    table.forget(key)
    assert table.state(key) == TileState.ABSENT
    table.want(key)
    table.arrive(key, 7, mesh_of(10, 0.25))
    assert not table.want(key)
    assert table.node[3] == 1
    assert table.node_slot[3] == 7
    assert table.node_error[3] == 0.25
    assert table.scene.node_arrays.error[3] == grid_world.nodes["geometric_error"][3]
    table.forget(key)
    assert table.state(key) == TileState.RESIDENT
    broken = TileKey.of_node(4)
    table.want(broken)
    table.fail(broken, "bad")
    assert not table.want(broken), "a broken tile is not asked for again"


def test_a_lod_serves_all_levels_it_is_good_for(grid_world: Any) -> None:
    table, _ = table_of(grid_world)
    table.arrive(TileKey.of_lod(5, 2), 0, mesh_of(1, error=0.3))  # asked within 4 mm, turned out within 0.5
    assert [bool(table.lod_mask[5] >> (level + LEVEL_BIAS) & 1) for level in (-2, -1, 0, 1, 2, 3)] == [
        False, True, True, True, True, False,
    ]  # fmt: skip
    table.arrive(TileKey.of_lod(5, 0), 1, mesh_of(1, error=0.2))
    assert table.lod_entry(5, -1)[0].level == 2, "the coarser one has fewer triangles"
    assert table.lod_entry(5, -2)[0].level == 0
    assert table.finest_level(5) == -2
    assert table.finest_level(6) is None


def test_eviction_spares_what_is_drawn_and_takes_the_oldest_first(grid_world: Any) -> None:
    size = mesh_of(100).n_bytes
    table, released = table_of(grid_world, budget=10 * size)
    for row in range(12):
        table.arrive(TileKey.of_node(row), row, mesh_of(100))
        table.keep([TileKey.of_node(row)], row)
    table.keep([TileKey.of_node(0)], 99)
    table.keep([TileKey.of_node(1)], 98.5)
    assert table.shrink(99) == 4 * size
    assert released == [2, 3, 4, 5]
    assert table.used_bytes == 8 * size
    assert table.node[[0, 1, 2, 11]].tolist() == [1, 1, 0, 1]
    assert table.state(TileKey.of_node(2)) == TileState.ABSENT


def test_evicting_a_lod_leaves_the_others(grid_world: Any) -> None:
    size = mesh_of(100).n_bytes
    table, _ = table_of(grid_world, budget=2 * size)
    for frame, level in enumerate((3, 1, -2)):
        table.arrive(TileKey.of_lod(0, level), level, mesh_of(100, error=2.0**level))
        table.keep([TileKey.of_lod(0, level)], frame)
    table.shrink(2)
    left = [level for level in range(-20, 21) if table.lod_mask[0] >> (level + LEVEL_BIAS) & 1]
    assert left == [-2]
    assert table.lod_entry(0, -2)[0].level == -2


def test_kept_are_the_drawn_their_parents_and_children(grid_world: Any) -> None:
    table, _ = table_of(grid_world)
    scene = table.scene
    table.node[:] = 1
    camera = Camera(np.array([900.0, 300, 250]), np.zeros(3), np.array([0, 0, 1.0]), 50.0, 400, 300, 0.01)
    for surface in range(len(scene.surface_ids)):
        table.arrive(TileKey.of_lod(surface, -3), 0, mesh_of(1, 0.1))
    chosen = select(scene, camera.view, 0.5, table.snapshot)
    assert len(drawn_lods(scene, chosen, table)) == len(chosen.items)
    near = {key.node for key in nearby_tiles(scene, chosen)}
    for row in chosen.nodes.tolist():
        first, n = scene.nodes["first_child"][row], scene.nodes["n_children"][row]
        assert {int(scene.nodes["parent"][row])} - {-1} <= near
        assert set(range(first, first + n)) <= near


def test_governor_raises_at_once_and_takes_back_slowly() -> None:
    governor = BudgetGovernor(0.5, 1000)
    assert governor.update(2000)
    assert governor.effective_px == pytest.approx(0.625)
    assert governor.was_raised
    assert not governor.update(800)
    assert governor.effective_px == pytest.approx(0.625)
    for _ in range(10):
        governor.update(100)
    assert governor.effective_px == 0.5


def test_bins_keep_the_order() -> None:
    values = np.sort(10.0 ** np.random.default_rng(0).uniform(-9, 9, 500))
    bins = priority_bins(values)
    assert (np.diff(bins) >= 0).all()
    assert priority_bins(np.array([1.0, 1.5, 2.0])).tolist() == [0, 1, 2]


def test_what_shows_is_asked_for_before_what_may_show(grid_world: Any) -> None:
    table, _ = table_of(grid_world)
    scene = table.scene
    camera = Camera(np.array([700.0, 300, 250]), np.zeros(3), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01)
    table.arrive(TileKey.of_node(0), 0, mesh_of(1, error=float(scene.nodes["geometric_error"][0])))
    chosen = select(scene, camera.view, 0.5, table.snapshot)
    shown = visible_requests(scene, chosen, table, chosen.wanted_levels)
    assert [r.bin for r in shown] == sorted((r.bin for r in shown), reverse=True)
    assert {r.key.node for r in shown} == set(range(1, 9))
    guessed = prefetch_requests(scene, camera.view, 0.5, table, np.ones(len(scene.nodes), bool), 20)
    assert len(guessed) == 20
    assert max(r.bin for r in guessed) < 0 <= min(r.bin for r in shown)
    none = prefetch_requests(scene, camera.view, 0.5, table, np.zeros(len(scene.nodes), bool), 20)
    assert none == []
