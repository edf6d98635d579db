"""Random points of trimmed faces, thickest where a tessellator is likeliest to be wrong.

A share of the samples of each face lies

* inside, stratified in (u, v), half of them kept in proportion to the area they stand for,
* exactly on the boundary curves,
* a tiny step off the boundary,
* on and next to knot lines, and at the domain's sides and corners, where poles and seams are.

Whatever is not on the boundary itself has passed the even-odd test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.measure.exact_curve import evaluate_curves
from nurbs_ooc.measure.trim_region import TrimRegion

BOUNDARY_SHARE = 0.25
NEAR_SHARE = 0.15
SPECIAL_SHARE = 0.20
STRATA_PER_SAMPLE = 3  # candidates of which one is kept by its area
NEAREST_STEP = 1e-7  # smallest step off the boundary, in sizes of the face's parameter box


@dataclass(frozen=True, eq=False)
class SampleSet:
    """Samples of faces, in ascending order of ``face``.

    Attributes:
        face: (n,) int64, index in the region's ``faces``.
        uv: (n, 2) float64, native parameters.
        points: (n, 3) float64, mm.
        on_boundary: (n,) bool, exactly on a boundary curve (and not tested for being inside).
    """

    face: npt.NDArray[np.int64]
    uv: npt.NDArray[np.float64]
    points: npt.NDArray[np.float64]
    on_boundary: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.face)


def sample_faces(
    region: TrimRegion, per_face: int, seed: int | Sequence[int], faces: npt.NDArray[np.int64] | None = None
) -> SampleSet:
    """About ``per_face`` samples of each of ``faces`` (by default all of ``region``), the same for the same ``seed``.

    Needles whose inside no candidate hits get boundary samples only.
    """
    rng = np.random.default_rng([*np.atleast_1d(seed), 0x5A17])
    faces = np.arange(len(region)) if faces is None else np.sort(faces)
    n_boundary = max(8, int(per_face * BOUNDARY_SHARE))
    boundary_face, boundary_uv = _on_boundary(region, faces, n_boundary, rng)
    tested = [
        _interior(region, faces, max(4, int(per_face * (1 - BOUNDARY_SHARE - NEAR_SHARE - SPECIAL_SHARE))), rng),
        _near_boundary(region, boundary_face, boundary_uv, max(4, int(per_face * NEAR_SHARE)), rng),
        _special(region, faces, max(4, int(per_face * SPECIAL_SHARE)), rng),
    ]
    face = np.concatenate([boundary_face, *(f for f, _ in tested)])
    uv = np.concatenate([boundary_uv, *(p for _, p in tested)])
    on_boundary = np.arange(len(face)) < len(boundary_face)
    order = np.argsort(face, kind="stable")
    face, uv, on_boundary = face[order], uv[order], on_boundary[order]
    return SampleSet(face, uv, region.placed.points(face, uv), on_boundary)


Samples = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]


def _kept(region: TrimRegion, face: npt.NDArray[np.int64], uv: npt.NDArray[np.float64]) -> Samples:
    inside = region.contains(face, uv)
    return face[inside], uv[inside]


def _jittered(region: TrimRegion, faces: npt.NDArray[np.int64], n: int, rng: np.random.Generator) -> Samples:
    """One random point in each cell of a k x k grid over the box of each face, k*k >= n, if it is inside."""
    k = int(np.ceil(np.sqrt(n)))
    cells = np.stack(np.meshgrid(np.arange(k), np.arange(k), indexing="ij"), -1).reshape(-1, 2)
    share = (np.tile(cells, (len(faces), 1)) + rng.random((len(faces) * k * k, 2))) / k
    face = np.repeat(faces, k * k)
    low, high = region.bounds[face, :2], region.bounds[face, 2:]
    return _kept(region, face, low + share * (high - low))


def _interior(region: TrimRegion, faces: npt.NDArray[np.int64], n: int, rng: np.random.Generator) -> Samples:
    face, uv = _jittered(region, faces, STRATA_PER_SAMPLE * n, rng)
    for _ in range(3):  # faces that fill little of their box get more candidates
        count = np.bincount(face, minlength=len(region))
        few = faces[count[faces] < n]
        if not len(few):
            break
        again = _jittered(region, few, 8 * STRATA_PER_SAMPLE * n, rng)
        face, uv = np.concatenate([face, again[0]]), np.concatenate([uv, again[1]])
    # Keep n a face: the first half as they come, the others with chances in proportion to their area.
    d = region.placed.derivatives(face, uv)
    area = np.linalg.norm(np.cross(d[:, 1], d[:, 2]), axis=1)
    area = np.where(np.isfinite(area), area, 0.0)
    fair = rng.random(len(face)) < 0.5
    chance = rng.random(len(face))
    rank = np.where(fair, chance, np.log(np.maximum(chance, 1e-300)) / np.maximum(area, 1e-300))
    picked = []
    for kind in (fair, ~fair):
        rows = np.flatnonzero(kind)
        rows = rows[np.lexsort((-rank[rows], face[rows]))]
        start = np.searchsorted(face[rows], np.arange(len(region)))
        picked.append(rows[np.arange(len(rows)) - start[face[rows]] < (n + 1) // 2])
    rows = np.concatenate(picked)
    return face[rows], uv[rows]


def _on_boundary(region: TrimRegion, faces: npt.NDArray[np.int64], n: int, rng: np.random.Generator) -> Samples:
    """Points of the exact boundary curves, segments drawn alike: they lie thickest where curves bend."""
    counts = np.diff(region.start)
    face = np.repeat(faces[counts[faces] > 0], n)
    segment = region.segments[region.start[face] + (rng.random(len(face)) * counts[face]).astype(np.int64)]
    share = rng.random(len(face))
    share[rng.random(len(face)) < 0.1] = 0.0  # ends of curves, corners
    uv = segment["uv0"] + share[:, None] * (segment["uv1"] - segment["uv0"])
    curved = np.flatnonzero(segment["coedge"] >= 0)
    t = segment["t0"] + share * (segment["t1"] - segment["t0"])
    rows = region.placed.geometry.coedges["pcurve"][segment["coedge"][curved]]
    uv[curved] = evaluate_curves(region.placed.geometry, rows, t[curved])[0][:, :2]
    return face, uv


def _near_boundary(
    region: TrimRegion, face: npt.NDArray[np.int64], uv: npt.NDArray[np.float64], n: int, rng: np.random.Generator
) -> Samples:
    if not len(face):
        return face, uv
    pick = np.sort(rng.integers(0, len(face), n * len(np.unique(face)) * 2))
    size = region.bounds[face[pick], 2:] - region.bounds[face[pick], :2]
    step = 10.0 ** rng.uniform(np.log10(NEAREST_STEP), -1.0, (len(pick), 1))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(pick))
    moved = uv[pick] + step * size * np.stack([np.cos(angle), np.sin(angle)], 1)
    return _kept(region, face[pick], moved)


def _special(region: TrimRegion, faces: npt.NDArray[np.int64], n: int, rng: np.random.Generator) -> Samples:
    """One or both coordinates on a knot, a side of the domain or the box, or a hair off it."""
    geometry = region.placed.geometry
    face = np.repeat(faces, n)
    uv = np.empty((len(face), 2))
    which = rng.integers(0, 3, len(face))  # 0: u is special, 1: v is, 2: both
    for axis in range(2):
        low, high = region.bounds[face, axis], region.bounds[face, 2 + axis]
        value = low + rng.random(len(face)) * (high - low)
        special = (which == axis) | (which == 2)
        knot = _random_break(geometry, region.placed.rows[face], axis, rng)
        off = rng.choice([0.0, 0.0, 1e-12, -1e-12, 1e-6, -1e-6, 1e-3, -1e-3], len(face)) * (high - low)
        uv[:, axis] = np.where(special, knot + off, value)
    return _kept(region, face, uv)


def _random_break(
    geometry: GeometryBatch, rows: npt.NDArray[np.int64], axis: int, rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """A random knot of each surface along ``axis``; of analytic ones an end or a quarter turn of the domain."""
    s = geometry.surfaces[rows]
    first, degree, n = (s["knots_u"], s["degree_u"], s["n_u"]) if axis == 0 else (s["knots_v"], s["degree_v"], s["n_v"])
    t0, t1 = (s["u0"], s["u1"]) if axis == 0 else (s["v0"], s["v1"])
    quarter = t0 + 0.25 * rng.integers(0, 5, len(rows)) * (t1 - t0)
    along_profile = (s["kind"] == SurfaceKind.EXTRUSION) if axis == 0 else (s["kind"] == SurfaceKind.REVOLUTION)
    if len(geometry.curves):
        c = geometry.curves[np.maximum(s["profile"], 0)]
        along_profile = along_profile & (c["kind"] == CurveKind.NURBS)
        first, degree, n = (
            np.where(along_profile, c[k], x) for k, x in zip(("knots", "degree", "n"), (first, degree, n), strict=True)
        )
    has_knots = (s["kind"] == SurfaceKind.NURBS) | along_profile
    at = first + degree + (rng.random(len(rows)) * (n - degree + 1)).astype(np.int64)
    knot = geometry.values[np.where(has_knots, at, 0)] if len(geometry.values) else quarter
    return np.where(has_knots & (rng.random(len(rows)) < 0.8), knot, quarter)
