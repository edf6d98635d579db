"""Whole builds of a small scene: the stored bounds against distances measured by brute force."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.errors import CacheError, InputFileError, UsageError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.memory_store import MemoryStore
from nurbs_cache.store import Store
from nurbs_cache.surface_record import SurfaceKind
from nurbs_cache.tile import decode_tile
from nurbs_ooc.build import tunables
from nurbs_ooc.build.face_report import reason_counts
from nurbs_ooc.build.forest import Forest
from nurbs_ooc.build.on_demand import build_node_tile
from nurbs_ooc.build.report import contents
from nurbs_ooc.build.target import partial_path
from nurbs_ooc.geometry.surface import evaluate
from nurbs_ooc.measure.verify_cache import verify_cache
from tests.ooc.distances import samples_of, to_drawn
from tests.ooc.scenes import ball, hash_of, peg_board, run_build, write_scene


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("source") / "scene.nurbs")


@pytest.fixture(scope="module")
def built(source: Path) -> Path:
    cache = source.parent / "built"
    run_build(source, cache)
    return cache


def exact_distance(kind: int, frame: np.ndarray, domain: tuple[float, ...], points: np.ndarray) -> np.ndarray:
    """Distance of points in part space to a whole sphere, a cylinder about z or a rectangle in its plane."""
    p = points - frame[:3]
    if kind == SurfaceKind.SPHERE:
        return np.abs(np.linalg.norm(p, axis=1) - frame[12])
    if kind == SurfaceKind.CYLINDER:
        radial = np.linalg.norm(p[:, :2], axis=1) - np.linalg.norm(frame[3:6])
        return np.hypot(radial, np.maximum(0, np.maximum(domain[2] - p[:, 2], p[:, 2] - domain[3])))
    assert kind == SurfaceKind.PLANE
    outside = np.maximum(0, np.maximum([domain[0], domain[2]] - p[:, :2], p[:, :2] - [domain[1], domain[3]]))
    return np.sqrt((outside**2).sum(axis=1) + p[:, 2] ** 2)


def test_tiles_keep_their_bound_in_both_directions(built: Path) -> None:
    rng = np.random.default_rng(0)
    parts = [peg_board(), ball()]
    with Store.open(built) as store:
        nodes, items, occurrences = store.get_nodes(), store.get_items(), store.get_occurrences()
        for node in nodes[rng.permutation(len(nodes))[:12]]:
            tile = decode_tile(store.get_tile(bytes(node["tile_hash"])))
            positions = tile.origin + tile.positions.astype(float)
            drawn = positions, tile.triangles, tile.lines, tile.points
            samples = samples_of(*drawn, n=3)
            samples = samples[rng.permutation(len(samples))[:4000]]
            nearest, on_surfaces = np.full(len(samples), np.inf), []
            for item in items[node["first_item"] : node["first_item"] + node["n_items"]]:
                transform = occurrences["transform"][item["occurrence"]]
                linear, shift = transform[:, :3], transform[:, 3]
                part = parts[occurrences["part"][item["occurrence"]]]
                row = int(item["surface"]) - (0 if part is parts[0] else len(parts[0]))
                s = part.surfaces[row]
                domain = tuple(float(s[name]) for name in ("u0", "u1", "v0", "v1"))
                uv = rng.uniform([domain[0], domain[2]], [domain[1], domain[3]], (8, 2))
                on_surfaces.append(evaluate(part, row, uv)[0] @ linear.T + shift)
                frame = part.values[s["frame"] : s["frame"] + 14]
                distance = exact_distance(int(s["kind"]), frame, domain, (samples - shift) @ np.linalg.inv(linear).T)
                nearest = np.minimum(nearest, np.linalg.norm(linear, 2) * distance)
            assert to_drawn(np.concatenate(on_surfaces), *drawn).max() <= tile.ledger.total + 1e-9
            assert nearest.max() <= tile.ledger.total + 1e-9
            assert tile.ledger.total <= node["geometric_error"]


def test_budgets_are_kept_and_parents_promise_no_less(built: Path) -> None:
    with Store.open(built) as store:
        nodes = store.get_nodes()
        for node in nodes:
            ledger = decode_tile(store.get_tile(bytes(node["tile_hash"]))).ledger
            assert ledger.total <= 2.0 ** int(node["level"])
            if node["parent"] >= 0:
                assert nodes["geometric_error"][node["parent"]] >= node["geometric_error"]
    assert len(nodes) > 5


def test_a_bound_of_primitives_holds_and_the_errors_stay_honest(
    source: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tunables, "PRIMITIVES_PER_NODE", 300)
    run_build(source, tmp_path / "bound")
    with Store.open(tmp_path / "bound") as store, Store.open(built) as free:
        nodes, before = store.get_nodes(), free.get_nodes()
        was_larger = before["n_triangles"] + before["n_lines"] + before["n_points"] > 300
        assert 0 < was_larger.sum() < len(nodes)
        assert (nodes["n_triangles"] + nodes["n_lines"] + nodes["n_points"] <= 300).all()
        assert (nodes["tile_hash"][~was_larger] == before["tile_hash"][~was_larger]).all()
        assert (nodes["geometric_error"][was_larger] > before["geometric_error"][was_larger]).all()
        inner = nodes["parent"] >= 0
        assert (nodes["geometric_error"][nodes["parent"][inner]] >= nodes["geometric_error"][inner]).all()
        assert not verify_cache(store, samples=20_000).violations


def test_counts_in_the_node_table_are_those_of_the_tiles(built: Path) -> None:
    with Store.open(built) as store:
        for node in store.get_nodes():
            data = store.get_tile(bytes(node["tile_hash"]))
            tile = decode_tile(data)
            counts = (len(tile.triangles), len(tile.lines), len(tile.points))
            assert counts == (node["n_triangles"], node["n_lines"], node["n_points"])
            assert node["tile_bytes"] == len(data)


def test_tiny_surfaces_are_points_in_coarse_nodes(built: Path) -> None:
    with Store.open(built) as store:
        root = store.get_nodes()[0]
        assert root["n_points"] > 0


def test_same_bytes_for_any_number_of_workers(source: Path, built: Path, tmp_path: Path) -> None:
    run_build(source, tmp_path / "two", workers=2)
    assert hash_of(tmp_path / "two") == hash_of(built)


def test_roots_only_then_the_rest_is_the_whole(source: Path, built: Path, tmp_path: Path) -> None:
    cache = tmp_path / "roots"
    run_build(source, cache, levels="root")
    with Store.open(cache) as store:
        nodes = store.get_nodes()
        assert ((nodes["tile_hash"] != b"") == (nodes["parent"] < 0)).all()
        assert (nodes["geometric_error"][1:] <= nodes["geometric_error"][nodes["parent"][1:]])[
            nodes["parent"][1:] >= 0
        ].all()
    run_build(source, cache, levels="all", resume=True)
    assert hash_of(cache) == hash_of(built)


def test_an_existing_cache_is_refused_and_stays_whole(source: Path, built: Path, tmp_path: Path) -> None:
    before = hash_of(built)
    with pytest.raises(UsageError, match="--force"):
        run_build(source, built)
    (tmp_path / "bad.step").write_text("nonsense")
    with pytest.raises(InputFileError):
        run_build(tmp_path / "bad.step", built, force=True)
    assert hash_of(built) == before
    with pytest.raises(CacheError, match="inputs"):
        run_build(write_scene(tmp_path / "other.nurbs", n=2), built, resume=True)
    assert hash_of(built) == before


def test_force_replaces(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    run_build(source, cache, levels="root")
    other = write_scene(tmp_path / "other.nurbs", n=2)
    run_build(other, cache, levels="root", force=True)
    with Store.open(cache) as store:
        assert store.get_provenance()["inputs"][0]["name"] == "other.nurbs"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "other.nurbs"]


def test_leftovers_need_a_word_from_the_user(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    Store.create(partial_path(cache)).close()
    with pytest.raises(UsageError, match="--resume"):
        run_build(source, cache)
    run_build(source, cache, levels="root", force=True)
    assert not partial_path(cache).exists()


def test_a_folder_that_is_no_cache_is_left_alone(source: Path, tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "love.txt").write_text("dear")
    with pytest.raises(CacheError, match="left alone"):
        run_build(source, tmp_path / "letters", force=True)


def test_input_as_output_is_refused(source: Path) -> None:
    with pytest.raises(UsageError, match="input"):
        run_build(source, source, force=True)


def test_several_inputs_make_one_scene(source: Path, tmp_path: Path) -> None:
    other = write_scene(tmp_path / "other.nurbs", n=2)
    cache = tmp_path / "both"
    run_build([source, other], cache, levels="root")
    with Store.open(cache) as store:
        report = contents(store)
        assert report["parts"] == 4
        assert report["occurrences"] == 14
        assert report["materials"] == 2
        assert report["surfaces"] == 33 + 1 + 9 + 1
        edges = store.get_part(2).edges["id"]
        assert (edges >> np.uint64(32) == 2).all()
        assert store.locate_surface(34) == (2, 0)


def test_scene_without_surfaces(tmp_path: Path) -> None:
    with Store.create(tmp_path / "empty.nurbs") as store:
        store.put_scene([], [], np.zeros(0, store.get_occurrences().dtype), {"stored": "mm"})
    run_build(tmp_path / "empty.nurbs", tmp_path / "cache")
    with Store.open(tmp_path / "cache") as store:
        assert contents(store)["nodes"] == 0


def test_jobs_are_bounded_and_do_not_change_the_tiles(
    source: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tunables, "MESHES_PER_JOB", 10)
    monkeypatch.setattr(tunables, "SURFACES_PER_RUN", 3)
    with Store.open(built) as store:
        forest = Forest.load(store)
        rows = np.arange(len(forest.nodes))
        jobs = list(forest.jobs(rows))
        assert sorted(np.concatenate(jobs).tolist()) == rows.tolist()
        levels = [forest.nodes["level"][job] for job in jobs]
        assert all(len(set(level.tolist())) == 1 for level in levels)
        assert [level[0] for level in levels] == sorted((level[0] for level in levels), reverse=True)
        assert len(jobs) > len({int(level[0]) for level in levels})
    run_build(source, tmp_path / "small")
    assert hash_of(tmp_path / "small") == hash_of(built)


def test_codec_is_chosen_per_build_and_kept(source: Path, tmp_path: Path) -> None:
    tiles: dict[str, dict[int, int]] = {}
    for codec in ("zstd", "huffman"):
        run_build(source, tmp_path / codec, codec=codec, levels="root")
        with Store.open(tmp_path / codec, read_only=False) as store:
            missing = int(np.flatnonzero(store.get_nodes()["tile_hash"] == b"")[0])
            build_node_tile(store, missing)
            used = [coder for _, data in store.scan("tiles") for coder in data[121 : 121 + 12 * data[10] : 12]]
        tiles[codec] = dict(Counter(used))
    assert set(tiles["zstd"]) <= {0, 1} and tiles["zstd"][1]
    assert set(tiles["huffman"]) <= {0, 2} and tiles["huffman"][2]
    with pytest.raises(CacheError, match="codec"):
        run_build(source, tmp_path / "huffman", codec="zstd", resume=True)


def test_reasons_are_counted_by_status() -> None:
    rows = np.zeros(5, FACE_REPORT_DTYPE)
    rows["surface"] = np.arange(5)
    rows["status"], rows["reason"] = [0, 2, 1, 1, 1], [0, 55, 55, 55, 12]
    store = MemoryStore()
    assert reason_counts(store) == {}
    store.put_face_report(rows)
    assert reason_counts(store) == {"healed LOOP_GAP_CLOSED": 1, "healed FILE_GAP": 2, "degraded FILE_GAP": 1}
