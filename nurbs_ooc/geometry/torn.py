"""Surfaces torn in two by an inner knot of more than the degree: the parts they consist of.

Such a knot ends one B-spline and begins the next, which have nothing in common but their knots; no triangle may
lead from one to the other::

    degree 2, knots 0 0 0 1 1 1 2 2 2       points P0 P1 P2 | P3 P4 P5
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.forms import Array, SurfaceForm


def _parts(knots: Array, degree: int) -> list[tuple[slice, slice]]:
    """Knots and control points of each part of a clamped spline, in order; one for a spline that is whole."""
    values, first, count = np.unique(knots, return_index=True, return_counts=True)
    inner = (values > knots[degree]) & (values < knots[-degree - 1]) & (count > degree)
    starts = [0, *(int(i + m - degree - 1) for i, m in zip(first[inner], count[inner], strict=True))]
    ends = [*(int(i + degree + 1) for i in first[inner]), len(knots)]
    return [(slice(a, b), slice(a, b - degree - 1)) for a, b in zip(starts, ends, strict=True)]


def whole_parts(form: SurfaceForm) -> list[SurfaceForm]:
    """The surfaces that a torn one consists of, u by u; ``form`` alone if it is whole.

    Args:
        form: used over its whole domain, ends clamped. Control points between parts, of knots of multiplicity
            degree + 2 and more, belong to none.
    """
    if form.kind != SurfaceKind.NURBS:
        return [form]
    along_u, along_v = _parts(form.knots_u, form.degree_u), _parts(form.knots_v, form.degree_v)
    if len(along_u) == len(along_v) == 1:
        return [form]
    parts = []
    for knots_u, points_u in along_u:
        for knots_v, points_v in along_v:
            u, v = form.knots_u[knots_u], form.knots_v[knots_v]
            net = np.ascontiguousarray(form.points[points_u, points_v])
            part = replace(form, knots_u=u, knots_v=v, points=net)
            parts.append(part.over(float(u[0]), float(u[-1]), float(v[0]), float(v[-1])))
    return parts
