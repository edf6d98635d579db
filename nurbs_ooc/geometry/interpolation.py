"""Cubic B-splines through given points at the Greville parameters of a uniform knot vector.

Source: de Boor, A Practical Guide to Splines (2001), chapter XIII (interpolation, Schoenberg-Whitney).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from nurbs_ooc.geometry.forms import Array, CurveForm, bspline_basis

DEGREE = 3


@lru_cache(maxsize=16)
def _system(n: int) -> tuple[Array, Array, Array]:
    """Knots, Greville parameters and the inverse of the collocation matrix for ``n`` points."""
    knots = np.concatenate([np.zeros(DEGREE), np.linspace(0.0, 1.0, n - DEGREE + 1), np.ones(DEGREE)])
    nodes = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(n)])
    matrix = np.array([bspline_basis(knots, DEGREE, float(t)) for t in nodes])
    return knots, nodes, np.linalg.inv(matrix)


def nodes(n: int) -> Array:
    """(n,) parameters in 0..1, ends included, at which ``through`` wants its points; n >= 4."""
    return _system(n)[1]


def through(points: Array, t0: float = 0.0, t1: float = 1.0) -> CurveForm:
    """The cubic with ``points`` (n, dim) at t0 + (t1 - t0) * nodes(n)."""
    knots, _, inverse = _system(len(points))
    return CurveForm.nurbs(DEGREE, t0 + (t1 - t0) * knots, inverse @ points)


def knots(n: int) -> Array:
    """(n + 4,) knots of the cubic through ``n`` points, over 0..1."""
    return _system(n)[0]


def inverse(n: int) -> Array:
    """(n, n) matrix from points to control points."""
    return _system(n)[2]


def basis(n: int, t: float) -> Array:
    """(n,) basis functions at ``t``."""
    return bspline_basis(_system(n)[0], DEGREE, t)
