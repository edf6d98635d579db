"""Boxes of the normal's slopes of tagged surfaces, from their formulas.

Sphere and torus have the normal cos v E(u) + sin v Z, E(u) = cos u X + sin u Y, a cone cos b E(u) - sin b Z, and
a cylinder, whose X and Y may be of different length and not at right angles, cos u (Y x Z) - sin u (X x Z). Their
sense is the sign of the distance from the axis; where it changes there is no slope. A surface of revolution
is its profile, turned: D_k, its profile's derivatives turned by u, give S_(i)(k) = (Z x)^i D_k.

Source: differentiation of the formulas in ``nurbs_cache.surface_record``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.curve_slopes import curve_derivatives
from nurbs_ooc.bounds.derivative_boxes import order
from nurbs_ooc.bounds.intervals import add_scaled, cosines, largest, map_linear, set_zero, sines, times
from nurbs_ooc.bounds.slope_field import NO_POLE, POLE_V, normal_boxes, slope_boxes, turn_up
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.surface import CONE, CYLINDER, EXTRUSION, SPHERE
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]

BASIS = MAX_DEGREE + 2  # room for the basis functions of a point

# The distance from the axis may have the other sign by this share of its terms: roundoff of a pole's parameter.
TOUCHING = 1e-12
ROUNDOFF = 2.0**-52


@leaf
def _along(g: Tables, at: int, frame: Floats, out: Floats) -> None:
    """Components of the record's vector at ``at`` in the frame, to ``out`` (3,)."""
    for e in range(3):
        out[e] = 0.0
        for k in range(3):
            out[e] += frame[3 * e + k] * g.values[at + k]


@leaf
def _add_fixed(low: float, high: float, vector: Floats, out: Floats, k: int) -> None:
    """``out[k]`` += [low, high] ``vector``."""
    for e in range(3):
        p, q = times(low, high, vector[e], vector[e])
        out[k, 2 * e] += p
        out[k, 2 * e + 1] += q


@leaf
def _cross(x: Floats, y: Floats, out: Floats) -> None:
    out[0] = x[1] * y[2] - x[2] * y[1]
    out[1] = x[2] * y[0] - x[0] * y[2]
    out[2] = x[0] * y[1] - x[1] * y[0]


@leaf
def _axis_kept(g: Tables, row: int, box: Floats) -> bool:
    """Whether a cone or a torus stays on one side of its axis over a parameter box."""
    s = g.surfaces[row]
    a, b = g.values[s.frame + 12], g.values[s.frame + 13]
    if s.kind == CYLINDER or s.kind == SPHERE:
        return True
    if s.kind == CONE:
        x, y = a + box[2] * math.sin(b), a + box[3] * math.sin(b)
        low, high = min(x, y), max(x, y)
    else:
        x, y = cosines(box[2], box[3])
        p, q = times(b, b, x, y)
        low, high = a + p, a + q
    hair = TOUCHING * (abs(a) + abs(b))
    return low > -hair or high < hair


@leaf
def _turned_normals(g: Tables, row: int, box: Floats, frame: Floats, a: float, b: float, n: Floats) -> None:
    """The normals' boxes of cylinder, cone, sphere and torus over a box, to ``n`` (SECONDS, 6)."""
    s = g.surfaces[row]
    x, y, z = local_line(3), local_line(3), local_line(3)
    _along(g, s.frame + 3, frame, x)
    _along(g, s.frame + 6, frame, y)
    _along(g, s.frame + 9, frame, z)
    if s.kind == CYLINDER:
        p, q = local_line(3), local_line(3)
        _cross(y, z, p)
        _cross(z, x, q)
        for k in range(3):
            x[k], y[k] = p[k], q[k]
    half = g.values[s.frame + 13]
    for m in range(3):
        for j in range(m + 1):
            i = m - j
            k = order(i, j)
            set_zero(n, k)
            turn = 0.5 * math.pi * i
            if s.kind == CYLINDER or s.kind == CONE:
                if j > 0:
                    continue
                factor, height = (1.0, 0.0) if s.kind == CYLINDER else (math.cos(half), -math.sin(half))
                low, high = factor, factor
                up, top = height, height
            else:
                # Derivatives of cos v and sin v: a quarter of a turn each.
                low, high = cosines(box[2] + 0.5 * math.pi * j, box[3] + 0.5 * math.pi * j)
                up, top = sines(box[2] + 0.5 * math.pi * j, box[3] + 0.5 * math.pi * j)
            c0, c1 = cosines(box[0] + turn, box[1] + turn)
            s0, s1 = sines(box[0] + turn, box[1] + turn)
            scale = a**i * b**j
            p0, p1 = times(low, high, c0, c1)
            q0, q1 = times(low, high, s0, s1)
            _add_fixed(scale * p0, scale * p1, x, n, k)
            _add_fixed(scale * q0, scale * q1, y, n, k)
            if i == 0:
                _add_fixed(scale * up, scale * top, z, n, k)
    turn_up(n)


@leaf
def turned_slopes(g: Tables, row: int, box: Floats, frame: Floats, a: float, b: float, out: Floats) -> float:
    """As ``spline_slopes``, of a cylinder, cone, sphere or torus."""
    n = local_table(6, 6)
    if not _axis_kept(g, row, box):
        return math.inf
    _turned_normals(g, row, box, frame, a, b, n)
    if not slope_boxes(n, out):
        return math.inf
    return 0.0


@leaf
def _turned_frame(g: Tables, at: int, angle: float, frame: Floats, out: Floats) -> None:
    """The frame's axes turned by -``angle`` about the axis z at ``at``: where a profile has yet to be turned."""
    c, s = math.cos(angle), math.sin(angle)
    for e in range(0, 9, 3):
        along = 0.0
        for k in range(3):
            along += g.values[at + k] * frame[e + k]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            cross = g.values[at + i] * frame[e + j] - g.values[at + j] * frame[e + i]
            out[e + k] = c * frame[e + k] - s * cross + (1.0 - c) * along * g.values[at + k]


@leaf
def _revolve(g: Tables, row: int, a: float, frame: Floats, profile: Floats, r: Floats) -> None:
    """All derivatives to ``r`` from the profile's in the middle of an angle ``a``; ``profile`` is scratch then."""
    z = local_line(3)
    _along(g, g.surfaces[row].frame + 9, frame, z)
    cross, across = local_line(9), local_line(9)
    for i in range(3):
        for j in range(3):
            across[3 * i + j] = (1.0 if i == j else 0.0) - z[i] * z[j]
            cross[3 * i + j] = 0.0
    cross[1], cross[2], cross[3], cross[5], cross[6], cross[7] = -z[2], z[1], z[2], -z[0], -z[1], z[0]
    c, s = math.cos(0.5 * a) - 1.0, math.sin(0.5 * a)
    turned = local_table(2, 6)
    for j in range(4):
        k, to = order(j, 0), order(0, j)
        map_linear(across, profile, k, turned, 0)
        map_linear(cross, profile, k, turned, 1)
        for e in range(6):
            r[to, e] = profile[k, e]
        add_scaled(c, 0.0, turned, 0, r, to)
        add_scaled(-s, s, turned, 1, r, to)
    for j in range(4):
        for i in range(1, 4 - j):
            k = order(i, j)
            map_linear(cross, r, order(i - 1, j), r, k)
            for e in range(6):
                r[k, e] *= a


@leaf
def _profile_noise(g: Tables, row: int, center: Floats, x: Floats, y: Floats, n: Floats) -> float:
    """What roundoff of a profile's control points may do to slopes."""
    p = min(int(g.curves[g.surfaces[row].profile].degree), MAX_DEGREE)
    size = abs(center[0]) + abs(center[1]) + abs(center[2])
    return 2.0 * (p + 4) * ROUNDOFF * size * (p + 1.0) ** 3 * (largest(x, 0, 3) + largest(y, 0, 3)) / n[0, 4]


@leaf
def swept_slopes(
    g: Tables, row: int, box: Floats, span: Floats, pole: int, side: int, frame: Floats, center: Floats,
    a: float, b: float, out: Floats,
) -> float:  # fmt: skip
    """As ``spline_slopes``, of a surface that sweeps a profile, over a box within one ``span`` (2,) of that.

    ``pole`` is -1 or 1 if the profile reaches the axis of its surface at that end of the span, else 0; ``side``
    tells whether only an end of the profile's part of the box counts.
    """
    s = g.surfaces[row]
    f = s.frame
    profile = local_table(10, 8)
    r = local_table(10, 8)
    x, y, n = local_table(6, 6), local_table(6, 6), local_table(6, 6)
    origin = local_line(3)
    rho0, rho1, slope = 1.0, 1.0, 0.0
    if s.kind == EXTRUSION:
        for k in range(3):
            origin[k] = center[k]
        curve_derivatives(g, s.profile, box[0], box[1], span, 0, origin, frame, side, a, profile)
        axis = local_line(3)
        _along(g, f + 9, frame, axis)
        for k in range(10):
            set_zero(r, k)
        for i in range(4):
            for e in range(6):
                r[order(i, 0), e] = profile[order(i, 0), e]
        _add_fixed(b, b, axis, r, order(0, 1))
    else:
        along = 0.0
        end = local_line(6)
        scratch = local_table(2, BASIS)
        for k in range(3):
            end[k] = center[k]
        if pole:
            curve_point(g, s.profile, span[0] if pole < 0 else span[1], scratch, end)
        for k in range(3):
            along += (end[k] - g.values[f + k]) * g.values[f + 9 + k]
        for k in range(3):
            origin[k] = end[k] if pole else g.values[f + k] + along * g.values[f + 9 + k]
        turned = local_line(9)
        _turned_frame(g, f + 9, 0.5 * (box[0] + box[1]), frame, turned)
        curve_derivatives(g, s.profile, box[2], box[3], span, pole, origin, turned, side, b, profile)
        _revolve(g, row, a, frame, profile, r)
        if pole:
            wide = span[1] - span[0]
            rho0, rho1, slope = (box[2] - span[0]) / wide, (box[3] - span[0]) / wide, b / wide
            if pole > 0:
                rho0, rho1, slope = 1.0 - rho1, 1.0 - rho0, -slope
    normal_boxes(r, POLE_V if pole else NO_POLE, max(rho0, 0.0), rho1, slope, x, y, n)
    if not slope_boxes(n, out):
        return math.inf
    return _profile_noise(g, row, center, x, y, n)
