"""Error against cost: every variant at every setting of its dial, on all parts of a model."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.accuracy.encoded import encoded_bytes
from nurbs_ooc.accuracy.measured import Measured, measure_mesh
from nurbs_ooc.accuracy.variants import Variant
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.trim_region import TrimRegion
from nurbs_ooc.tessellation.mesh import MeshBatch

SHORT_S, MOST_RUNS = 0.2, 5  # what takes no more CPU time in all is timed again, so often at most
SAMPLES_OF_THE_BOX = 40  # a face
SHOWN = 1e-6  # of the request: a face measured below it has no ratio worth a number


@dataclass(frozen=True)
class CurvePoint:
    """One variant at one setting; lengths in mm, angles in degrees, None where nothing is promised.

    Attributes:
        variant, setting: which; the setting is a share of the diagonal, or steps of a grid.
        requested_mm: None for grids.
        certified_mm, measured_max_mm, measured_mean_mm: over all faces.
        ratio_median, ratio_max: certified / measured, over the faces that are off at all.
        normal_max_deg, normal_mean_deg: interpolated against exact.
        faces, lost_faces, faces_over_request, violations, samples: counts.
        triangles, vertices, bytes: drawn once, as a cache encodes them.
        seconds: CPU, one core, meshing alone, warm.
    """

    variant: str
    setting: float
    requested_mm: float | None
    certified_mm: float | None
    measured_max_mm: float
    measured_mean_mm: float
    ratio_median: float | None
    ratio_max: float | None
    normal_max_deg: float
    normal_mean_deg: float
    faces: int
    lost_faces: int
    faces_over_request: int
    violations: int
    samples: int
    triangles: int
    vertices: int
    bytes: int
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """By name."""
        return asdict(self)


@dataclass(frozen=True)
class Effort:
    """How much is spent.

    Attributes:
        samples: a face and direction.
        most_triangles: settings expected to give more are left out.
        seed: of all samples.
    """

    samples: int = 100
    most_triangles: int = 2_000_000
    seed: int = 0


def diagonal(parts: Sequence[GeometryBatch]) -> float:
    """Of the largest part's box, mm, by samples of its faces: placements do not matter."""
    largest = 0.0
    for geometry in parts:
        if len(geometry):
            found = sample_faces(TrimRegion(geometry, np.arange(len(geometry)), 1.0), SAMPLES_OF_THE_BOX, 0).points
            finite = found[np.isfinite(found).all(axis=1)]
            if len(finite):
                largest = max(largest, float(np.linalg.norm(np.ptp(finite, axis=0))))
    return largest


def _meshed(variant: Variant, prepared: Sequence[Any], dial: float) -> tuple[list[MeshBatch], float]:
    """All parts' meshes, and the median of their CPU seconds over some runs if one is over in no time."""
    seconds: list[float] = []
    while not seconds or (len(seconds) < MOST_RUNS and sum(seconds) < SHORT_S):
        made = [variant.mesh(one, dial) for one in prepared]
        seconds.append(sum(s for _, s in made))
    return [m for m, _ in made], statistics.median(seconds)


def curve(
    parts: Sequence[GeometryBatch], variant: Variant, size: float, effort: Effort, on_setting: Callable[[], None]
) -> Iterator[CurvePoint]:
    """One variant's points, coarse to fine, until one would need more than ``effort.most_triangles``.

    Args:
        parts: of the model, each once.
        variant: what makes the triangles.
        size: the model's diagonal, mm.
        effort: how much is spent.
        on_setting: called after each setting.
    """
    prepared = [variant.prepare(geometry) for geometry in parts]
    before: list[int] = []
    for k, setting in enumerate(variant.settings):
        if len(before) > 1 and before[-1] ** 2 / max(before[-2], 1) > effort.most_triangles:
            return
        dial = setting * size if variant.dial == "error" else setting
        if not k:  # the first call loads compiled kernels
            variant.mesh(prepared[0], dial)
        meshes, seconds = _meshed(variant, prepared, dial)
        requested = dial if variant.dial == "error" else 1e-3 * size
        measured = [
            measure_mesh(g, m, requested, variant.certified, effort.samples, effort.seed)
            for g, m in zip(parts, meshes, strict=True)
        ]
        yield _point(variant, setting, requested, meshes, measured, seconds)
        on_setting()
        before.append(sum(len(m.triangles) for m in meshes))


def _point(
    variant: Variant, setting: float, requested: float, meshes: list[MeshBatch], found: list[Measured], seconds: float
) -> CurvePoint:
    largest = np.concatenate([f.largest for f in found])
    certified = np.concatenate([f.certified for f in found])
    worst = float(largest.max(initial=0.0))
    shown = largest > SHOWN * requested
    ratio = certified[shown] / largest[shown] if variant.certified else np.empty(0)
    asked = variant.dial == "error"
    return CurvePoint(
        variant=variant.name,
        setting=setting,
        requested_mm=requested if asked else None,
        certified_mm=float(certified.max(initial=0.0)) if variant.certified else None,
        measured_max_mm=worst,
        measured_mean_mm=float(np.concatenate([f.mean for f in found]).mean()) if len(largest) else 0.0,
        ratio_median=float(np.median(ratio)) if len(ratio) else None,
        ratio_max=float(ratio.max()) if len(ratio) else None,
        normal_max_deg=max((f.normal_largest for f in found), default=0.0),
        normal_mean_deg=float(np.mean([f.normal_mean for f in found])),
        faces=len(largest),
        lost_faces=sum(f.lost for f in found),
        faces_over_request=int((largest > requested * (1.0 + 1e-9)).sum()) if asked else 0,
        violations=sum(f.violations for f in found),
        samples=sum(f.n_samples for f in found),
        triangles=sum(len(m.triangles) for m in meshes),
        vertices=sum(len(m.positions) for m in meshes),
        bytes=sum(encoded_bytes(m, worst or requested) for m in meshes),
        seconds=seconds,
    )
