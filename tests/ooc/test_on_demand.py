"""Tiles built when asked for are those of the batch build."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.errors import MissingRecordError, UsageError
from nurbs_cache.store import Store
from nurbs_cache.tile import decode_tile
from nurbs_ooc.build.on_demand import build_node_tile, build_surface_lod
from tests.ooc.distances import to_triangles
from tests.ooc.scenes import run_build, write_scene


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("source") / "scene.nurbs", n=2)


@pytest.fixture(scope="module")
def whole(source: Path) -> np.ndarray:
    run_build(source, source.parent / "whole")
    with Store.open(source.parent / "whole") as store:
        return store.get_nodes()


def test_all_nodes_on_demand_are_the_batch_build(source: Path, whole: np.ndarray, tmp_path: Path) -> None:
    run_build(source, tmp_path / "cache", levels="root")
    rows = np.random.default_rng(0).permutation(np.flatnonzero(whole["parent"] >= 0))
    with Store.open(tmp_path / "cache", read_only=False) as store:
        for row in rows.tolist():
            name, data = build_node_tile(store, row)
            assert store.get_tile(name) == data
            nodes = store.get_nodes()
            inner = nodes["parent"] >= 0
            assert (nodes["geometric_error"][nodes["parent"][inner]] >= nodes["geometric_error"][inner]).all()
        assert (store.get_nodes() == whole).all()


def test_surface_lod_keeps_its_level(source: Path, tmp_path: Path) -> None:
    run_build(source, tmp_path / "cache", levels="root")
    with Store.open(tmp_path / "cache", read_only=False) as store:
        ball = 9
        errors = []
        for level in (0, -2, -5):
            record, data = build_surface_lod(store, ball, level)
            tile = decode_tile(data)
            assert record["geometric_error"] == tile.ledger.total <= 2.0**level
            assert record["n_triangles"] == len(tile.triangles)
            positions = tile.origin + tile.positions.astype(float)
            directions = np.random.default_rng(1).normal(size=(200, 3))
            points = 3.0 * directions / np.linalg.norm(directions, axis=1)[:, None]
            assert to_triangles(points, positions[tile.triangles]).max() <= record["geometric_error"]
            errors.append(float(record["geometric_error"]))
        assert errors == sorted(errors, reverse=True)
        assert store.get_lods(ball)["level"].tolist() == [-5, -2, 0]
        assert store.get_tile(bytes(store.get_lods(ball)["tile_hash"][0])) == data


def test_asking_for_what_is_not_there(source: Path, tmp_path: Path) -> None:
    run_build(source, tmp_path / "cache", levels="root")
    with Store.open(tmp_path / "cache", read_only=False) as store:
        with pytest.raises(MissingRecordError):
            build_surface_lod(store, 10, 0)
        with pytest.raises(UsageError, match="level"):
            build_surface_lod(store, 0, 99)
        with pytest.raises(UsageError, match="node"):
            build_node_tile(store, 10_000)
