"""How far a B-spline surface may move within one step of the triangulation's lattice: what no triangle can resolve."""

from __future__ import annotations

import numpy as np

from nurbs_cache.surface_record import GeometryBatch

STEPS = 2.0**29  # per direction of the domain


def lattice_step(geometry: GeometryBatch, row: int) -> float:
    """mm; a bound from the control net's differences, times the ratio of the weights."""
    s = geometry.surfaces[row]
    dim = 4 if s["rational"] else 3
    n = (int(s["n_u"]), int(s["n_v"]))
    net = geometry.values[s["points"] : s["points"] + n[0] * n[1] * dim].reshape(*n, dim)
    weights = net[..., 3] if dim == 4 else np.ones(n)
    points = net[..., :3] / weights[..., None]
    fastest = 0.0
    for axis, (first, degree, size) in enumerate(
        (
            (int(s["knots_u"]), int(s["degree_u"]), s["u1"] - s["u0"]),
            (int(s["knots_v"]), int(s["degree_v"]), s["v1"] - s["v0"]),
        )
    ):
        knots = geometry.values[first : first + n[axis] + degree + 1]
        support = (knots[degree + 1 : degree + n[axis]] - knots[1 : n[axis]])[:, None]
        length = np.linalg.norm(np.diff(points, axis=axis), axis=2)
        length = length if axis == 0 else length.T
        speed = np.divide(degree * length, support, out=np.zeros_like(length), where=support > 0.0)
        fastest = max(fastest, float(speed.max()) * float(size) / STEPS)
    return fastest * float(weights.max() / weights.min())
