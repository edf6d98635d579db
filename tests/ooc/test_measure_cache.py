"""An honest cache of two placed spheres passes; every planted fault in it is found and named."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from nurbs_cache.ledger import Ledger
from nurbs_cache.memory_store import MemoryStore
from nurbs_cache.node_record import ITEM_DTYPE, LOD_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import DEFAULT_MATERIAL, OCCURRENCE_DTYPE, PartInfo, Product
from nurbs_cache.surface_record import FaceReason
from nurbs_cache.tile import TileContent, encode_tile, tile_hash
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.measure.verify_cache import CacheAttack, CacheReport, verify_cache
from tests.ooc.measure_shapes import octasphere, sagitta, sphere

RADIUS = 10.0
PLACES = np.array([[0.0, 0, 0], [50.0, 0, 0]])
SCALE = np.array([1.0, 2.0])


def _content(levels: int, spoil: Callable[[TileContent], TileContent] | None, alone: bool = False) -> TileContent:
    """Both spheres (or the first) as octahedra divided so often, with what they truly promise."""
    v, t = octasphere(RADIUS, levels)
    n = 1 if alone else 2
    positions = np.concatenate([v * SCALE[i] + PLACES[i] for i in range(n)])
    triangles = np.concatenate([t + i * len(v) for i in range(n)]).astype(np.uint32)
    normals = np.tile(v / RADIUS, (n, 1)).astype(np.float32)
    nothing = np.zeros(0, np.uint32)
    ledger = Ledger(surface=sagitta(RADIUS, v, t) * SCALE[:n].max())
    content = TileContent(positions, normals, triangles, nothing.reshape(0, 2), nothing, ledger)
    return spoil(content) if spoil else content


def _error_of(tile: bytes) -> float:
    from nurbs_cache.tile import decode_tile

    return decode_tile(tile).ledger.total


def _store(
    spoil: Callable[[TileContent], TileContent] | None = None, promise: float = 1.0, spoil_lod: bool = False
) -> MemoryStore:
    store = MemoryStore()
    fill(store, spoil, promise, spoil_lod)
    return store


def fill(
    store: TypedStore,
    spoil: Callable[[TileContent], TileContent] | None = None,
    promise: float = 1.0,
    spoil_lod: bool = False,
) -> None:
    """One node with both spheres and one level of detail of the sphere."""
    store.put_parts([(0, PartInfo("ball", 1, 0), sphere(RADIUS))])
    occurrences = np.zeros(2, OCCURRENCE_DTYPE)
    occurrences["material"] = -1
    occurrences["transform"][:, :, :3] = np.eye(3) * SCALE[:, None, None]
    occurrences["transform"][:, :, 3] = PLACES
    identity = tuple(np.eye(3, 4).ravel().tolist())
    store.put_scene([Product("balls", -1, identity)], [DEFAULT_MATERIAL], occurrences, {})
    items = np.zeros(2, ITEM_DTYPE)
    items["occurrence"], items["scale"] = [0, 1], SCALE
    items["aabb_min"] = PLACES - RADIUS * SCALE[:, None]
    items["aabb_max"] = PLACES + RADIUS * SCALE[:, None]
    nodes = np.zeros(1, NODE_DTYPE)
    nodes["key"], nodes["parent"], nodes["n_items"], nodes["n_direct"] = b"0", -1, 2, 2
    nodes["aabb_min"], nodes["aabb_max"] = items["aabb_min"].min(0), items["aabb_max"].max(0)
    tile = encode_tile(_content(3, spoil))
    nodes["tile_hash"], nodes["geometric_error"] = tile_hash(tile).encode(), _error_of(tile) * promise
    store.put_tree(nodes, items, {})
    lod = encode_tile(_content(4, spoil if spoil_lod else None, alone=True))
    lods = np.zeros(1, LOD_DTYPE)
    lods["level"], lods["geometric_error"], lods["tile_hash"] = -3, _error_of(lod), tile_hash(lod).encode()
    store.put_lods(0, lods)
    store.put_tiles([(tile_hash(tile), tile), (tile_hash(lod), lod)])


def _kinds(report: CacheReport) -> set[str]:
    return {v.kind for v in report.violations}


def test_an_honest_cache_passes() -> None:
    store = _store()
    steps: list[int] = []
    attack = CacheAttack(store, samples=2000)
    report = attack.run(steps.append)
    assert report.violations == []
    assert (report.nodes, report.lods, report.undecided) == (1, 1, 0)
    assert (report.sampled_surfaces, report.placed_surfaces, report.skipped_surfaces) == (3, 3, 0)
    assert report.samples >= 2000
    assert sum(steps) == attack.n_jobs == 2
    assert 0.95 < report.worst()[0].ratio <= 1.0
    json.dumps(report.as_json(), allow_nan=False)


def test_a_promise_two_percent_too_small_is_broken() -> None:
    assert _kinds(verify_cache(_store(promise=0.98), samples=5000)) >= {"surface to mesh", "below its ledger"}


def _moved(content: TileContent) -> TileContent:
    content.positions[5] += [0.0, 0.0, 4.0]
    return content


def _one_ball_lost(content: TileContent) -> TileContent:
    return TileContent(
        content.positions, content.normals, content.triangles[:512], content.lines, content.points, content.ledger
    )


def _a_stray_point(content: TileContent) -> TileContent:
    positions = np.concatenate([content.positions, [[25.0, 0.0, 0.0]]])
    normals = np.concatenate([content.normals, [[0, 0, 1]]]).astype(np.float32)
    at = np.array([len(positions) - 1], np.uint32)
    return TileContent(positions, normals, content.triangles, content.lines, at, content.ledger)


def _a_stray_line(content: TileContent) -> TileContent:
    line = np.array([[0, len(content.positions) // 2]], np.uint32)
    return TileContent(content.positions, content.normals, content.triangles, line, content.points, content.ledger)


@pytest.mark.parametrize(
    ("spoil", "kind"),
    [
        (_moved, "mesh to surface"),
        (_one_ball_lost, "surface to mesh"),
        (_a_stray_point, "mesh to surface"),
        (_a_stray_line, "mesh to surface"),
    ],
)
def test_planted_faults_in_a_node_are_found(spoil: Callable[[TileContent], TileContent], kind: str) -> None:
    report = verify_cache(_store(spoil), samples=10_000)
    assert kind in _kinds(report)
    assert all(v.where.startswith("node 0 0") for v in report.violations)


def test_planted_fault_in_a_level_of_detail_is_found() -> None:
    report = verify_cache(_store(_moved, promise=100.0, spoil_lod=True), samples=2000)
    assert report.violations
    assert all(v.where.startswith("surface 0 level -3") for v in report.violations)


def test_points_and_lines_stand_for_surfaces_too() -> None:
    def as_points(content: TileContent) -> TileContent:
        every = np.arange(len(content.positions), dtype=np.uint32)
        return TileContent(
            content.positions, content.normals, content.triangles[:0], content.lines, every, Ledger(cluster=4.0)
        )

    report = verify_cache(_store(as_points), samples=2000)
    assert report.violations == []


def test_boxes_and_the_order_of_errors_are_checked() -> None:
    store = _store()
    nodes = np.repeat(store.get_nodes(), 2)
    nodes[1]["key"], nodes[1]["parent"], nodes[1]["geometric_error"] = b"0-1", 0, nodes[0]["geometric_error"] * 2
    nodes[0]["aabb_max"] -= [1.0, 0, 0]
    store.put_tree(nodes, store.get_items(), {})
    kinds = _kinds(verify_cache(store, samples=1000))
    assert kinds == {"below a child", "out of its box", "out of its parent", "twice"}  # both nodes hold the spheres


def test_a_surface_outside_its_own_box_is_found() -> None:
    store = _store()
    items = store.get_items()
    items["aabb_max"][1, 2] -= 0.5
    store.put_tree(store.get_nodes(), items, {})
    assert "out of the box of the surface" in _kinds(verify_cache(store, samples=1000))


def _with_items(store: MemoryStore, rows: list[int]) -> MemoryStore:
    nodes, items = store.get_nodes(), store.get_items()[rows]
    nodes["n_items"] = nodes["n_direct"] = len(rows)
    store.put_tree(nodes, items, {})
    return store


@pytest.mark.parametrize(("rows", "kind"), [([0], "lost"), ([0, 1, 1], "twice")])
def test_a_surface_that_is_nowhere_or_twice_is_found(rows: list[int], kind: str) -> None:
    violations = verify_cache(_with_items(_store(), rows), samples=1000).violations
    assert [(v.kind, v.where) for v in violations if v.kind in ("lost", "twice")] == [
        (kind, "occurrence 1, part 0 face 0")
    ]


def test_a_damaged_tile_is_named_and_the_others_are_attacked() -> None:
    store = _store()
    name = bytes(store.get_nodes()["tile_hash"][0]).decode()
    other = bytes(store.get_lods(0)["tile_hash"][0]).decode()
    data = bytearray(store.get_tile(name))
    data[100] ^= 1
    store.put_tiles([(name, bytes(data))])
    report = verify_cache(store, samples=1000)
    assert [(v.kind, v.row) for v in report.violations] == [("damaged", 0)]
    assert report.measured[1].ratio > 0.5
    store.put_tiles([(name, store.get_tile(other))])  # whole, but not what the name says
    assert _kinds(verify_cache(store, samples=1000)) == {"damaged"}


def test_a_lost_tile_is_named() -> None:
    store = _store()
    nodes = store.get_nodes()
    nodes["tile_hash"] = b"0" * 32
    store.put_tree(nodes, store.get_items(), {})
    assert _kinds(verify_cache(store, samples=1000)) == {"damaged"}


def test_the_number_of_workers_changes_nothing() -> None:
    one, two = (verify_cache(_store(promise=0.9), samples=200_000, workers=n).as_json() for n in (1, 2))
    assert one == two
    assert one["violations"]


def test_a_small_budget_still_reaches_every_tile() -> None:
    report = verify_cache(_store(_one_ball_lost), samples=1)
    assert [m.ratio > 0.0 for m in report.measured] == [True, True]
    assert report.samples < 3000


def test_what_nobody_can_evaluate_is_counted_not_judged() -> None:
    store = _store()
    geometry = store.get_part(0)
    geometry.surfaces["reason"] = FaceReason.NOT_FINITE
    store.put_parts([(0, PartInfo("ball", 1, 0), geometry)])
    report = verify_cache(store, samples=1000)
    assert report.violations == []
    assert report.skipped_surfaces == report.placed_surfaces == 3
