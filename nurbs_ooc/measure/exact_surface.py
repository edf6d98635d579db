"""Points and tangents of recorded surfaces of every kind, straight from their definitions.

One kernel call takes samples of any mixture of faces. The formulas are those of the table in
``nurbs_cache.surface_record``; nothing is shared with the tessellator.

Source: L. Piegl and W. Tiller, The NURBS Book, 2nd edition, 1997: A3.5 (surface point), A4.3 and
equation 4.20 (rational point and derivatives).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.measure.exact_curve import MAX_DEGREE, basis, curve_point, find_span

_NURBS = int(SurfaceKind.NURBS)
_PLANE = int(SurfaceKind.PLANE)
_CYLINDER = int(SurfaceKind.CYLINDER)
_CONE = int(SurfaceKind.CONE)
_SPHERE = int(SurfaceKind.SPHERE)
_TORUS = int(SurfaceKind.TORUS)
_REVOLUTION = int(SurfaceKind.REVOLUTION)


@leaf
def _into_period(values, first, n, degree, period, t) -> float:  # type: ignore[no-untyped-def]
    """Turn ``t`` by whole periods into the domain of the knots."""
    low, high = values[first + degree], values[first + n]
    if period > 0.0 and (t < low or t > high):
        t -= period * math.floor((t - low) / period)
    return t


@leaf
def _nurbs_point(values, s, u, v, scratch, out) -> None:  # type: ignore[no-untyped-def]
    u = _into_period(values, s.knots_u, s.n_u, s.degree_u, s.u_period, u)
    v = _into_period(values, s.knots_v, s.n_v, s.degree_v, s.v_period, v)
    span_u = find_span(values, s.knots_u, s.n_u, s.degree_u, u)
    span_v = find_span(values, s.knots_v, s.n_v, s.degree_v, v)
    in_u, in_v = scratch[0], scratch[1]
    basis(values, s.knots_u, span_u, s.degree_u, u, in_u)
    basis(values, s.knots_v, span_v, s.degree_v, v, in_v)
    width = 4 if s.rational else 3
    out[:] = 0.0
    w, w_u, w_v = 0.0, 0.0, 0.0
    for i in range(s.degree_u + 1):
        row = s.points + ((span_u - s.degree_u + i) * s.n_v + span_v - s.degree_v) * width
        for j in range(s.degree_v + 1):
            b = in_u[0, i] * in_v[0, j]
            b_u = in_u[1, i] * in_v[0, j]
            b_v = in_u[0, i] * in_v[1, j]
            for k in range(3):
                out[0, k] += b * values[row + k]
                out[1, k] += b_u * values[row + k]
                out[2, k] += b_v * values[row + k]
            if s.rational:
                w += b * values[row + 3]
                w_u += b_u * values[row + 3]
                w_v += b_v * values[row + 3]
            row += width
    if s.rational:
        for k in range(3):
            out[0, k] /= w
            out[1, k] = (out[1, k] - w_u * out[0, k]) / w
            out[2, k] = (out[2, k] - w_v * out[0, k]) / w


@leaf
def _turned_point(values, frame, kind, u, v, out) -> None:  # type: ignore[no-untyped-def]
    """Cylinder, cone, sphere and torus: out = O + r (cos u X + sin u Y) + h Z with r, h functions of v."""
    a, b = values[frame + 12], values[frame + 13]
    if kind == _CYLINDER:
        r, r_v, h, h_v = 1.0, 0.0, v, 1.0
    elif kind == _CONE:
        r, r_v, h, h_v = a + v * math.sin(b), math.sin(b), v * math.cos(b), math.cos(b)
    elif kind == _SPHERE:
        r, r_v, h, h_v = a * math.cos(v), -a * math.sin(v), a * math.sin(v), a * math.cos(v)
    else:
        r, r_v, h, h_v = a + b * math.cos(v), -b * math.sin(v), b * math.sin(v), b * math.cos(v)
    c, s = math.cos(u), math.sin(u)
    for k in range(3):
        x, y, z = values[frame + 3 + k], values[frame + 6 + k], values[frame + 9 + k]
        out[0, k] = values[frame + k] + r * (c * x + s * y) + h * z
        out[1, k] = r * (c * y - s * x)
        out[2, k] = r_v * (c * x + s * y) + h_v * z


@leaf
def _revolved_point(values, frame, u, at, out) -> None:  # type: ignore[no-untyped-def]
    """Turn the profile's point ``at[0]`` and tangent ``at[1]`` by u about the axis (Rodrigues' formula)."""
    c, s = math.cos(u), math.sin(u)
    zx, zy, zz = values[frame + 9], values[frame + 10], values[frame + 11]
    for row in range(2):
        x, y, z = at[row, 0], at[row, 1], at[row, 2]
        if row == 0:
            x, y, z = x - values[frame], y - values[frame + 1], z - values[frame + 2]
        along = (1.0 - c) * (zx * x + zy * y + zz * z)
        out[2 * row, 0] = c * x + s * (zy * z - zz * y) + along * zx
        out[2 * row, 1] = c * y + s * (zz * x - zx * z) + along * zy
        out[2 * row, 2] = c * z + s * (zx * y - zy * x) + along * zz
    out[1, 0] = zy * out[0, 2] - zz * out[0, 1]
    out[1, 1] = zz * out[0, 0] - zx * out[0, 2]
    out[1, 2] = zx * out[0, 1] - zy * out[0, 0]
    for k in range(3):
        out[0, k] += values[frame + k]


@leaf
def surface_point(surfaces, curves, values, row, u, v, scratch, out) -> None:  # type: ignore[no-untyped-def]
    """``out[0]``, ``out[1]``, ``out[2]`` become S, S_u and S_v of the surface in ``row`` at (u, v).

    ``scratch`` is (3, 2, MAX_DEGREE + 1).
    """
    s = surfaces[row]
    if s.kind == _NURBS:
        _nurbs_point(values, s, u, v, scratch, out)
    elif s.kind == _PLANE:
        for k in range(3):
            out[1, k] = values[s.frame + 3 + k]
            out[2, k] = values[s.frame + 6 + k]
            out[0, k] = values[s.frame + k] + u * out[1, k] + v * out[2, k]
    elif s.kind <= _TORUS:
        _turned_point(values, s.frame, s.kind, u, v, out)
    elif s.kind == _REVOLUTION:
        curve_point(values, curves[s.profile], v, scratch[0], scratch[2])
        _revolved_point(values, s.frame, u, scratch[2], out)
    else:
        curve_point(values, curves[s.profile], u, scratch[0], scratch[2])
        for k in range(3):
            out[0, k] = scratch[2, 0, k] + v * values[s.frame + 9 + k]
            out[1, k] = scratch[2, 1, k]
            out[2, k] = values[s.frame + 9 + k]


@kernel
def _surface_points(surfaces, curves, values, rows, uv, out):  # type: ignore[no-untyped-def]
    scratch = np.empty((3, 2, MAX_DEGREE + 1))
    for i in range(len(rows)):
        surface_point(surfaces, curves, values, rows[i], uv[i, 0], uv[i, 1], scratch, out[i])


def derivatives(geometry: GeometryBatch, rows: npt.ArrayLike, uv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Points and partial derivatives of many surfaces at native parameters.

    Args:
        geometry: holds the surfaces.
        rows: (n,) rows of ``geometry.surfaces`` or one row for all samples.
        uv: (n, 2) native parameters; beyond the knots the end pieces go on.

    Returns:
        (n, 3, 3) float64: S, S_u, S_v of each sample; mm and mm per unit of parameter.
    """
    at = np.ascontiguousarray(uv, float).reshape(-1, 2)
    row = np.ascontiguousarray(np.broadcast_to(np.asarray(rows, np.int64), len(at)))
    out = np.empty((len(at), 3, 3))
    _surface_points(geometry.surfaces, geometry.curves, geometry.values, row, at, out)
    return out


def points(geometry: GeometryBatch, rows: npt.ArrayLike, uv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """(n, 3) points of many surfaces; arguments as for ``derivatives``."""
    return derivatives(geometry, rows, uv)[:, 0]


def normals(geometry: GeometryBatch, rows: npt.ArrayLike, uv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """(n, 3) unit normals to the outside of each face; zero where the tangents do not span a plane."""
    d = derivatives(geometry, rows, uv)
    normal = np.cross(d[:, 1], d[:, 2])
    length = np.linalg.norm(normal, axis=1)
    flat = length <= 1e-12 * np.linalg.norm(d[:, 1], axis=1) * np.linalg.norm(d[:, 2], axis=1)
    sign = np.where(geometry.surfaces["reversed"][np.broadcast_to(np.asarray(rows, np.int64), len(d))], -1.0, 1.0)
    normal *= np.where(flat, 0.0, sign / np.where(flat, 1.0, length))[:, None]
    return normal
