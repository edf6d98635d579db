"""The exact NURBS of any surface of a batch, with the maps of its native parameters.

Tagged surfaces are kept in angles and lengths. As NURBS they are the same point sets in other
parameters: an arc of less than half a turn about its middle m with half opening h is a rational
quadratic, and its Bézier parameter s in [0, 1] belongs to the angle t by

    tan((t - m) / 2) = tan(h / 2) (2 s - 1)          (tanh for a branch of a hyperbola).

Knots stand at the native values, so each span's ends are the same in both parameters.

Source: L. Piegl, W. Tiller, "The NURBS Book", 2nd ed. 1997, ch. 7 and 8 (conics, surfaces of revolution).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

Floats = npt.NDArray[np.float64]
ParameterMap = Literal["identity", "angle", "hyperbolic"]

QUARTER = 0.5 * math.pi  # longest arc of one span
LONGEST_BRANCH = 1.0  # the same for hyperbolas


@dataclass(frozen=True, eq=False)
class NurbsCurve:
    """A clamped rational curve: ``points_w`` (n, dim + 1) rows (w x, ..., w), knots at native values."""

    degree: int
    knots: Floats
    points_w: Floats
    parameter_map: ParameterMap


@dataclass(frozen=True, eq=False)
class NurbsSurface:
    """A clamped rational surface: ``points_w`` (n_u, n_v, 4), knots at native values."""

    degree_u: int
    degree_v: int
    knots_u: Floats
    knots_v: Floats
    points_w: Floats
    map_u: ParameterMap
    map_v: ParameterMap


def _conic(t0: float, t1: float, hyperbolic: bool) -> NurbsCurve:
    """(cos t, sin t) or (cosh t, sinh t) over [t0, t1] as a piecewise rational quadratic."""
    cos, sin = (np.cosh, np.sinh) if hyperbolic else (np.cos, np.sin)
    n = max(1, math.ceil((t1 - t0) / (LONGEST_BRANCH if hyperbolic else QUARTER) - 1e-9))
    breaks = np.linspace(t0, t1, n + 1)
    weight = float(cos(0.5 * (breaks[1] - breaks[0])))
    t = np.empty(2 * n + 1)
    t[0::2], t[1::2] = breaks, 0.5 * (breaks[:-1] + breaks[1:])
    # The middle point is at distance 1 / weight: times its weight it is the conic's own point.
    points = np.stack([cos(t), sin(t), np.where(np.arange(len(t)) % 2 == 1, weight, 1.0)], axis=1)
    knots = np.concatenate([[t0], np.repeat(breaks, 2), [t1]])
    return NurbsCurve(2, knots, points, "hyperbolic" if hyperbolic else "angle")


def _line(t0: float, t1: float, start: Floats, end: Floats) -> NurbsCurve:
    points = np.ones((2, len(start) + 1))
    points[0, :-1], points[1, :-1] = start, end
    return NurbsCurve(1, np.array([t0, t0, t1, t1]), points, "identity")


def curve_form(geometry: GeometryBatch, row: int, t0: float, t1: float) -> NurbsCurve:
    """The exact NURBS of a curve over its used range [t0, t1]; B-splines are given whole."""
    c = geometry.curves[row]
    dim = int(c["dim"])
    at = int(c["points"])
    if c["kind"] != CurveKind.NURBS:
        center, a, b = geometry.values[at : at + 3 * dim].reshape(3, dim)
        conic = _conic(t0, t1, c["kind"] == CurveKind.HYPERBOLA)
        w = conic.points_w[:, 2:]
        xyz = w * center + conic.points_w[:, :1] * a + conic.points_w[:, 1:2] * b
        return NurbsCurve(2, conic.knots, np.hstack([xyz, w]), conic.parameter_map)
    n, degree = int(c["n"]), int(c["degree"])
    columns = dim + int(c["rational"])
    points = geometry.values[at : at + n * columns].reshape(n, columns)
    if not c["rational"]:
        points = np.hstack([points, np.ones((n, 1))])
    knots = geometry.values[int(c["knots"]) : int(c["knots"]) + n + degree + 1]
    return NurbsCurve(degree, knots.copy(), points.copy(), "identity")


def _turned(profile: NurbsCurve, arc: NurbsCurve, frame: Floats) -> NurbsSurface:
    """The profile (points (n, 4), from the origin of space) turned about the frame's axis."""
    origin, x, y, z = frame[:12].reshape(4, 3)
    # A left-handed frame turns the other way round.
    axis = z if np.dot(np.cross(x, y), z) >= 0.0 or not x.any() else -z
    w = profile.points_w[:, 3:]
    d = profile.points_w[:, :3] - w * origin
    height = d @ axis
    radial = d - height[:, None] * axis
    across = np.cross(axis, radial)
    lifted = w * origin + height[:, None] * axis
    c, s, wu = arc.points_w[:, :1, None], arc.points_w[:, 1:2, None], arc.points_w[:, 2:, None]
    xyz = wu * lifted[None] + c * radial[None] + s * across[None]
    weights = arc.points_w[:, 2:] * profile.points_w[:, 3]
    return NurbsSurface(
        2, profile.degree, arc.knots, profile.knots, np.concatenate([xyz, weights[..., None]], axis=2),
        arc.parameter_map, profile.parameter_map,
    )  # fmt: skip


def _swept(profile: NurbsCurve, direction: Floats, v0: float, v1: float) -> NurbsSurface:
    """The profile moved along ``direction`` from v0 to v1."""
    w = profile.points_w[:, 3:]
    ends = [np.hstack([profile.points_w[:, :3] + v * w * direction, w]) for v in (v0, v1)]
    knots_v = np.array([v0, v0, v1, v1])
    return NurbsSurface(
        profile.degree, 1, profile.knots, knots_v, np.stack(ends, axis=1), profile.parameter_map, "identity"
    )


def _meridian(kind: int, frame: Floats, v0: float, v1: float) -> NurbsCurve:
    """The profile of a cone, sphere or torus in the plane of X and Z."""
    origin, x, _, z = frame[:12].reshape(4, 3)
    a, b = frame[12], frame[13]
    if kind == SurfaceKind.CONE:
        ends = [origin + (a + v * math.sin(b)) * x + v * math.cos(b) * z for v in (v0, v1)]
        return _line(v0, v1, ends[0], ends[1])
    center, radius = (origin, a) if kind == SurfaceKind.SPHERE else (origin + a * x, b)
    arc = _conic(v0, v1, False)
    w = arc.points_w[:, 2:]
    xyz = w * center + radius * (arc.points_w[:, :1] * x + arc.points_w[:, 1:2] * z)
    return NurbsCurve(2, arc.knots, np.hstack([xyz, w]), "angle")


def nurbs_form(geometry: GeometryBatch, row: int) -> NurbsSurface:
    """The exact NURBS of the surface in ``row`` over its used domain.

    Returns:
        Control points in mm and the maps of the native parameters; use ``to_nurbs`` on p-curve points.
    """
    s = geometry.surfaces[row]
    kind = int(s["kind"])
    u0, u1, v0, v1 = (float(s[k]) for k in ("u0", "u1", "v0", "v1"))
    if kind == SurfaceKind.NURBS:
        n_u, n_v, dim = int(s["n_u"]), int(s["n_v"]), 4 if s["rational"] else 3
        net = geometry.values[int(s["points"]) : int(s["points"]) + n_u * n_v * dim].reshape(n_u, n_v, dim)
        if dim == 3:
            net = np.concatenate([net, np.ones((n_u, n_v, 1))], axis=2)
        p, q = int(s["degree_u"]), int(s["degree_v"])
        at_u, at_v = int(s["knots_u"]), int(s["knots_v"])
        knots = [geometry.values[at_u : at_u + n_u + p + 1], geometry.values[at_v : at_v + n_v + q + 1]]
        return NurbsSurface(p, q, knots[0].copy(), knots[1].copy(), net.copy(), "identity", "identity")
    frame = geometry.values[int(s["frame"]) : int(s["frame"]) + 14]
    origin, x, y, z = frame[:12].reshape(4, 3)
    if kind == SurfaceKind.PLANE:
        return _swept(_line(u0, u1, origin + u0 * x, origin + u1 * x), y, v0, v1)
    if kind == SurfaceKind.CYLINDER:
        arc = _conic(u0, u1, False)
        w = arc.points_w[:, 2:]
        xyz = w * origin + arc.points_w[:, :1] * x + arc.points_w[:, 1:2] * y
        return _swept(NurbsCurve(2, arc.knots, np.hstack([xyz, w]), "angle"), z, v0, v1)
    if kind == SurfaceKind.EXTRUSION:
        return _swept(curve_form(geometry, int(s["profile"]), u0, u1), z, v0, v1)
    if kind == SurfaceKind.REVOLUTION:
        return _turned(curve_form(geometry, int(s["profile"]), v0, v1), _conic(u0, u1, False), frame)
    return _turned(_meridian(kind, frame, v0, v1), _conic(u0, u1, False), frame)


def to_nurbs(knots: Floats, parameter_map: ParameterMap, t: Floats) -> Floats:
    """Native parameters (n,) of one direction to those of its NURBS, in closed form (see the module)."""
    t = np.asarray(t, dtype=np.float64)
    if parameter_map == "identity":
        return t
    breaks = np.unique(knots)
    i = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(breaks) - 2)
    middle, half = 0.5 * (breaks[i] + breaks[i + 1]), 0.5 * (breaks[i + 1] - breaks[i])
    tangent = np.tanh if parameter_map == "hyperbolic" else np.tan
    s = 0.5 + 0.5 * tangent(0.5 * (t - middle)) / tangent(0.5 * half)
    return np.asarray(breaks[i] + s * (breaks[i + 1] - breaks[i]))
