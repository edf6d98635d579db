"""Exact control nets: tagged surfaces as B-splines, raised degrees, mapped knots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.nurbs_form import nurbs_form

Array = npt.NDArray[np.float64]


def as_nurbs(form: SurfaceForm) -> SurfaceForm:
    """The exact rational B-spline of a tagged surface over its used domain."""
    builder = BatchBuilder()
    builder.surface(form)
    s = nurbs_form(builder.build(), 0)
    return SurfaceForm.nurbs(
        s.degree_u, s.degree_v, s.knots_u, s.knots_v, s.points_w[..., :3] / s.points_w[..., 3:], s.points_w[..., 3]
    )


def _elevation(p: int, q: int) -> Array:
    """(q + 1, p + 1) matrix from Bézier points of degree p to those of degree q.

    Source: G. Farin, "Curves and Surfaces for CAGD", 5th ed. 2002, section 6.1 (repeated elevation).
    """
    out = np.zeros((q + 1, p + 1))
    for i in range(q + 1):
        for j in range(max(0, i - q + p), min(p, i) + 1):
            out[i, j] = math.comb(p, j) * math.comb(q - p, i - j) / math.comb(q, i)
    return out


def _elevate(knots: Array, p: int, rows: Array, q: int) -> tuple[Array, Array]:
    """A spline whose inner knots are p-fold, with its degree raised to q; ``rows`` run along axis 0."""
    breaks = np.unique(knots)
    assert len(rows) == p * (len(breaks) - 1) + 1, "inner knots must be p-fold"
    matrix = _elevation(p, q)
    pieces = [np.tensordot(matrix, rows[k * p : k * p + p + 1], axes=(1, 0)) for k in range(len(breaks) - 1)]
    raised = np.concatenate([piece[:-1] for piece in pieces] + [pieces[-1][-1:]])
    return np.concatenate([[breaks[0]], np.repeat(breaks, q), [breaks[-1]]]), raised


def elevated(form: SurfaceForm, q: int) -> SurfaceForm:
    """The same surface with both degrees ``q``; inner knots must have the multiplicity of the degree."""
    knots_u, rows = _elevate(form.knots_u, form.degree_u, form.points, q)
    knots_v, columns = _elevate(form.knots_v, form.degree_v, np.swapaxes(rows, 0, 1), q)
    return replace(
        form, degree_u=q, degree_v=q, knots_u=knots_u, knots_v=knots_v, points=np.swapaxes(columns, 0, 1).copy()
    )


def with_knots_over(form: SurfaceForm, low: float, high: float) -> SurfaceForm:
    """The same surface with both knot vectors mapped linearly to [low, high]."""

    def mapped(knots: Array) -> Array:
        share = (knots - knots[0]) / (knots[-1] - knots[0])
        return low + share * (high - low)

    return replace(form, knots_u=mapped(form.knots_u), knots_v=mapped(form.knots_v), u0=low, u1=high, v0=low, v1=high)


def tensor(profile: Array, height: float, weights: Array | None = None) -> tuple[Array, Array | None]:
    """A profile (n, 2) in x and z as a net (n, 2, 3) over y in 0..height, with its weights."""
    low = np.stack([profile[:, 0], np.zeros(len(profile)), profile[:, 1]], axis=1)
    high = low + np.array([0.0, height, 0.0])
    both = np.stack([low, high], axis=1)
    return both, None if weights is None else np.stack([weights, weights], axis=1)
