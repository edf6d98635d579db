"""Runs of surfaces: whole parts or pieces of one, tessellated as if nothing had been cut."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build import tunables
from nurbs_ooc.build.mesh_demand import MeshDemand, key_levels, key_surfaces, mesh_keys
from nurbs_ooc.build.surface_meshes import mesh_part
from nurbs_ooc.build.surface_runs import geometry_around, surface_runs
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.ooc.test_build_resume import environment


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> GeometryBatch:
    """The part with the most faces of a small car: curved, trimmed, with shared edges."""
    path = tmp_path_factory.mktemp("car") / "car.nurbs"
    command = [sys.executable, "-m", "nurbs_ooc", "synth", "golf", "--surfaces", "1600", "-o", str(path)]
    subprocess.run(command, env=environment(), check=True, cwd=Path(__file__).parents[2])
    with Store.open(path) as store:
        infos = store.part_infos()
        return store.get_part(max(range(len(infos)), key=lambda i: infos[i].n_surfaces))


@pytest.mark.parametrize("error", [4.0, 0.25])
def test_what_is_far_does_not_change_a_tessellation(part: GeometryBatch, error: float) -> None:
    rows = np.sort(np.random.default_rng(0).permutation(len(part))[:6])
    near, kept = geometry_around(part, rows)
    assert len(near) < len(part)
    whole, cut = tessellate(part, error, faces=rows), tessellate(near, error, faces=np.searchsorted(kept, rows))
    for name in ("positions", "normals", "triangles", "segments", "surface_error", "trim_error", "pcurve_error"):
        assert (getattr(whole, name) == getattr(cut, name)).all()


def test_meshes_do_not_depend_on_who_asks(part: GeometryBatch) -> None:
    rng = np.random.default_rng(1)
    surfaces = np.sort(rng.permutation(len(part))[: len(part) // 2]).astype(np.uint64)
    demanded = mesh_keys(surfaces + np.uint64(100), np.full(len(surfaces), -1))
    whole = MeshPool.join(mesh_part(part, 100, demanded, demanded))
    own = demanded[:3]
    some = MeshPool.join(mesh_part(part, 100, own, demanded))
    assert (some.slots["key"] == own).all()
    assert (some.slots["checksum"] == whole.slots["checksum"][:3]).all()


def test_runs_hold_every_surface_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tunables, "SURFACES_PER_RUN", 10)
    sizes = [3, 0, 4, 57, 1, 9, 10, 2]
    firsts = np.cumsum([0, *sizes])[:-1]
    infos = [PartInfo("", n, int(first)) for n, first in zip(sizes, firsts, strict=True)]
    runs = surface_runs(infos)
    ids = [
        s
        for run in runs
        for piece in run.slices
        for s in range(piece.first_surface, piece.first_surface + piece.n_surfaces)
    ]
    assert ids == list(range(sum(sizes)))
    for run in runs:
        assert run.n_surfaces == sum(piece.n_surfaces for piece in run.slices) < 30
        assert run.first_surface == run.slices[0].first_surface
        for piece in run.slices:
            assert piece.first_of_part == infos[piece.part].first_surface
            assert piece.whole == (piece.n_surfaces == infos[piece.part].n_surfaces)
    assert surface_runs([]) == []


def test_demand_is_found_by_surface() -> None:
    rng = np.random.default_rng(2)
    surfaces, levels = rng.integers(0, 50, 200).astype(np.uint64), rng.integers(-40, 40, 200)
    keys = np.unique(mesh_keys(surfaces, levels))
    demand = MeshDemand(rng.permutation(keys))
    assert len(demand) == len(keys)
    for first, count in ((0, 50), (10, 1), (20, 7), (49, 100), (60, 3)):
        inside = (key_surfaces(keys) >= first) & (key_surfaces(keys) < first + count)
        assert demand.of_surfaces(first, count).tolist() == keys[inside].tolist()
    assert set(key_levels(keys).tolist()) <= set(levels.tolist())
