"""What float32 costs: surfaces evaluated in float32 and float64, near the origin and far from it.

The truth is the same control points evaluated in extended precision. ``float32, own origin`` subtracts a
point of the surface in float64 before it rounds: what tiles and cameras do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceStatus, GeometryBatch
from nurbs_ooc.geometry.nurbs_form import NurbsSurface, nurbs_form
from nurbs_ooc.measure.exact_reference import de_boor

DISTANCES = (0.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9)  # mm from the origin
SURFACES, POINTS = 24, 6  # of each part's faces, and of each of those

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NumberPoint:
    """Largest errors of evaluation, mm, with the surfaces ``distance_mm`` from the origin."""

    distance_mm: float
    float32_mm: float
    float32_own_origin_mm: float
    float64_mm: float

    def as_json(self) -> dict[str, Any]:
        """By name."""
        return asdict(self)


def _at(form: NurbsSurface, net: npt.NDArray[Any], u: float, v: float, number: type) -> npt.NDArray[Any]:
    """The point at (u, v), all arithmetic in ``number``."""

    def span(knots: Array, degree: int, n: int, t: float) -> int:
        return max(i for i in range(degree, n) if (knots[i] <= t or i == degree) and knots[i] < knots[i + 1])

    p, q = form.degree_u, form.degree_v
    i, j = span(form.knots_u, p, net.shape[0], u), span(form.knots_v, q, net.shape[1], v)
    knots_u: npt.NDArray[Any] = form.knots_u[i - p : i + p + 2].astype(number)
    knots_v: npt.NDArray[Any] = form.knots_v[j - q : j + q + 2].astype(number)
    block: npt.NDArray[Any] = net[i - p : i + 1, j - q : j + 1].astype(number)
    rows = [de_boor(list(knots_v), q, [list(point) for point in line], number(v)) for line in block]
    point: npt.NDArray[Any] = np.array(de_boor(list(knots_u), p, rows, number(u)), number)
    return np.asarray(point[:3] / point[3])


def number_curve(parts: Sequence[GeometryBatch], seed: int = 0) -> list[NumberPoint]:
    """Errors of evaluation over ``DISTANCES``, on some faces of every part."""
    rng = np.random.default_rng([seed, 0xF32])
    cases: list[tuple[NurbsSurface, Array]] = []
    for geometry in parts:
        sound = np.flatnonzero(geometry.surfaces["status"] < FaceStatus.FAILED)
        for row in rng.permutation(sound)[: max(1, SURFACES // len(parts))]:
            s = geometry.surfaces[row]
            uv = rng.random((POINTS, 2)) * [s["u1"] - s["u0"], s["v1"] - s["v0"]] + [s["u0"], s["v0"]]
            cases.append((nurbs_form(geometry, int(row)), uv))
    return [_errors(cases, distance) for distance in DISTANCES]


def _errors(cases: list[tuple[NurbsSurface, Array]], distance: float) -> NumberPoint:
    worst = np.zeros(3)
    for form, uv in cases:
        net = form.points_w.copy()
        net[..., :3] += net[..., 3:] * distance
        origin = net[0, 0, :3] / net[0, 0, 3]
        near = net.copy()
        near[..., :3] -= net[..., 3:] * origin
        for u, v in uv:
            # Parameters that float32 has: the error is that of the arithmetic, not of the place.
            u32, v32 = (float(np.float32(t)) for t in (u, v))
            if not (form.knots_u[0] <= u32 <= form.knots_u[-1] and form.knots_v[0] <= v32 <= form.knots_v[-1]):
                continue
            truth = _at(form, net, u32, v32, np.longdouble)
            own = _at(form, near, u32, v32, np.float32).astype(np.longdouble) + origin
            found = (_at(form, net, u32, v32, np.float32), own, _at(form, net, u32, v32, np.float64))
            worst = np.maximum(worst, [float(np.linalg.norm((x - truth).astype(float))) for x in found])
    return NumberPoint(distance, *map(float, worst))
