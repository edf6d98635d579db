"""Attributes of surfaces for attacks, evaluated by the attack's own code: B-splines, functions, the mean curvature."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.measure.exact_reference import multiprecision, surface_point
from nurbs_ooc.measure.exact_surface import derivatives, points
from nurbs_ooc.tessellation.appearance import Appearance

Floats = npt.NDArray[np.float64]
# Values (n, 3) of surface ``row`` at (n, 2) native parameters, NaN where there is none.
Exact = Callable[[int, Floats], Floats]

STEP = 2e-5  # of the domain
# The same with many digits: where two knot spans meet, a record's roundoff is a crease too, which must not count.
FINE_STEP = 1e-8
CREASE = 0.05  # of the curvature: by how much that of half the step differs where there is none
POLE = 1e-9


def exact_attribute(geometry: GeometryBatch, look: Appearance, digits: int = 0) -> Exact | None:
    """The attribute that ``look`` asks for, None if there is none; of fewer numbers than three the rest is 0.

    Args:
        geometry: the surfaces.
        look: what was asked for.
        digits: if given, of a curvature's arithmetic, which then is slow.
    """
    source = look.attribute
    if source is None:
        return None
    if isinstance(source, str):
        if digits:
            return lambda row, uv: _widened([precise_mean_curvature(geometry, row, u, v, digits) for u, v in uv])
        return lambda row, uv: _widened(exact_mean_curvature(geometry, row, uv))
    if callable(source):
        return lambda row, uv: _widened(source(geometry, row, uv))
    return _of_splines(source)


def _widened(values: npt.ArrayLike) -> Floats:
    found = np.asarray(values, float)
    found = found.reshape(len(found), -1)
    return np.pad(found, ((0, 0), (0, 3 - found.shape[1])))


def _of_splines(forms: Mapping[int, object]) -> Exact:
    builder = BatchBuilder()
    place = {}
    for k, (row, form) in enumerate(forms.items()):
        builder.surface(form)  # type: ignore[arg-type]
        place[row] = k
    batch = builder.build()

    def at(row: int, uv: Floats) -> Floats:
        return points(batch, place[row], uv) if row in place else np.zeros((len(uv), 3))

    return at


def exact_mean_curvature(geometry: GeometryBatch, row: int, uv: Floats) -> Floats:
    """(n,) mean curvature, 1/mm, half the trace of I^-1 II; NaN where there is none, at poles and on creases.

    Second derivatives are differences of tangents. Those of two widths tell a crease, across which the narrower one
    is larger.
    """
    s = geometry.surfaces[row]
    size = np.array([float(s["u1"] - s["u0"]), float(s["v1"] - s["v0"])])
    narrow, wide = (_half_trace(geometry, row, uv, k * STEP * size) for k in (1.0, 2.0))
    bent = np.abs(narrow - wide) > CREASE * np.abs(narrow) + 1e-9 / size.max()
    value = np.where(bent, np.nan, (4.0 * narrow - wide) / 3.0)
    return np.asarray(-value if s["reversed"] else value)


def _half_trace(geometry: GeometryBatch, row: int, uv: Floats, step: Floats) -> Floats:
    d = derivatives(geometry, row, uv)[:, 1:]
    second = np.empty((len(uv), 2, 2, 3))
    for k in range(2):
        h = np.zeros(2)
        h[k] = step[k]
        apart = derivatives(geometry, row, uv + h)[:, 1:] - derivatives(geometry, row, uv - h)[:, 1:]
        second[:, k] = apart / (2.0 * step[k])
    normal = np.cross(d[:, 0], d[:, 1])
    length = np.linalg.norm(normal, axis=1)
    known = length > POLE * np.linalg.norm(d[:, 0], axis=1) * np.linalg.norm(d[:, 1], axis=1)
    known &= (np.linalg.norm(d, axis=2) * np.abs(step) > POLE * np.abs(step).max()).all(axis=1)
    out = np.full(len(uv), np.nan)
    first_form = np.einsum("nik,njk->nij", d[known], d[known])
    second_form = np.einsum("nijk,nk->nij", second[known], normal[known] / length[known][:, None])
    determinant = first_form[:, 0, 0] * first_form[:, 1, 1] - first_form[:, 0, 1] ** 2
    trace = (
        first_form[:, 1, 1] * second_form[:, 0, 0]
        - first_form[:, 0, 1] * (second_form[:, 0, 1] + second_form[:, 1, 0])
        + first_form[:, 0, 0] * second_form[:, 1, 1]
    )
    out[known] = 0.5 * trace / determinant
    return out


def precise_mean_curvature(geometry: GeometryBatch, row: int, u: float, v: float, digits: int) -> float:
    """The same of one place, with so many digits, from differences of points."""
    s = geometry.surfaces[row]
    arithmetic = multiprecision(digits)
    number = arithmetic.number
    size_u, size_v = float(s["u1"] - s["u0"]), float(s["v1"] - s["v0"])
    h_u, h_v = number(FINE_STEP) * number(size_u), number(FINE_STEP) * number(size_v)

    def at(i: int, j: int) -> Any:
        return np.array(
            surface_point(geometry, row, number(float(u)) + i * h_u, number(float(v)) + j * h_v, arithmetic)
        )

    traces = []
    for k in (1, 2):
        middle, left, right, below, above = at(0, 0), at(-k, 0), at(k, 0), at(0, -k), at(0, k)
        s_u, s_v = (right - left) / (2 * k * h_u), (above - below) / (2 * k * h_v)
        uu, vv = (right - 2 * middle + left) / (k * h_u) ** 2, (above - 2 * middle + below) / (k * h_v) ** 2
        uv = (at(k, k) - at(k, -k) - at(-k, k) + at(-k, -k)) / (4 * k * k * h_u * h_v)
        normal = np.cross(s_u, s_v)
        e, f, g = s_u @ s_u, s_u @ s_v, s_v @ s_v
        area = e * g - f * f
        along_u, along_v = e * number(size_u) ** 2, g * number(size_v) ** 2
        least = number(POLE) ** 2
        if not (area > least * e * g and along_u > least * along_v and along_v > least * along_u):
            return math.nan
        trace = (g * (uu @ normal) - 2 * f * (uv @ normal) + e * (vv @ normal)) / (2 * area * area ** number(0.5))
        traces.append(float(trace))
    if abs(traces[0] - traces[1]) > CREASE * abs(traces[0]) + 1e-9 / max(size_u, size_v):
        return math.nan
    return -traces[0] if s["reversed"] else traces[0]
