"""What a mesh is really off by: positions both ways, and interpolated normals, whatever it promises."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.attack_mesh import AttackReport, attack_mesh
from nurbs_ooc.measure.attack_normals import attack_normals
from nurbs_ooc.tessellation.mesh import NOT_ASKED, MeshBatch

FIRST_GUESS = 30.0  # times what was asked for: a mesh without a promise is hardly ever further off
ROOM = 1.5  # over what the first look found, for the second
LEAST = 1e-3  # of the request: below it distances are not told from 0

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measured:
    """One part's mesh, face by face; lengths in mm, angles in degrees.

    Attributes:
        largest, mean: (n,) distances; of all samples in both directions, and from surface to mesh.
        certified: (n,) what the mesh promises; NaN where it promises nothing.
        normal_largest, normal_mean: of the interpolated normals, over the part.
        n_samples: distances that were measured.
        violations, lost: faces that break their promise; faces without triangles.
    """

    largest: Floats
    mean: Floats
    certified: Floats
    normal_largest: float
    normal_mean: float
    n_samples: int
    violations: int
    lost: int


def measure_mesh(
    geometry: GeometryBatch, mesh: MeshBatch, requested: float, certified: bool, samples: int, seed: int
) -> Measured:
    """Sample, climb, and compare normals.

    Args:
        geometry: the surfaces.
        mesh: their triangles.
        requested: mm, the order of the error.
        certified: the mesh's own bound counts and is attacked; else distances alone are measured.
        samples: a face and direction.
        seed: equal seeds give equal numbers.
    """
    n = len(mesh.faces)
    if certified:
        report = attack_mesh(geometry, mesh, samples, seed, requested)
        promised = report.certified
    else:
        report = _unpromised(geometry, mesh, requested, samples, seed)
        promised = np.full(n, np.nan)
    seen = attack_normals(geometry, replace(mesh, normal_error=NOT_ASKED), samples, seed)
    broken = {v.row for v in report.violations if v.kind in ("surface to mesh", "mesh to surface")}
    return Measured(
        largest=report.measured, mean=report.surface_to_mesh_mean, certified=promised,
        normal_largest=float(seen.largest.max(initial=0.0)), normal_mean=seen.mean,
        n_samples=report.n_samples, violations=len(broken) if certified else 0,
        lost=int((np.diff(mesh.triangle_start) == 0).sum()),
    )  # fmt: skip


def _unpromised(geometry: GeometryBatch, mesh: MeshBatch, requested: float, samples: int, seed: int) -> AttackReport:
    """Look twice, or three times: how finely boundaries must be told apart follows from how far the mesh is off."""
    n = len(mesh.faces)
    zero = np.zeros(n)
    guess = np.full(n, FIRST_GUESS * requested)
    for _ in range(2):
        trial = replace(mesh, surface_error=guess, trim_error=zero, pcurve_error=zero)
        report = attack_mesh(geometry, trial, samples, seed)
        guess = ROOM * report.measured + LEAST * requested
    # That no foot was found does not make a mesh point far: let the attack prove it.
    doubtful = report.mesh_to_surface_max > np.maximum(ROOM * report.surface_to_mesh_max, requested)
    if doubtful.any():
        guess = np.where(doubtful, ROOM * report.surface_to_mesh_max + LEAST * requested, guess)
        report = attack_mesh(
            geometry, replace(mesh, surface_error=guess, trim_error=zero, pcurve_error=zero), samples, seed
        )
    return report
