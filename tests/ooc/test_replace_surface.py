"""Replacing surfaces of a cache, against a build of the edited model from scratch."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.errors import MissingRecordError, UsageError
from nurbs_cache.scene_record import DEFAULT_MATERIAL, OCCURRENCE_DTYPE, PartInfo, Product
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.build import on_demand, rebuild_stale, replace_surface
from nurbs_ooc.build.forest import Forest
from nurbs_ooc.build.on_demand import build_node_tile, build_surface_lod
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.replaced import with_surface
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_plane, add_sphere
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.measure.verify_cache import verify_cache
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.ooc.scenes import IDENTITY, RED, hash_of, run_build, turned, write_scene

PEG, BALL_ON_PEG, BALL = 5, 6, 9  # surfaces of ``write_scene`` with two pegs a side


def sphere(radius: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> GeometryBatch:
    builder = BatchBuilder(part=77)
    add_sphere(builder, radius, at)
    return builder.build()


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    source = write_scene(tmp_path / "scene.nurbs", n=2)
    run_build(source, tmp_path / "cache")
    return tmp_path / "cache"


def edited_source(source: Path, target: Path, surface: int, one: GeometryBatch) -> Path:
    """The surface store with one surface replaced."""
    with Store.open(source) as old, Store.create(target) as new:
        infos = old.part_infos()
        parts = [old.get_part(i) for i in range(len(infos))]
        part, row = old.locate_surface(surface)
        parts[part] = with_surface(parts[part], row, one, part)
        new.put_parts((i, info, parts[i]) for i, info in enumerate(infos))
        new.put_scene(old.get_products(), old.get_materials(), old.get_occurrences(), old.get_units())
    return target


def containing(store: Store, surface: int) -> np.ndarray:
    """Nodes with the surface among the items of their subtree, found the long way."""
    nodes, items = store.get_nodes(), store.get_items()
    subtrees = [items["surface"][n["first_item"] : n["first_item"] + n["n_items"]] for n in nodes]
    return np.flatnonzero([surface in subtree for subtree in subtrees])


def check_tree(store: Store) -> None:
    """Each item in one place, boxes the unions of what they hold, no parent more exact than a child."""
    nodes, items = store.get_nodes(), store.get_items()
    held = np.concatenate([np.arange(n["first_item"], n["first_item"] + n["n_direct"]) for n in nodes])
    assert (np.sort(held) == np.arange(len(items))).all()
    pairs = np.stack([items["surface"].astype(np.int64), items["occurrence"]], axis=1)
    assert len(np.unique(pairs, axis=0)) == len(items)
    for row, node in enumerate(nodes):
        subtree = items[node["first_item"] : node["first_item"] + node["n_items"]]
        assert (node["aabb_min"] == subtree["aabb_min"].min(axis=0)).all()
        assert (node["aabb_max"] == subtree["aabb_max"].max(axis=0)).all()
        children = nodes[node["first_child"] : node["first_child"] + node["n_children"]]
        assert (children["parent"] == row).all()
        assert (children["geometric_error"] <= node["geometric_error"]).all()
        assert (children["level"] <= node["level"]).all()


@pytest.mark.parametrize(
    ("surface", "one"),
    [
        (BALL, sphere(2.9)),  # placed four times, among them scaled
        (BALL_ON_PEG, sphere(0.9, (30.0, 10.0, 5.0))),  # the boards' first peg of full size
        (0, sphere(19.0, (20.0, 20.0, 0.0))),  # a board becomes a ball
    ],
)
def test_exactly_what_shows_it_is_stale_and_becomes_a_build_from_scratch(
    cache: Path, surface: int, one: GeometryBatch
) -> None:
    run_build(
        edited_source(cache.parent / "scene.nurbs", cache.parent / "new.nurbs", surface, one), cache.parent / "new"
    )
    with Store.open(cache, read_only=False) as store, Store.open(cache.parent / "new") as fresh:
        before, expected = store.get_nodes(), containing(store, surface)
        assert 0 < len(expected) < len(before)
        marked = replace_surface.replace_surface(store, surface, one)
        assert marked.tolist() == expected.tolist() == store.stale_nodes().tolist()
        after = store.get_nodes()
        others = np.setdiff1d(np.arange(len(before)), expected)
        assert (after[others] == before[others]).all()
        assert (after["tile_hash"][expected] == b"").all()
        check_tree(store)

        rebuilt = rebuild_stale.rebuild_stale(store)
        assert rebuilt.n_tiles == len(expected)
        assert not len(store.stale_nodes())
        check_tree(store)
        done, wanted = store.get_nodes(), fresh.get_nodes()
        assert (done[others] == before[others]).all()
        assert (done["tile_hash"][expected] != before["tile_hash"][expected]).any()
        # Where the tree has come out alike, so have the tiles.
        same_tree = {bytes(n["key"]): n for n in wanted}
        items, new_items = store.get_items(), fresh.get_items()
        n_alike = 0
        for node in done[expected]:
            twin = same_tree.get(bytes(node["key"]))
            if twin is not None and _content(node, items) == _content(twin, new_items):
                assert node["tile_hash"] == twin["tile_hash"]
                assert node["geometric_error"] == twin["geometric_error"]
                n_alike += 1
        assert n_alike > 0
        store.check()


def _content(node: np.void, items: np.ndarray) -> tuple[bytes, ...]:
    """What a node shows, in its order, and where."""
    own = items[node["first_item"] : node["first_item"] + node["n_items"]]
    names = ("surface", "occurrence", "aabb_min", "aabb_max", "normal", "scale")
    return (node["aabb_min"].tobytes(), node["aabb_max"].tobytes(), *(own[name].tobytes() for name in names))


def test_replacing_and_replacing_back_is_the_first_build(cache: Path) -> None:
    with Store.open(cache, read_only=False) as store:
        nodes, items = store.get_nodes(), store.get_items()
        part, row = store.locate_surface(BALL)
        old = subset(store.get_part(part), [row])
        replace_surface.replace_surface(store, BALL, sphere(1.0, (1.0, 0.0, 0.0)))
        rebuild_stale.rebuild_stale(store)
        assert (store.get_nodes()["tile_hash"] != nodes["tile_hash"]).any()
        replace_surface.replace_surface(store, BALL, old)
        rebuild_stale.rebuild_stale(store)
        assert store.edit_count() == 2
        assert (store.get_nodes() == nodes).all()
        assert (store.get_items() == items).all()


def test_a_surface_that_leaves_its_place_stays_inside_the_boxes(cache: Path) -> None:
    with Store.open(cache, read_only=False) as store:
        replace_surface.replace_surface(store, BALL_ON_PEG, sphere(60.0, (500.0, -300.0, 80.0)))
        check_tree(store)
        rebuild_stale.rebuild_stale(store)
        check_tree(store)
        assert (store.get_nodes()["tile_hash"] != b"").all()
        assert not verify_cache(store, samples=20_000).violations


def test_only_its_levels_of_detail_are_dropped(cache: Path) -> None:
    with Store.open(cache, read_only=False) as store:
        for surface in (BALL, PEG):
            build_surface_lod(store, surface, -2)
        replace_surface.replace_surface(store, BALL, sphere(1.0))
        assert len(store.get_lods(BALL)) == 0
        assert store.get_lods(PEG)["level"].tolist() == [-2]
        _, data = build_surface_lod(store, BALL, -2)
        assert data == store.get_tile(bytes(store.get_lods(BALL)["tile_hash"][0]))
        mesh = tessellate(store.get_part(1), 0.1)
        assert np.linalg.norm(mesh.positions, axis=1).max() == pytest.approx(1.0)


def test_a_stale_node_can_be_built_when_asked_for(cache: Path) -> None:
    with Store.open(cache, read_only=False) as store:
        marked = replace_surface.replace_surface(store, BALL, sphere(1.5)).tolist()
        name, _ = build_node_tile(store, marked[-1])
        assert store.stale_nodes().tolist() == marked[:-1]
        check_tree(store)
        assert rebuild_stale.rebuild_stale(store).n_tiles == len(marked) - 1
        assert store.get_nodes(marked[-1], 1)["tile_hash"][0].decode() == name
        check_tree(store)


def test_nodes_that_never_had_a_tile_are_not_built(tmp_path: Path) -> None:
    source = write_scene(tmp_path / "scene.nurbs", n=2)
    run_build(source, tmp_path / "cache", levels="root")
    with Store.open(tmp_path / "cache", read_only=False) as store:
        marked = replace_surface.replace_surface(store, BALL, sphere(1.5))
        roots = np.flatnonzero(store.get_nodes()["parent"] < 0)
        assert store.stale_nodes().tolist() == np.intersect1d(marked, roots).tolist()
        assert len(marked) > len(store.stale_nodes())
        rebuild_stale.rebuild_stale(store)
        assert ((store.get_nodes()["tile_hash"] != b"") == (store.get_nodes()["parent"] < 0)).all()


def test_an_edit_while_a_tile_is_built_is_not_overwritten(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tile that was begun before the edit shows the old surface: it must not be kept."""
    with Store.open(cache, read_only=False) as store:
        marked = replace_surface.replace_surface(store, BALL, sphere(1.5))
        build, n_calls = on_demand.build_nodes, []

        def slow(*arguments: object) -> object:
            built = build(*arguments)  # type: ignore[arg-type]
            n_calls.append(1)
            if len(n_calls) == 1:
                replace_surface.replace_surface(store, BALL, sphere(1.0))
            return built

        monkeypatch.setattr(on_demand, "build_nodes", slow)
        name, _ = build_node_tile(store, int(marked[-1]))
        monkeypatch.undo()
        assert len(n_calls) == 2
        rebuild_stale.rebuild_stale(store)
        assert build_node_tile(store, int(marked[-1]))[0] == name


def swarm(path: Path, n: int) -> Path:
    """``n`` parts of four balls each, anywhere in a cube of 100 mm."""
    random = np.random.default_rng(5)
    parts = []
    for i in range(n):
        builder = BatchBuilder(part=i)
        for _ in range(4):
            add_sphere(builder, 0.5, tuple(random.uniform(0.0, 100.0, 3).tolist()))
        parts.append(builder.build())
    occurrences = np.zeros(n, OCCURRENCE_DTYPE)
    occurrences["part"], occurrences["material"] = np.arange(n), -1
    occurrences["transform"] = turned(0.0, 0.0, 0.0, 0.0)
    with Store.create(path) as store:
        store.put_parts((i, PartInfo(f"part {i}", 4, 4 * i), part) for i, part in enumerate(parts))
        store.put_scene([Product("scene", -1, IDENTITY)], [DEFAULT_MATERIAL, RED], occurrences, {})
    return path


def test_the_cost_follows_the_stale_nodes_not_the_model(tmp_path: Path) -> None:
    """Sixteen times the model: a few nodes more. All that is tessellated is what the stale nodes show."""
    for n in (16, 256):
        run_build(swarm(tmp_path / f"{n}.nurbs", n), tmp_path / f"{n}")
        with Store.open(tmp_path / f"{n}", read_only=False) as store:
            at = store.get_items()["aabb_min"][store.get_items()["surface"] == 1][0] + 0.5
            replace_surface.replace_surface(store, 1, sphere(0.4, tuple(at.tolist())))
            stale, forest = store.stale_nodes(), Forest.load(store)
            shown = [len(forest.needs(np.array([row])).items) for row in stale.tolist()]
            assert shown[0] == 4 * n  # the root shows everything
            rebuilt = rebuild_stale.rebuild_stale(store)
            assert rebuilt.n_tiles == len(stale) <= 2 + np.log2(n)
            assert rebuilt.n_meshes <= sum(shown)
            everything = [len(forest.needs(np.array([row])).items) for row in range(len(forest.nodes))]
            assert sum(shown[1:]) < sum(everything[1:]) / 3
            assert len(stale) < len(everything) / 3


KILLED = """
import os, sys
from nurbs_cache.store import Store
from nurbs_ooc.build import rebuild_stale, replace_surface
from nurbs_cache.environment import Environment
from tests.ooc.test_replace_surface import BALL, sphere
left = int(sys.argv[2])
write = Environment.write
def dying(environment, change):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), 9)
    return write(environment, change)
Environment.write = dying
with Store.open(sys.argv[1], read_only=False) as store:
    if not store.edit_count():
        replace_surface.replace_surface(store, BALL, sphere(2.9))
    rebuild_stale.rebuild_stale(store)
"""


def test_a_kill_at_any_transaction_loses_no_mark(cache: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()  # the inputs' names are part of what is hashed
    source = edited_source(cache.parent / "scene.nurbs", tmp_path / "other" / "scene.nurbs", BALL, sphere(2.9))
    run_build(source, tmp_path / "new")
    n_killed = 0
    for left in (1, 2, 2, 3, 99):  # before the edit, then after one or two of the tiles each time
        done = subprocess.run(
            [sys.executable, "-c", KILLED, str(cache), str(left)],
            cwd=Path(__file__).parents[2],
            env=dict(os.environ),
            check=False,
        )
        n_killed += done.returncode == -9
        with Store.open(cache) as store:
            expected = containing(store, BALL)
            if store.edit_count():
                assert store.edited_nodes().tolist() in (expected.tolist(), [])
                check_tree(store)
    assert n_killed == 4
    assert done.returncode == 0
    with Store.open(cache) as store, Store.open(tmp_path / "new") as fresh:
        assert store.content_hash() == fresh.content_hash()


def test_what_cannot_be_replaced_is_refused(cache: Path) -> None:
    before = hash_of(cache)
    with Store.open(cache, read_only=False) as store:
        two = BatchBuilder()
        add_plane(two)
        add_sphere(two)
        nothing = dataclasses.replace(sphere(1.0), values=np.full_like(sphere(1.0).values, np.nan))
        with pytest.raises(MissingRecordError):
            replace_surface.replace_surface(store, 10, sphere(1.0))
        with pytest.raises(UsageError, match="one"):
            replace_surface.replace_surface(store, BALL, two.build())
        with pytest.raises(UsageError, match="tessellated"):
            replace_surface.replace_surface(store, BALL, nothing)
    assert hash_of(cache) == before


def test_edges_that_stay_are_shared_with_the_neighbours() -> None:
    """A part from itself and one of its own surfaces is meshed alike; another surface gets edges of its own."""
    part = shared_border()
    again = with_surface(part, 1, subset(part, [1]), 3)
    assert len(again.edges) == len(part.edges)
    one, two = tessellate(part, 0.01), tessellate(again, 0.01)
    assert (one.positions == two.positions).all()
    assert (one.triangles == two.triangles).all()
    other = BatchBuilder(part=0)
    add_cylinder(other, 1.5, 2.0)
    changed = with_surface(part, 1, other.build(), 3)
    assert len(np.unique(changed.edges["id"])) == len(changed.edges)
    assert (changed.edges["id"] >> np.uint64(32) == 3).all()
    mesh = tessellate(changed, 0.01)
    on_pipe = mesh.positions[mesh.vertex_start[1] :]
    assert np.linalg.norm(on_pipe[:, :2], axis=1) == pytest.approx(1.5)


def shared_border() -> GeometryBatch:
    """Two squares side by side with one edge in common."""
    builder = BatchBuilder(part=3)
    places = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [4, 0, 0], [4, 2, 0]], float)
    corners = [builder.vertex(place) for place in places]

    def edge(a: int, b: int) -> int:
        return builder.edge(CurveForm.line(places[a], places[b]), corners[a], corners[b])

    common = edge(1, 2)
    left, right = [edge(0, 1), common, edge(2, 3), edge(3, 0)], [edge(1, 4), edge(4, 5), edge(5, 2), common]
    for first, loop in ((0, left), (1, right)):
        low = 2.0 * first
        uv = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]], float)
        form = SurfaceForm.framed(SurfaceKind.PLANE, (low, 0.0, 0.0), *np.eye(3), domain=(0.0, 2.0, 0.0, 2.0))
        builder.surface(form)
        builder.loop(
            [
                Coedge(e, CurveForm.line(uv[k + 1], uv[k]), reversed=True)
                if first and e == common
                else Coedge(e, CurveForm.line(uv[k], uv[k + 1]))
                for k, e in enumerate(loop)
            ]
        )
    return builder.build()
