"""The records' formulas in plain numpy, from the docstring of the layouts alone: an oracle for the readers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

Array = npt.NDArray[np.float64]


def spline(knots: Array, points: Array, degree: int, t: Array, rational: bool) -> Array:
    """B-spline curve by scipy; parameters are kept inside the knots."""
    rows = BSpline(knots, points, degree)(np.clip(t, knots[0], knots[-1]))
    return np.asarray(rows[..., :-1] / rows[..., -1:] if rational else rows)


def curve_points(batch: GeometryBatch, row: int, t: Array) -> Array:
    """(n, dim) points of the curve in ``row``."""
    c: Any = batch.curves[row]
    dim = int(c["dim"])
    if c["kind"] == CurveKind.NURBS:
        n, degree, width = int(c["n"]), int(c["degree"]), dim + int(c["rational"])
        knots = batch.values[c["knots"] : c["knots"] + n + degree + 1]
        points = batch.values[c["points"] : c["points"] + n * width].reshape(n, width)
        return spline(knots, points, degree, t, bool(c["rational"]))
    center, a, b = batch.values[c["points"] : c["points"] + 3 * dim].reshape(3, dim)
    s = np.asarray(t)[:, None]
    if c["kind"] == CurveKind.ELLIPSE:
        return np.asarray(center + np.cos(s) * a + np.sin(s) * b)
    return np.asarray(center + np.cosh(s) * a + np.sinh(s) * b)


def surface_points(batch: GeometryBatch, row: int, uv: Array) -> Array:
    """(n, 3) points of the surface in ``row`` at native parameters."""
    s: Any = batch.surfaces[row]
    if s["kind"] == SurfaceKind.NURBS:
        return _nurbs(batch, s, uv)
    frame = batch.values[s["frame"] : s["frame"] + 14]
    o, x, y, z = frame[:12].reshape(4, 3)
    a, b = frame[12:]
    u, v = uv[:, :1], uv[:, 1:]
    ray = np.cos(u) * x + np.sin(u) * y
    match SurfaceKind(int(s["kind"])):
        case SurfaceKind.PLANE:
            return np.asarray(o + u * x + v * y)
        case SurfaceKind.CYLINDER:
            return np.asarray(o + ray + v * z)
        case SurfaceKind.CONE:
            return np.asarray(o + (a + v * np.sin(b)) * ray + v * np.cos(b) * z)
        case SurfaceKind.SPHERE:
            return np.asarray(o + a * np.cos(v) * ray + a * np.sin(v) * z)
        case SurfaceKind.TORUS:
            return np.asarray(o + (a + b * np.cos(v)) * ray + b * np.sin(v) * z)
        case SurfaceKind.REVOLUTION:
            arm = curve_points(batch, int(s["profile"]), uv[:, 1]) - o
            height = (arm @ z)[:, None] * z
            return np.asarray(o + height + np.cos(u) * (arm - height) + np.sin(u) * np.cross(z, arm))
        case _:
            return np.asarray(curve_points(batch, int(s["profile"]), uv[:, 0]) + v * z)


def _nurbs(batch: GeometryBatch, s: Any, uv: Array) -> Array:
    n_u, n_v, p, q = (int(s[k]) for k in ("n_u", "n_v", "degree_u", "degree_v"))
    width = 3 + int(s["rational"])
    knots_u = batch.values[s["knots_u"] : s["knots_u"] + n_u + p + 1]
    knots_v = batch.values[s["knots_v"] : s["knots_v"] + n_v + q + 1]
    net = batch.values[s["points"] : s["points"] + n_u * n_v * width].reshape(n_u, n_v, width)
    assert (knots_u[: p + 1] == knots_u[0]).all()
    assert (knots_u[-p - 1 :] == knots_u[-1]).all()
    assert (knots_v[: q + 1] == knots_v[0]).all()
    assert (knots_v[-q - 1 :] == knots_v[-1]).all()
    in_u = BSpline.design_matrix(np.clip(uv[:, 0], knots_u[0], knots_u[-1]), knots_u, p).toarray()
    in_v = BSpline.design_matrix(np.clip(uv[:, 1], knots_v[0], knots_v[-1]), knots_v, q).toarray()
    points = np.einsum("ij,ik,jkd->id", in_u, in_v, net, optimize=True)
    return points[:, :3] / points[:, 3:] if width == 4 else points


def loops_of(batch: GeometryBatch, row: int) -> list[npt.NDArray[np.void]]:
    """The coedges of each loop of the surface in ``row``."""
    s = batch.surfaces[row]
    loops = batch.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]
    return [batch.coedges[k["first_coedge"] : k["first_coedge"] + k["n_coedges"]] for k in loops]


def pcurve_points(batch: GeometryBatch, coedge: Any, n: int = 9) -> Array:
    """(n, 2) points from the p-curve's t0 to its t1."""
    c = batch.curves[coedge["pcurve"]]
    return curve_points(batch, int(coedge["pcurve"]), np.linspace(c["t0"], c["t1"], n))


def edge_points(batch: GeometryBatch, row: int, n: int = 9) -> Array:
    """(n, 3) points from the edge's t0 to its t1."""
    e = batch.edges[row]
    if e["curve"] < 0:
        return np.repeat(batch.vertices[e["vertex0"]][None], n, axis=0)
    return curve_points(batch, int(e["curve"]), np.linspace(e["t0"], e["t1"], n))


def edge_gap(batch: GeometryBatch, row: int) -> float:
    """Largest distance between the surface along its p-curves and the edges, as a multiple of the tolerance."""
    worst = 0.0
    for loop in loops_of(batch, row):
        for coedge in loop:
            on_surface = surface_points(batch, row, pcurve_points(batch, coedge))
            gap = np.linalg.norm(on_surface - edge_points(batch, int(coedge["edge"])), axis=1).max()
            worst = max(worst, gap / max(float(batch.edges[coedge["edge"]]["tolerance"]), 1e-6))
    return worst


def loop_jump(batch: GeometryBatch, row: int) -> float:
    """Largest jump in (u, v) between consecutive coedges, as a share of the face's domain."""
    s = batch.surfaces[row]
    extent = np.array([s["u1"] - s["u0"], s["v1"] - s["v0"]])
    worst = 0.0
    for loop in loops_of(batch, row):
        ends = [pcurve_points(batch, c, 2)[:: -1 if c["reversed"] else 1] for c in loop]
        for this, following in zip(ends, ends[1:] + ends[:1], strict=True):
            worst = max(worst, float((np.abs(following[0] - this[1]) / extent).max()))
    return worst


def signed_volume(batch: GeometryBatch, n: int = 120) -> float:
    """Rough volume inside the faces by the divergence theorem; positive if normals point outwards.

    Each face is sampled on n x n cell centres of its domain, masked by the even-odd rule.
    """
    total = 0.0
    for row, s in enumerate(batch.surfaces):
        u = s["u0"] + (np.arange(n) + 0.5) / n * (s["u1"] - s["u0"])
        v = s["v0"] + (np.arange(n) + 0.5) / n * (s["v1"] - s["v0"])
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)
        uv = uv[_inside(batch, row, uv)]
        if not len(uv):
            continue
        h = 1e-6 * np.array([s["u1"] - s["u0"], s["v1"] - s["v0"]])
        points = surface_points(batch, row, uv)
        d_u = (
            surface_points(batch, row, uv + np.array([h[0], 0])) - surface_points(batch, row, uv - np.array([h[0], 0]))
        ) / (2 * h[0])
        d_v = (
            surface_points(batch, row, uv + np.array([0, h[1]])) - surface_points(batch, row, uv - np.array([0, h[1]]))
        ) / (2 * h[1])
        flux = np.einsum("ij,ij->i", points, np.cross(d_u, d_v)).sum()
        cell = (s["u1"] - s["u0"]) * (s["v1"] - s["v0"]) / n**2
        total += (-1.0 if s["reversed"] else 1.0) * flux * cell / 3.0
    return total


def _inside(batch: GeometryBatch, row: int, uv: Array) -> npt.NDArray[np.bool_]:
    inside = np.zeros(len(uv), bool)
    for loop in loops_of(batch, row):
        polygon = np.concatenate([pcurve_points(batch, c, 33)[:: -1 if c["reversed"] else 1][:-1] for c in loop])
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            crosses = (a[1] > uv[:, 1]) != (b[1] > uv[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                at = a[0] + (uv[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            inside ^= crosses & (uv[:, 0] < at)
    return inside
