"""Hard cases and random faces with a bound of the normal: kept, or said not to be, and never exceeded."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.measure.attack_normals import attack_normals
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.case import HardCase
from tests.hard.catalogue import CASES
from tests.hard.fuzz_faces import ALL_KINDS, ERROR, fuzz_batch
from tests.hard.judge import judge
from tests.hard.test_fuzz import TAME
from tests.hard.variants import PLAIN, VARIANTS

ORDINARY = list(CASES.values())
DEGREES = (5.0, 1.0)
BATCHES, OF = 20, 50


@pytest.mark.parametrize("case", ORDINARY, ids=lambda case: case.name)
@pytest.mark.parametrize("degrees", DEGREES)
def test_kept_and_never_exceeded(case: HardCase, degrees: float) -> None:
    geometry = case.geometry()
    error = case.errors[min(1, len(case.errors) - 1)]
    mesh = tessellate(geometry, error, normal_error_deg=degrees)
    drawn = mesh.reason != FaceReason.EVEN_ODD_MASK
    assert (mesh.normal_error[drawn] <= degrees).all()
    assert judge(case, PLAIN, error, mesh) == []
    report = attack_mesh(geometry, mesh, 200, requested=error)
    assert report.violations == []
    assert (report.interpolated_normal_deg <= mesh.normal_error + 1e-4).all()


@pytest.mark.parametrize("name", ["rational_sphere", "rational_cone", "hypar", "crease_between_arcs"])
def test_far_from_the_origin(name: str) -> None:
    variant = next(v for v in VARIANTS if v.shift == 1e6)
    geometry = variant.change(CASES[name].geometry())
    mesh = tessellate(geometry, 0.1, normal_error_deg=5.0)
    assert mesh.normal_error.max() <= 5.0
    assert attack_normals(geometry, mesh, 400).violations == []


def _try_faces(seed: int, n: int, tame: bool) -> None:
    geometry = fuzz_batch(seed, n, TAME if tame else ALL_KINDS)
    mesh = tessellate(geometry, ERROR, normal_error_deg=3.0)
    assert (np.diff(mesh.triangle_start) > 0).all()
    over = mesh.normal_error > 3.0
    assert (mesh.status[over] >= FaceStatus.DEGRADED).all()
    report = attack_mesh(geometry, mesh, 100, requested=ERROR)
    assert report.violations == []
    if tame:
        assert over.mean() <= 0.5


def test_random_faces() -> None:
    _try_faces(3, 16, True)


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("batch", range(BATCHES))
def test_a_thousand_random_faces(batch: int) -> None:
    _try_faces(2000 + batch, OF, False)
