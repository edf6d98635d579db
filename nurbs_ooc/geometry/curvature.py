"""Mean curvature of surfaces, and the knots across which it is not smooth.

Source: M. P. do Carmo, "Differential Geometry of Curves and Surfaces", 1976, section 3-3, with second derivatives by
central differences of first ones, none of which reaches over a knot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.surface import evaluate_partials

Floats = npt.NDArray[np.float64]

STEP = 1e-4  # of a knot span, or of the domain
FLAT = 1e-14  # of the square of the product of the tangents: there is no normal


class Knots(NamedTuple):
    """Of one direction of a surface: its distinct knots inside the used domain, how often each is one, the degree."""

    values: Floats
    times: npt.NDArray[np.int64]
    degree: int


def _distinct(knots: Floats, degree: int, low: float, high: float) -> Knots:
    values, times = np.unique(knots, return_counts=True)
    inside = (values > low) & (values < high)
    return Knots(values[inside], times[inside], degree)


def inner_knots(geometry: GeometryBatch, row: int) -> tuple[Knots, Knots]:
    """The knots of surface ``row`` along u and along v, a swept one's by its profile; none of closed forms."""
    s = geometry.surfaces[row]
    u0, u1, v0, v1 = (float(s[name]) for name in ("u0", "u1", "v0", "v1"))
    none = Knots(np.zeros(0), np.zeros(0, np.int64), 0)
    kind, values = int(s["kind"]), geometry.values
    if kind == SurfaceKind.NURBS:
        p, q = int(s["degree_u"]), int(s["degree_v"])
        at_u, at_v = int(s["knots_u"]), int(s["knots_v"])
        along_u = _distinct(values[at_u : at_u + int(s["n_u"]) + p + 1], p, u0, u1)
        return along_u, _distinct(values[at_v : at_v + int(s["n_v"]) + q + 1], q, v0, v1)
    if kind in (SurfaceKind.REVOLUTION, SurfaceKind.EXTRUSION):
        c = geometry.curves[int(s["profile"])]
        if c["kind"] != CurveKind.NURBS:
            return none, none
        turned = kind == SurfaceKind.REVOLUTION
        at, degree = int(c["knots"]), int(c["degree"])
        low, high = (v0, v1) if turned else (u0, u1)
        profile = _distinct(values[at : at + int(c["n"]) + degree + 1], degree, low, high)
        return (none, profile) if turned else (profile, none)
    return none, none


def _step(t: Floats, low: float, high: float, knots: Floats) -> tuple[Floats, Floats]:
    """Where differences for the places ``t`` are taken around, in the span of each, and how far."""
    ends = np.concatenate([[low], knots, [high]])
    span = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, len(ends) - 2)
    step = STEP * (ends[span + 1] - ends[span])
    return np.clip(t, ends[span] + step, ends[span + 1] - step), step


def mean_curvature(geometry: GeometryBatch, row: int, uv: Floats) -> Floats:
    """(n,) mean curvature, 1/mm, positive where the outside is the hollow side; 0 where there is no normal."""
    s = geometry.surfaces[row]
    knots_u, knots_v = inner_knots(geometry, row)
    u, step_u = _step(uv[:, 0], float(s["u0"]), float(s["u1"]), knots_u.values)
    v, step_v = _step(uv[:, 1], float(s["v0"]), float(s["v1"]), knots_v.values)
    middle = np.stack([u, v], axis=1)
    by_u, by_v = (np.stack([step_u, 0.0 * v], axis=1), np.stack([0.0 * u, step_v], axis=1))
    _, n, d = evaluate_partials(geometry, row, middle)
    d_u, d_v = (
        (evaluate_partials(geometry, row, middle + h)[2] - evaluate_partials(geometry, row, middle - h)[2])
        / (2.0 * h.sum(axis=1))[:, None, None]
        for h in (by_u, by_v)
    )
    s_u, s_v = d[:, 0], d[:, 1]
    e, f, g = ((a * b).sum(axis=1) for a, b in ((s_u, s_u), (s_u, s_v), (s_v, s_v)))
    low, mixed, high = ((n * a).sum(axis=1) for a in (d_u[:, 0], d_u[:, 1], d_v[:, 1]))
    area = e * g - f * f
    with np.errstate(all="ignore"):
        value = (low * g - 2.0 * mixed * f + high * e) / (2.0 * area)
    return np.where(np.isfinite(value) & (area > FLAT * e * g), value, 0.0)
