"""Every hard case in every variant against its closed form, and under the independent attack."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.case import HardCase
from tests.hard.catalogue import CASES
from tests.hard.judge import applies, judge
from tests.hard.variants import PLAIN, VARIANTS, Variant

ORDINARY = list(CASES.values())
PAIRS = [(case, variant) for case in ORDINARY for variant in VARIANTS if applies(case, variant, case.geometry())]


def ids_of(pairs: list[tuple[HardCase, Variant]]) -> list[str]:
    return [f"{case.name}-{variant.name}" for case, variant in pairs]


@lru_cache(maxsize=4)
def meshes_of(name: str, variant: Variant) -> tuple[GeometryBatch, list[MeshBatch]]:
    geometry = variant.change(CASES[name].geometry())
    return geometry, [tessellate(geometry, error * variant.scale) for error in CASES[name].errors]


def attack_case(case: HardCase, variant: Variant, samples: int) -> list[str]:
    geometry, meshes = meshes_of(case.name, variant)
    broken = []
    for error, mesh in zip(case.errors, meshes, strict=True):
        report = attack_mesh(geometry, mesh, samples, requested=error * variant.scale)
        broken += [f"{error}: {violation}" for violation in report.violations]
    return broken


@pytest.mark.parametrize(("case", "variant"), PAIRS, ids=ids_of(PAIRS))
def test_truth(case: HardCase, variant: Variant) -> None:
    _, meshes = meshes_of(case.name, variant)
    broken = {e: judge(case, variant, e, m) for e, m in zip(case.errors, meshes, strict=True)}
    assert not any(broken.values()), broken


@pytest.mark.parametrize("case", ORDINARY, ids=lambda case: case.name)
def test_attack(case: HardCase) -> None:
    assert attack_case(case, PLAIN, 200) == []


@pytest.mark.long
@pytest.mark.parametrize(("case", "variant"), PAIRS, ids=ids_of(PAIRS))
def test_attack_variants(case: HardCase, variant: Variant) -> None:
    assert attack_case(case, variant, 200) == []


@pytest.mark.parametrize("variant", [v for v in VARIANTS if v.scale != 1.0], ids=lambda v: v.name)
@pytest.mark.parametrize("case", ORDINARY, ids=lambda case: case.name)
def test_a_scale_that_is_a_power_of_two_changes_nothing(case: HardCase, variant: Variant) -> None:
    for one, other in zip(meshes_of(case.name, PLAIN)[1], meshes_of(case.name, variant)[1], strict=True):
        assert np.array_equal(one.triangles, other.triangles)
        assert np.array_equal(one.positions * variant.scale, other.positions)


@pytest.mark.parametrize("prefix", ["", "rational_"])
def test_a_cylinder_costs_the_same_however_long(prefix: str) -> None:
    short, long = (meshes_of(f"{prefix}thin_cylinder_{n}_long", PLAIN)[1] for n in ("1", "1e5"))
    assert [len(m.triangles) for m in short] == [len(m.triangles) for m in long]


def test_degree_25_is_the_same_sphere() -> None:
    mesh = meshes_of("sphere_degree_25", PLAIN)[1][-1]
    assert np.abs(np.linalg.norm(mesh.positions, axis=1) - 1.0).max() < 1e-12


def test_knots_anywhere_give_the_same_sphere() -> None:
    # Knots of 1e9 .. 1e9 + 1 keep seven digits of the parameter: the set is the same, the mesh nearly.
    counts = {
        name: len(meshes_of(name, PLAIN)[1][-1].triangles)
        for name in ("rational_sphere", "sphere_knots_0_to_1e-12", "sphere_knots_1e9_to_1e9+1")
    }
    assert max(counts.values()) <= 1.3 * min(counts.values()), counts
