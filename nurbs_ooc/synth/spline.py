"""Clamped B-splines on equal spans, evaluated and interpolated by matrices that are made once.

Source: C. de Boor, A Practical Guide to Splines (2001), chapters X (recurrence) and XIII (interpolation at
the Greville points, Schoenberg-Whitney).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@lru_cache(maxsize=512)
def clamped_knots(n: int, degree: int) -> Array:
    """(n + degree + 1,) knots over 0..1 with n - degree equal spans; n > degree."""
    inner = np.linspace(0.0, 1.0, n - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    knots.flags.writeable = False
    return knots


def basis_matrix(knots: Array, degree: int, t: Array) -> Array:
    """(m, n) values of all n basis functions at the parameters ``t`` (m,), which lie in the domain."""
    n = len(knots) - degree - 1
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, n - 1)
    local = np.ones((len(t), 1))
    for k in range(1, degree + 1):
        at = span[:, None] + np.arange(1 - k, 1)
        left, right = knots[at], knots[at + k]
        share = (t[:, None] - left) / (right - left)
        raised = np.zeros((len(t), k + 1))
        raised[:, :k] += (1.0 - share) * local
        raised[:, 1:] += share * local
        local = raised
    matrix = np.zeros((len(t), n))
    np.put_along_axis(matrix, span[:, None] + np.arange(-degree, 1), local, axis=1)
    return matrix


@lru_cache(maxsize=512)
def greville(n: int, degree: int) -> Array:
    """(n,) parameters at which ``fit_matrix`` wants its points; the ends included."""
    knots = clamped_knots(n, degree)
    nodes = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(n)])
    nodes.flags.writeable = False
    return nodes


@lru_cache(maxsize=512)
def collocation(n: int, degree: int) -> Array:
    """(n, n) values of the basis functions at the Greville parameters."""
    matrix = basis_matrix(clamped_knots(n, degree), degree, greville(n, degree))
    matrix.flags.writeable = False
    return matrix


@lru_cache(maxsize=512)
def fit_matrix(n: int, degree: int) -> Array:
    """(n, n) from points at the Greville parameters to control points; its first and last row pick the ends."""
    matrix: Array = np.array(np.linalg.inv(collocation(n, degree)), np.float64)
    matrix[0], matrix[-1] = np.eye(n)[0], np.eye(n)[-1]
    matrix.flags.writeable = False
    return matrix


def fit_curves(points: Array, degree: int) -> Array:
    """(k, n, dim) control points of the curves through ``points`` (k, n, dim) at the Greville parameters."""
    return np.asarray(fit_matrix(points.shape[1], degree) @ points)


def fit_surfaces(points: Array, degree_u: int, degree_v: int) -> Array:
    """(k, n_u, n_v, dim) control points through ``points`` of that shape at the Greville parameters.

    Boundary rows depend on boundary points alone, so neighbours that share those share the curve.
    """
    u, v = fit_matrix(points.shape[1], degree_u), fit_matrix(points.shape[2], degree_v)
    k, n_u, n_v, dim = points.shape
    along_v = (v @ points).reshape(k, n_u, n_v * dim)
    return np.asarray(u @ along_v).reshape(k, n_u, n_v, dim)


def evaluate_surfaces(points: Array, degrees: tuple[int, int], u: Array, v: Array) -> Array:
    """(k, m, dim) homogeneous or plain points of k surfaces on equal spans at (u, v), each (k, m)."""
    n_u, n_v = points.shape[1:3]
    a = basis_matrix(clamped_knots(n_u, degrees[0]), degrees[0], u.reshape(-1)).reshape(*u.shape, n_u)
    b = basis_matrix(clamped_knots(n_v, degrees[1]), degrees[1], v.reshape(-1)).reshape(*v.shape, n_v)
    columns = (a @ points.reshape(len(points), n_u, -1)).reshape(*u.shape, n_v, -1)
    return np.asarray(b[..., None, :] @ columns)[..., 0, :]
