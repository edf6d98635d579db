"""Offset surfaces without a closed form, as polynomial B-splines with a measured error.

Between the knots of its basis an offset surface is smooth, so each piece is interpolated by one
polynomial at Chebyshev-Lobatto nodes; neighbouring pieces share the nodes on their border and stay
joined. All pieces are halved until the error between the nodes is small enough; it falls by a factor
of about 2^9 each time.

Source: Trefethen, Approximation Theory and Approximation Practice (2013), chapter 8 (convergence).
"""

from __future__ import annotations

from itertools import pairwise
from math import comb
from typing import Any

import numpy as np

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.geometry.forms import Array, SurfaceForm
from nurbs_ooc.readers import kernel_arrays
from nurbs_ooc.readers.refusal import FaceRefusedError

Box = tuple[float, float, float, float]

DEGREE = 8
TOLERANCE = 1e-6  # of the basis' size: what the halving aims at
MAX_POINTS = 200_000  # control points; at this size the error is stated as it is
SAFETY = 2.0  # on the measured maximum, because the probes miss the peaks
NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
PROBES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(DEGREE) + 0.5) / DEGREE)  # where the error peaks between the nodes


def _bernstein(t: Array) -> Array:
    k = np.arange(DEGREE + 1)
    binomials = np.array([comb(DEGREE, i) for i in k], float)
    return np.asarray(binomials * t[:, None] ** k * (1.0 - t[:, None]) ** (DEGREE - k))


TO_CONTROL_POINTS = np.linalg.inv(_bernstein(NODES))
AT_PROBES = _bernstein(PROBES) @ TO_CONTROL_POINTS


def approximated_offset(surface: Any, box: Box) -> tuple[SurfaceForm, float]:
    """A B-spline near the ``Geom_OffsetSurface`` over ``box``, and its error in mm.

    The error is twice the largest distance at equal parameters between the nodes.

    Raises:
        FaceRefusedError: the offset is not finite somewhere.
    """
    breaks = [_breaks(surface.BasisSurface(), axis, box[2 * axis], box[2 * axis + 1]) for axis in range(2)]
    while True:
        form, error, size = _interpolated(surface, breaks)
        n_next = 4 * form.points.shape[0] * form.points.shape[1]
        if error <= TOLERANCE * size or n_next > MAX_POINTS:
            return form, SAFETY * error
        breaks = [_halved(b) for b in breaks]


def _breaks(basis: Any, axis: int, low: float, high: float) -> Array:
    """Parameters from ``low`` to ``high`` between which the basis is smooth."""
    name = type(basis).__name__
    inner = np.empty(0)
    if name == "Geom_BSplineSurface":
        inner = kernel_arrays.numbers(basis.UKnots() if axis == 0 else basis.VKnots())
    elif name == "Geom_SurfaceOfRevolution" and axis == 0:
        inner = np.linspace(low, high, 5)
    elif name.startswith("Geom_SurfaceOf") and type(basis.BasisCurve()).__name__ == "Geom_BSplineCurve":
        inner = kernel_arrays.numbers(basis.BasisCurve().Knots())
    inside = inner[(inner > low) & (inner < high)]
    return np.concatenate([[low], inside, [high]])


def _halved(breaks: Array) -> Array:
    return np.sort(np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1])]))


def _nodes(breaks: Array, shares: Array) -> Array:
    """(pieces, shares) parameters at the given shares of each piece."""
    return np.asarray(breaks[:-1, None] + np.diff(breaks)[:, None] * shares)


def _values(surface: Any, u: Array, v: Array) -> Array:
    """(pieces_u, n, pieces_v, m, 3) points of the surface."""
    rows = [surface.Value(float(a), float(b)).Coord() for a in u.ravel() for b in v.ravel()]
    points = np.array(rows).reshape(*u.shape, *v.shape, 3)
    if not np.isfinite(points).all():
        raise FaceRefusedError(FaceReason.NOT_FINITE, "an offset surface is not finite")
    return points


def _interpolated(surface: Any, breaks: list[Array]) -> tuple[SurfaceForm, float, float]:
    """The B-spline, its largest error at the probes, and the extent of the surface."""
    values = _values(surface, _nodes(breaks[0], NODES), _nodes(breaks[1], NODES))
    probes = _values(surface, _nodes(breaks[0], PROBES), _nodes(breaks[1], PROBES))
    fitted = np.einsum("ia,jb,paqbk->piqjk", AT_PROBES, AT_PROBES, values)
    error = float(np.linalg.norm(fitted - probes, axis=-1).max())
    control = np.einsum("ia,jb,paqbk->piqjk", TO_CONTROL_POINTS, TO_CONTROL_POINTS, values)
    joined = _joined(_joined(control, 0, 1), 1, 2)
    knots = [_knots(b) for b in breaks]
    return SurfaceForm.nurbs(DEGREE, DEGREE, knots[0], knots[1], joined), error, float(np.ptp(values))


def _joined(control: Array, pieces: int, points: int) -> Array:
    """Merge the axes ``pieces`` and ``points``: neighbouring pieces share their border row."""
    rows = [np.take(control, k, axis=pieces) for k in range(control.shape[pieces])]
    axis = points - 1
    tails = [np.delete(row, 0, axis=axis) for row in rows[1:]]
    return np.concatenate([rows[0], *tails], axis=axis)


def _knots(breaks: Array) -> Array:
    inner = [np.repeat(t, DEGREE) for _, t in pairwise(breaks[:-1])]
    return np.concatenate([np.repeat(breaks[0], DEGREE + 1), *inner, np.repeat(breaks[-1], DEGREE + 1)])
