"""Random trimmed faces: nothing lost, nothing broken, and a code wherever a face is not exact."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.tessellation import tessellate as driver
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.split_segments import split_segments
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.apart import tessellate_apart
from tests.hard.fuzz_faces import ALL_KINDS, CROSSING, ERROR, Kinds, fuzz_batch, without
from tests.hard.lattice_step import lattice_step
from tests.hard.mesh_measures import corners

# What is done in no time.
TAME = replace(without(ALL_KINDS, "wild_weights", "tangled"), lowest_degree=2)
BATCHES, OF = 40, 250  # all draws: 10,000 faces
SAMPLES = 120
# A face that may move so far within one step of the lattice may end with the bound it has, mm. Weights eight decades
# apart and kinks closer than 1e-5 do that.
VISIBLE_STEP = 0.001 * ERROR
# Of a batch of all kinds so many may end degraded for other reasons, with a bound that holds: steep strips between
# knots closer than 1e-4 of the domain can want more points than a face is given.
DEGRADED_SHARE = 0.01
LIMIT_S = 1200  # a batch is a matter of seconds; this only ends what does not end by itself


def degraded_faces(geometry: GeometryBatch, mesh: MeshBatch) -> list[str]:
    """Faces that keep less than was asked for although they could, a line each."""
    lines = []
    for i in np.flatnonzero(mesh.status >= FaceStatus.DEGRADED):
        name = geometry.sources[int(geometry.surfaces["source"][mesh.faces[i]])]
        too_fast = lattice_step(geometry, int(mesh.faces[i])) > VISIBLE_STEP
        unreachable = mesh.reason[i] == FaceReason.BUDGET_EXHAUSTED and too_fast
        if CROSSING not in name and not unreachable:
            lines.append(f"degraded, reason {mesh.reason[i]}, certified {mesh.certified_error[i]:.4g} mm: {name}")
    return lines


def broken_promises(geometry: GeometryBatch, mesh: MeshBatch) -> list[str]:
    """What is wrong with the mesh of a fuzzed batch, a line each."""
    name = [geometry.sources[int(geometry.surfaces["source"][row])] for row in mesh.faces]
    lines = [f"lost: {name[i]}" for i in np.flatnonzero(np.diff(mesh.triangle_start) == 0)]
    if not (np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all()):
        return [*lines, "not finite"]
    p = corners(mesh)
    flat = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) == 0.0
    of = np.repeat(np.arange(len(name)), np.diff(mesh.triangle_start))
    lines += [
        f"{n} triangles without area: {name[i]}" for i, n in enumerate(np.bincount(of[flat], minlength=len(name))) if n
    ]
    over = (mesh.certified_error > ERROR) & (mesh.status == FaceStatus.EXACT)
    lines += [f"certified {mesh.certified_error[i]:.4g} mm and called exact: {name[i]}" for i in np.flatnonzero(over)]
    report = attack_mesh(geometry, mesh, SAMPLES, requested=ERROR)
    return lines + [str(violation) for violation in report.violations]


def try_faces(seed: int, n: int, kinds: Kinds, folder: Path) -> tuple[list[str], list[str]]:
    """Broken promises and degraded faces of a batch."""
    geometry = fuzz_batch(seed, n, kinds)
    mesh = tessellate_apart(geometry, ERROR, folder, LIMIT_S)
    return (["refused"], []) if mesh is None else (broken_promises(geometry, mesh), degraded_faces(geometry, mesh))


def test_the_same_seed_gives_the_same_faces() -> None:
    one, same, longer = fuzz_batch(5, 8), fuzz_batch(5, 8), fuzz_batch(5, 12)
    for table in ("surfaces", "loops", "coedges", "edges", "curves", "vertices", "values"):
        assert np.array_equal(getattr(one, table), getattr(same, table))
    assert np.array_equal(one.values, longer.values[: len(one.values)])
    assert longer.sources[:8] == one.sources


def test_threads_do_not_matter_to_faces_that_are_done_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    geometry = fuzz_batch(3, 60, TAME)
    cuts = []
    monkeypatch.setattr(driver, "split_segments", lambda *given: cuts.append(1) or split_segments(*given))
    one = tessellate(geometry, ERROR)
    assert cuts
    for workers in (2, 5):
        many = tessellate(geometry, ERROR, workers=workers)
        for field in fields(MeshBatch):
            assert np.array_equal(getattr(one, field.name), getattr(many, field.name)), field.name


def test_sample(tmp_path: Path) -> None:
    assert try_faces(0, 200, TAME, tmp_path) == ([], [])


@pytest.mark.long
@pytest.mark.timeout(2 * LIMIT_S)
@pytest.mark.parametrize("batch", range(BATCHES))
def test_ten_thousand_faces(batch: int, tmp_path: Path) -> None:
    broken, degraded = try_faces(1000 + batch, OF, ALL_KINDS, tmp_path)
    assert broken == []
    assert len(degraded) <= DEGRADED_SHARE * OF, degraded
