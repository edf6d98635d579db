"""Runs of surfaces: whole parts or pieces of one, tessellated as if nothing had been cut."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.memory_store import MemoryStore
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build import tunables
from nurbs_ooc.build.mesh_demand import MeshDemand, key_levels, key_surfaces, mesh_keys
from nurbs_ooc.build.run_geometry import RunGeometry, part_batches
from nurbs_ooc.build.surface_meshes import mesh_levels, mesh_slices
from nurbs_ooc.build.surface_runs import geometry_around, surface_runs
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.geometry.sample_faces import add_plane
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.hlod.mesh_pool import SLOT_DTYPE, MeshPool
from nurbs_ooc.tessellation.mesh import MeshBatch, take_faces
from nurbs_ooc.tessellation.tessellate import Tessellator, smallest_error, tessellate
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


def same(one: MeshBatch, other: MeshBatch) -> None:
    """Both have the same faces, whatever rows these are of."""
    for field in dataclasses.fields(MeshBatch):
        if field.name != "faces":
            assert np.array_equal(getattr(one, field.name), getattr(other, field.name)), field.name


@pytest.mark.parametrize("error", [4.0, 0.25])
def test_what_is_far_does_not_change_a_tessellation(part: GeometryBatch, error: float) -> None:
    rows = np.sort(np.random.default_rng(0).permutation(len(part))[:6])
    near, kept = geometry_around(part, rows)
    assert len(near) < len(part)
    whole, cut = tessellate(part, error, faces=rows), tessellate(near, error, faces=np.searchsorted(kept, rows))
    same(whole, cut)


def of_part(part: GeometryBatch, first_surface: int) -> RunGeometry:
    """A run that is one whole part."""
    return RunGeometry(part, first_surface + np.arange(len(part)), np.full(len(part), smallest_error(part)))


def test_meshes_do_not_depend_on_who_asks(part: GeometryBatch) -> None:
    rng = np.random.default_rng(1)
    surfaces = np.sort(rng.permutation(len(part))[: len(part) // 2]).astype(np.uint64)
    demanded = mesh_keys(surfaces + np.uint64(100), np.full(len(surfaces), -1))
    whole = MeshPool.join(mesh_levels(of_part(part, 100), demanded, demanded))
    own = demanded[:3]
    some = MeshPool.join(mesh_levels(of_part(part, 100), own, demanded))
    assert (some.slots["key"] == own).all()
    assert (some.slots["checksum"] == whole.slots["checksum"][:3]).all()


@pytest.mark.parametrize("error", [4.0, 0.25])
def test_faces_that_are_not_present_have_no_say(part: GeometryBatch, error: float) -> None:
    rng = np.random.default_rng(3)
    present = np.sort(rng.permutation(len(part))[: len(part) // 2])
    faces = np.sort(rng.permutation(present)[:7])
    expected = tessellate(subset(part, present), error, faces=np.searchsorted(present, faces))
    same(Tessellator(part).mesh(error, faces=faces, present=present), expected)


def test_parts_in_one_batch_are_as_if_alone(part: GeometryBatch) -> None:
    parts = [subset(part, np.arange(low, high)) for low, high in ((3, 9), (20, 60), (9, 11))]
    mesh = Tessellator(join_parts(parts)).mesh(0.5)
    first = 0
    for alone in parts:
        same(take_faces(mesh, np.arange(first, first + len(alone))), tessellate(alone, 0.5))
        first += len(alone)


def test_a_level_beyond_float64_is_that_of_float64() -> None:
    builder = BatchBuilder()
    add_plane(builder, 1e9, 1e9)
    add_plane(builder, 1.0, 1.0)
    part = builder.build()
    near = dataclasses.replace(of_part(part, 0), smallest=np.array([smallest_error(part), 0.0]))
    keys = np.sort(mesh_keys(np.array([0, 1, 1], np.uint64), np.array([-40, -40, 3])))
    pools = mesh_levels(near, keys, keys)
    assert [pool.slots["key"].tolist() for pool in pools] == [keys[:2].tolist(), keys[2:].tolist()]
    assert MeshPool.join(pools).slots["n_triangles"].tolist() == [2, 2, 2]


def test_small_batches_give_what_large_ones_do(part: GeometryBatch, monkeypatch: pytest.MonkeyPatch) -> None:
    others = [subset(part, rows) for rows in (np.arange(5), np.arange(7, 30))]
    store, parts = MemoryStore(), [others[0], part, others[1]]
    firsts = [0, len(parts[0]), len(parts[0]) + len(part)]
    store.put_parts((i, PartInfo("", len(p), firsts[i]), p) for i, p in enumerate(parts))
    monkeypatch.setattr(tunables, "SURFACES_PER_RUN", 10_000)
    run = surface_runs(store.part_infos())[0]
    rng = np.random.default_rng(4)
    ids = np.sort(rng.permutation(run.n_surfaces)[: run.n_surfaces * 9 // 10]).astype(np.uint64)
    keys = np.unique(mesh_keys(np.repeat(ids, 2), rng.integers(-1, 3, 2 * len(ids))))
    whole = MeshPool.join(mesh_slices(store, run.slices, keys, keys))
    assert len(list(part_batches(store, run.slices))) == 1
    monkeypatch.setattr(tunables, "BATCH_BYTES", part.values.nbytes // 7)
    batches = list(part_batches(store, run.slices))
    assert len(batches) > 7
    assert [
        s for batch in batches for cut, _ in batch for s in range(cut.first_surface, cut.first_surface + cut.n_surfaces)
    ] == list(range(run.n_surfaces))
    small = MeshPool.join(mesh_slices(store, run.slices, keys, keys))
    for name in SLOT_DTYPE.names or ():
        assert (small.slots[name] == whole.slots[name]).all(), name
    assert (small.words == whole.words).all()
    assert (small.slots["key"] == keys).all()


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
