"""Selection against a slow recursion in plain Python, and its promises one by one."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

from nurbs_cache.errors import CacheError
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE
from nurbs_client.camera import Camera
from nurbs_client.scene import Scene, make_scene
from nurbs_client.screen_error import boxes_mm_per_px, desired_error, screen_error_px
from nurbs_client.selection import LEVEL_BIAS, MAX_LEVEL, MIN_LEVEL, Residency, Selection, pick_level, select

TARGET = 0.5


def camera_from(rng: np.random.Generator, spread: float = 400.0) -> Camera:
    return Camera(rng.normal(0, spread, 3), rng.normal(0, 60, 3), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01)


def everything(scene: Scene) -> Residency:
    masks = np.full(len(scene.surface_ids), ~np.int64(0), np.int64)
    return Residency(np.ones(len(scene.nodes), np.uint8), masks, np.zeros(len(scene.items)))


def nothing(scene: Scene) -> Residency:
    n, s, m = len(scene.nodes), len(scene.surface_ids), len(scene.items)
    return Residency(np.zeros(n, np.uint8), np.zeros(s, np.int64), np.zeros(m))


def some(scene: Scene, rng: np.random.Generator) -> Residency:
    """Each tile with probability 0.6, levels from coarse to fine."""
    nodes = (rng.random(len(scene.nodes)) < 0.6).astype(np.uint8)
    masks = np.zeros(len(scene.surface_ids), np.int64)
    for level in range(-6, 5):
        masks |= (rng.random(len(masks)) < 0.25).astype(np.int64) << np.int64(level + LEVEL_BIAS)
    return Residency(nodes, masks, np.zeros(len(scene.items)))


class Reference:
    """What ``select`` promises, written down as one would explain it."""

    def __init__(self, scene: Scene, camera: Camera, residency: Residency, refined: Any = None) -> None:
        self.scene, self.camera, self.residency = scene, camera, residency
        self.refined = np.zeros(len(scene.nodes), np.uint8) if refined is None else refined
        self.nodes: set[int] = set()
        self.items: dict[int, int] = {}
        self.holes = 0
        for root in scene.roots.tolist():
            self._draw(root)

    def _allowed(self, low: Any, high: Any) -> float | None:
        mm_per_px = boxes_mm_per_px(self.camera.view, low[None], high[None])[0]
        return None if math.isinf(mm_per_px) else desired_error(mm_per_px, TARGET, self.camera.focal_px)

    def _children(self, row: int) -> list[int]:
        first = int(self.scene.nodes["first_child"][row])
        return list(range(first, first + int(self.scene.nodes["n_children"][row])))

    def _direct(self, row: int) -> list[int]:
        first = int(self.scene.nodes["first_item"][row])
        return list(range(first, first + int(self.scene.nodes["n_direct"][row])))

    def _wants_refinement(self, row: int, allowed: float) -> bool:
        error = float(self.scene.node_arrays.error[row])
        if not self._children(row) and not self._direct(row):
            return False
        if self.refined[row] and (error > 0.8 * allowed or not self.residency.node[row]):
            return True
        return error > allowed

    def _node_allowed(self, row: int) -> float | None:
        return self._allowed(self.scene.nodes["aabb_min"][row], self.scene.nodes["aabb_max"][row])

    def _drawable(self, row: int) -> bool:
        allowed = self._node_allowed(row)
        if allowed is None or self.residency.node[row]:
            return True
        return self._wants_refinement(row, allowed) and self._children_drawable(row)

    def _levels(self, item: int) -> list[int]:
        mask = int(self.residency.lod_mask[self.scene.item_arrays.surface[item]])
        return [level for level in range(MIN_LEVEL, MAX_LEVEL + 1) if mask >> (level + LEVEL_BIAS) & 1]

    def _coarsest(self, item: int) -> int:
        holder = int(self.scene.items["node"][item])
        return math.floor(math.log2(2.0 ** (int(self.scene.nodes["level"][holder]) - 1) / self._scale(item)))

    def _scale(self, item: int) -> float:
        return float(self.scene.items["scale"][item])

    def _item_allowed(self, item: int) -> float | None:
        return self._allowed(self.scene.items["aabb_min"][item], self.scene.items["aabb_max"][item])

    def _children_drawable(self, row: int) -> bool:
        if not all(self._drawable(child) for child in self._children(row)):
            return False
        visible = [item for item in self._direct(row) if self._item_allowed(item) is not None]
        return all(any(level <= self._coarsest(item) for level in self._levels(item)) for item in visible)

    def _draw(self, row: int) -> None:
        allowed = self._node_allowed(row)
        if allowed is None:
            return
        resident = bool(self.residency.node[row])
        if self._wants_refinement(row, allowed) and (self._children_drawable(row) or not resident):
            for child in self._children(row):
                self._draw(child)
            for item in self._direct(row):
                self._draw_item(item)
        elif resident:
            self.nodes.add(row)
        else:
            self.holes += 1

    def _draw_item(self, item: int) -> None:
        allowed = self._item_allowed(item)
        if allowed is None:
            return
        wanted = min(self._coarsest(item), math.floor(math.log2(allowed / self._scale(item))))
        levels = self._levels(item)
        fine = [level for level in levels if level <= wanted]
        if levels:
            self.items[item] = max(fine) if fine else min(levels)
        else:
            self.holes += 1


def assert_same(chosen: Selection, reference: Reference) -> None:
    assert set(chosen.nodes.tolist()) == reference.nodes
    assert dict(zip(chosen.items.tolist(), chosen.item_levels.tolist(), strict=True)) == reference.items
    assert chosen.n_holes == reference.holes


@pytest.mark.parametrize("seed", range(25))
def test_agrees_with_the_reference(grid_world: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = grid_world.scene()
    scene.item_arrays.scale[:] = scene.items["scale"] = rng.choice([0.5, 1.0, 3.0], len(scene.items))
    camera = camera_from(rng)
    for residency in (everything(scene), nothing(scene), some(scene, rng)):
        first = select(scene, camera.view, TARGET, residency)
        assert_same(first, Reference(scene, camera, residency))
        moved = Camera(camera.eye * 1.15, camera.target, camera.up, 50.0, 800, 600, 0.01)
        then = select(scene, moved.view, TARGET, residency, first.refined)
        assert_same(then, Reference(scene, moved, residency, first.refined))


def test_each_visible_surface_is_drawn_once(grid_world: Any) -> None:
    scene = grid_world.scene()
    camera = Camera(np.array([650.0, 420, 350]) * 1.4, np.zeros(3), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01)
    chosen = select(scene, camera.view, TARGET, everything(scene))
    assert len(chosen.nodes) and len(chosen.items)
    covered = np.zeros(len(scene.items), int)
    covered[chosen.items] += 1
    for row in chosen.nodes:
        first = scene.nodes["first_item"][row]
        covered[first : first + scene.nodes["n_items"][row]] += 1
    assert (covered == 1).all()
    assert chosen.is_complete
    px = screen_error_px(chosen.node_mm_per_px, scene.nodes["geometric_error"][chosen.nodes], camera.focal_px)
    assert (px <= TARGET).all()


def test_parents_stay_until_the_last_child_is_there(grid_world: Any) -> None:
    scene = grid_world.scene()
    camera = Camera(np.array([1500.0, 900, 750]), np.zeros(3), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01)
    residency = everything(scene)
    full = select(scene, camera.view, TARGET, residency)
    lost = int(full.nodes[-1])
    parent = int(scene.nodes["parent"][lost])
    residency.node[lost] = 0
    assert parent >= 0
    chosen = select(scene, camera.view, TARGET, residency)
    assert parent in chosen.nodes
    assert chosen.n_substitutes == 1
    assert not chosen.is_complete
    assert lost in chosen.wanted_nodes
    at = chosen.wanted_nodes.tolist().index(lost)
    assert chosen.wanted_node_priority[at] > 1


def test_coarsens_later_than_it_refines(grid_world: Any) -> None:
    scene = grid_world.scene()
    residency = everything(scene)

    def drawn(distance: float, refined: Any) -> Selection:
        eye = np.array([distance, 0.3 * distance, 0.2 * distance])
        return select(
            scene,
            Camera(eye, np.zeros(3), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01).view,
            TARGET,
            residency,
            refined,
        )

    near = next(d for d in np.geomspace(20000, 300, 4000) if drawn(d, None).refined[0])
    refined = drawn(near, None).refined
    assert drawn(near * 1.02, None).refined[0] == 0
    assert drawn(near * 1.02, refined).refined[0] == 1, "a small step back changes nothing"
    assert drawn(near * 1.4, refined).refined[0] == 0


def test_wanted_levels_halve_with_the_distance(grid_world: Any) -> None:
    scene = grid_world.scene()
    levels = []
    for distance in (800.0, 400.0, 200.0):
        eye = scene.items["aabb_max"][0] + np.array([distance, 0, 0])
        camera = Camera(eye, eye - np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 40.0, 400, 400, 0.01)
        chosen = select(scene, camera.view, 0.05, everything(scene))
        levels.append(int(chosen.item_levels[chosen.items.tolist().index(0)]))
    assert levels[0] - levels[1] in (0, 1, 2)
    assert levels[0] > levels[1] > levels[2]


def test_pick_level() -> None:
    mask = sum(1 << (level + LEVEL_BIAS) for level in (-3, 0, 4))
    pick = getattr(pick_level, "py_func", pick_level)
    assert [pick(mask, level) for level in (-5, -3, -1, 0, 3, 9)] == [-3, -3, -3, 0, 0, 4]
    assert pick(0, 2) == MAX_LEVEL + 1


def test_empty_view_draws_and_wants_nothing(grid_world: Any) -> None:
    scene = grid_world.scene()
    camera = Camera(np.array([5000.0, 0, 0]), np.array([6000.0, 0, 0]), np.array([0, 0, 1.0]), 50.0, 800, 600, 0.01)
    chosen = select(scene, camera.view, TARGET, nothing(scene))
    assert len(chosen.nodes) == len(chosen.items) == len(chosen.wanted_nodes) == len(chosen.wanted_items) == 0
    assert chosen.n_culled == 1
    assert chosen.is_complete


def complete_octree(depth: int) -> Scene:
    """A full octree of a cube of 100 m, one direct surface in each leaf."""
    counts = 8 ** np.arange(depth + 1)
    starts = np.concatenate([[0], np.cumsum(counts)])
    nodes = np.zeros(starts[-1], NODE_DTYPE)
    items = np.zeros(counts[-1], ITEM_DTYPE)
    for level in range(depth + 1):
        rows = np.arange(counts[level])
        held = nodes[starts[level] : starts[level + 1]]
        held["parent"] = starts[level - 1] + rows // 8 if level else -1
        held["first_child"], held["n_children"] = (starts[level + 1] + 8 * rows, 8) if level < depth else (0, 0)
        held["n_items"] = counts[depth - level]
        held["first_item"] = rows * counts[depth - level]
        held["n_direct"] = level == depth
        digits = np.stack([rows >> (3 * d) & 7 for d in range(level)] or [rows * 0])
        corner = sum(
            np.stack([digit >> axis & 1 for axis in range(3)], axis=1) * 2.0**d for d, digit in enumerate(digits)
        )
        held["aabb_min"] = corner * (1e5 / 2**level)
        held["aabb_max"] = held["aabb_min"] + 1e5 / 2**level
        held["level"] = 10 - level
        held["geometric_error"] = 2.0 ** (10 - level)
    items["surface"] = np.arange(len(items))
    items["node"] = starts[-2] + np.arange(len(items))
    items["aabb_min"], items["aabb_max"] = nodes["aabb_min"][starts[-2] :], nodes["aabb_max"][starts[-2] :]
    items["scale"] = 1.0
    occurrences = np.zeros(1, OCCURRENCE_DTYPE)
    return make_scene(nodes, items, occurrences, [])


def test_many_nodes_are_cheap() -> None:
    scene = complete_octree(5)
    camera = Camera(np.zeros(3) - 10, np.array([1.0, 0.9, 0.8]) * 1e5, np.array([0, 0, 1.0]), 90.0, 1280, 720, 0.01)
    select(scene, camera.view, 0.2, everything(scene))
    start = time.process_time()
    chosen = select(scene, camera.view, 0.2, everything(scene))
    seconds = time.process_time() - start
    assert chosen.n_visited > 10_000
    assert seconds < 1.0  # some milliseconds; this only catches a fall back to Python


@pytest.mark.parametrize(
    ("table", "field", "value", "words"),
    [
        ("nodes", "parent", 72, "parent"),
        ("nodes", "first_child", 0, "children"),
        ("nodes", "n_direct", 1000, "items"),
        ("nodes", "aabb_min", np.nan, "box"),
        ("items", "occurrence", 64, "occurrence"),
    ],
)
def test_tables_that_point_outside_are_refused(grid_world: Any, table: str, field: str, value: Any, words: str) -> None:
    tables = {"nodes": grid_world.nodes.copy(), "items": grid_world.items.copy()}
    row = 0 if field == "first_child" else len(tables[table]) - 1
    tables[table][field][row] = value
    with pytest.raises(CacheError, match=words):
        make_scene(tables["nodes"], tables["items"], grid_world.occurrences, grid_world.materials)


def test_empty_scene_is_refused(grid_world: Any) -> None:
    with pytest.raises(CacheError, match="nothing to draw"):
        make_scene(grid_world.nodes[:0], grid_world.items[:0], grid_world.occurrences[:0], [])
