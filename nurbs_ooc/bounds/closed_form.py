"""Derivative bounds of tagged surfaces over a native parameter box, in closed form.

With angles as parameters the second derivatives of a circle are its radius, so a cylinder's chord
bound is r a^2 / 8, and a plane's is zero.

No surface of revolution pays for its mixed derivative. Let a triangle have its corners at angles
within a and profile parameters within b. A point of it with weights l_i has the height and the mean
radius of sum l_i C(v_i), which is within b^2 |C''| / 8 of the profile at sum l_i v_i; its true
distance from the axis lies between rho cos(a / 2) and rho, rho that mean radius. So it is within
rho_max (1 - cos(a / 2)) + b^2 |C''| / 8 of the surface, and the map to the surface (keep the angle,
take the profile parameter) agrees on shared edges. ``|S_uv|`` is therefore given as 0.

Source: differentiation of the formulas in ``nurbs_cache.surface_record``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.curve_bounds import D1, D2, SIZE, axis_distance, curve_bounds
from nurbs_ooc.bounds.derivatives import LU, LV, MUU, MVV, OUTWARD
from nurbs_ooc.geometry.bspline import find_span
from nurbs_ooc.geometry.surface import CONE, CYLINDER, EXTRUSION, PLANE, REVOLUTION, SPHERE, TORUS
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Parts of a profile shorter than this, relative to its range, are bounded by the knot span around.
SLIVER = 1e-9


@leaf
def _norm(g: Tables, at: int) -> float:
    return math.sqrt(g.values[at] ** 2 + g.values[at + 1] ** 2 + g.values[at + 2] ** 2)


@leaf
def largest_cosine(a: float, b: float) -> float:
    """Largest |cos| over [a, b]."""
    if math.floor(a / math.pi) != math.floor(b / math.pi):
        return 1.0
    return max(abs(math.cos(a)), abs(math.cos(b)))


@leaf
def profile_bounds(g: Tables, row: int, a: float, b: float, out: Floats) -> None:
    """Over [a, b] of a profile curve: |C'|, |C''| and the distance from the surface's axis, span by span."""
    s = g.surfaces[row]
    c = g.curves[s.profile]
    part = local_line(SIZE)
    for k in range(3):
        out[k] = 0.0
    low = a
    while low < b:
        high = b
        if c.kind == 0:
            for i in range(c.degree, c.n + 1):
                knot = g.values[c.knots + i]
                if knot > low:
                    high = min(high, knot)
                    break
            if high <= low:
                high = b
        start, end = low, high
        if c.kind == 0 and high - low < SLIVER * (c.t1 - c.t0):
            # A box that ends a few units of roundoff beyond a knot: differences over so little are roundoff.
            span = find_span(g.values, c.knots, c.n, c.degree, 0.5 * (low + high))
            start, end = g.values[c.knots + span], g.values[c.knots + span + 1]
        curve_bounds(g, s.profile, start, end, part)
        out[0] = max(out[0], part[D1])
        out[1] = max(out[1], part[D2])
        if s.kind == REVOLUTION:
            out[2] = max(out[2], axis_distance(g, s.profile, start, end, s.frame))
        low = high


@leaf
def closed_form_bounds(g: Tables, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> None:
    """Write |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv| over the box to ``out``, for every kind but NURBS."""
    s = g.surfaces[row]
    f = s.frame
    a, b = g.values[f + 12], g.values[f + 13]
    for k in range(5):
        out[k] = 0.0
    if s.kind == PLANE:
        out[LU], out[LV] = _norm(g, f + 3), _norm(g, f + 6)
    elif s.kind == CYLINDER:
        x, y = _norm(g, f + 3), _norm(g, f + 6)
        dot = 0.0
        for k in range(3):
            dot += g.values[f + 3 + k] * g.values[f + 6 + k]
        # Largest singular value of (X Y): the larger radius, or more if the axes are sheared.
        radius = math.sqrt(0.5 * (x * x + y * y) + math.sqrt(0.25 * (x * x - y * y) ** 2 + dot * dot))
        out[LU], out[LV], out[MUU] = radius, _norm(g, f + 9), radius
    elif s.kind == CONE:
        rho = max(abs(a + v0 * math.sin(b)), abs(a + v1 * math.sin(b)))
        out[LU], out[LV], out[MUU] = rho, 1.0, rho
    elif s.kind == SPHERE:
        cosine = largest_cosine(v0, v1)
        out[LU], out[LV] = a * cosine, a
        out[MUU], out[MVV] = a * cosine, a
    elif s.kind == TORUS:
        rho = max(abs(a + b * math.cos(v0)), abs(a + b * math.cos(v1)))
        if math.floor(v0 / (2.0 * math.pi)) != math.floor(v1 / (2.0 * math.pi)):
            rho = abs(a) + abs(b)
        elif math.floor(v0 / math.pi) != math.floor(v1 / math.pi):
            rho = max(rho, abs(a - b))
        out[LU], out[LV] = rho, abs(b)
        out[MUU], out[MVV] = rho, abs(b)
    elif s.kind == REVOLUTION:
        part = local_line(3)
        profile_bounds(g, row, v0, v1, part)
        out[LU], out[LV] = part[2], part[0]
        out[MUU], out[MVV] = part[2], part[1]
    elif s.kind == EXTRUSION:
        part = local_line(3)
        profile_bounds(g, row, u0, u1, part)
        out[LU], out[LV], out[MUU] = part[0], _norm(g, f + 9), part[1]
    for k in range(5):
        out[k] *= OUTWARD
