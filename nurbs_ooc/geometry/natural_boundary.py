"""The boundary that an untrimmed surface has by itself: four sides, some of them seams or poles.

::

        v1  +----- top <-----+        closed in u: left and right are one edge (a seam)
            |                |        closed in v: bottom and top are one edge
          left             right      a side that is one point in space: a pole
            |                |
        v0  +---> bottom ----+
           u0                u1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import Array, CurveForm, SurfaceForm

RELATIVE_TOLERANCE = 1e-10  # of the surface's size: corners of one seam or pole differ by rounding only


@dataclass(frozen=True, eq=False)
class _Side:
    curve: CurveForm
    is_point: bool


def _samples(curve: CurveForm) -> Array:
    return np.array([curve.point(t) for t in np.linspace(curve.t0, curve.t1, 9)])


def _sides(form: SurfaceForm, tolerance: float) -> tuple[list[_Side], bool, bool]:
    """The sides bottom, right, top, left; whether the surface is closed in u and in v."""
    curves = [form.iso_v(form.v0), form.iso_u(form.u1), form.iso_v(form.v1), form.iso_u(form.u0)]
    samples = [_samples(curve) for curve in curves]
    tolerance = max(tolerance, RELATIVE_TOLERANCE * float(np.abs(np.concatenate(samples)).max()))
    sides = [
        _Side(curve, bool(np.abs(points - points[0]).max() <= tolerance))
        for curve, points in zip(curves, samples, strict=True)
    ]
    closed_u = bool(np.abs(samples[1] - samples[3]).max() <= tolerance)
    closed_v = bool(np.abs(samples[0] - samples[2]).max() <= tolerance)
    return sides, closed_u, closed_v


def natural_loop(builder: BatchBuilder, form: SurfaceForm, tolerance: float = 0.0) -> list[Coedge]:
    """The loop around the used domain of ``form``, counter-clockwise; its edges join ``builder``.

    Args:
        tolerance: mm; sides closer than this are one seam, sides smaller than this are one pole.
    """
    sides, closed_u, closed_v = _sides(form, tolerance)
    corners = [(form.u0, form.v0), (form.u1, form.v0), (form.u1, form.v1), (form.u0, form.v1)]
    merged = _merge_corners([side.is_point for side in sides], closed_u, closed_v)
    rows = {i: builder.vertex(form.point(*corners[i])) for i in sorted(set(merged))}
    vertex = [rows[i] for i in merged]
    edges: list[int] = []
    for k, (start, end) in enumerate([(0, 1), (1, 2), (3, 2), (0, 3)]):
        side = sides[k]
        if side.is_point:
            edges.append(builder.pole(vertex[start], side.curve.t0, side.curve.t1, tolerance))
        elif (k == 2 and closed_v) or (k == 3 and closed_u):
            edges.append(edges[k - 2])
        else:
            edges.append(builder.edge(side.curve, vertex[start], vertex[end], tolerance))
    coedges = []
    for k, (start, end) in enumerate([(0, 1), (1, 2), (3, 2), (0, 3)]):
        pcurve = CurveForm.line(corners[start], corners[end], sides[k].curve.t0, sides[k].curve.t1)
        seam = edges.count(edges[k]) == 2
        coedges.append(Coedge(edges[k], pcurve, reversed=k >= 2, seam=seam, pole=sides[k].is_point))
    return coedges


def _merge_corners(points: list[bool], closed_u: bool, closed_v: bool) -> list[int]:
    """For each corner the first corner that is the same point in space."""
    same = list(range(4))
    bottom, right, top, left = points
    pairs = [(0, 1, bottom or closed_u), (2, 3, top or closed_u), (1, 2, right or closed_v), (0, 3, left or closed_v)]
    for first, second, joined in pairs:
        if joined:
            low, high = sorted((same[first], same[second]))
            same = [low if value == high else value for value in same]
    return same
