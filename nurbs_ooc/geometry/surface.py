"""Evaluation of surfaces of every kind: points, partial derivatives and outside normals.

Tagged surfaces are evaluated by their closed form in native parameters; no rational arithmetic is
done for polynomial surfaces.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.bspline import basis, find_span
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables

Floats = npt.NDArray[np.float64]

NURBS = int(SurfaceKind.NURBS)
PLANE = int(SurfaceKind.PLANE)
CYLINDER = int(SurfaceKind.CYLINDER)
CONE = int(SurfaceKind.CONE)
SPHERE = int(SurfaceKind.SPHERE)
TORUS = int(SurfaceKind.TORUS)
REVOLUTION = int(SurfaceKind.REVOLUTION)
EXTRUSION = int(SurfaceKind.EXTRUSION)

# A parallelogram thinner than this, relative to the sides, counts as a pole: 1e4 units of roundoff.
POLE_SINE = 2.0**-39
# A partial that moves a point by less than this part of its coordinates, all over the domain, is roundoff.
VANISHING = 2.0**-42
# Numbers in a row of the control points that reach a point, from which on rows are added up as such.
WIDE = 20
WIDEST = 4 * (MAX_DEGREE + 1)
# How far inside the domain the limit normal of a pole is taken, relative to its size.
POLE_STEPS = (1e-7, 1e-5, 1e-3, 3e-2)


@leaf
def _put_projected(
    rational: bool, p0: float, p1: float, p2: float, w: float, u0: float, u1: float, u2: float, wu: float,
    v0: float, v1: float, v2: float, wv: float, out: Floats,
) -> None:  # fmt: skip
    """Write a homogeneous point (p, w) and its partials (u, wu), (v, wv) to ``out[0:9]``, divided if rational."""
    if rational:
        p0, p1, p2 = p0 / w, p1 / w, p2 / w
        u0, u1, u2 = (u0 - wu * p0) / w, (u1 - wu * p1) / w, (u2 - wu * p2) / w
        v0, v1, v2 = (v0 - wv * p0) / w, (v1 - wv * p1) / w, (v2 - wv * p2) / w
    out[0], out[1], out[2] = p0, p1, p2
    out[3], out[4], out[5] = u0, u1, u2
    out[6], out[7], out[8] = v0, v1, v2


@leaf
def _wide_point(g: Tables, row: int, span_u: int, span_v: int, scratch: Floats, out: Floats) -> None:
    """The end of ``_nurbs_point`` for rows so long that it pays to add them up in lanes first."""
    s = g.surfaces[row]
    dim = 4 if s.rational else 3
    width = (s.degree_v + 1) * dim
    line, slope = local_line(WIDEST), local_line(WIDEST)
    for m in range(width):
        line[m], slope[m] = 0.0, 0.0
    for i in range(s.degree_u + 1):
        at = s.points + ((span_u - s.degree_u + i) * s.n_v + span_v - s.degree_v) * dim
        n, d = scratch[0, i], scratch[1, i]
        for m in range(width):
            line[m] += n * g.values[at + m]
            slope[m] += d * g.values[at + m]
    p0, p1, p2, w = 0.0, 0.0, 0.0, 0.0
    u0, u1, u2, wu = 0.0, 0.0, 0.0, 0.0
    v0, v1, v2, wv = 0.0, 0.0, 0.0, 0.0
    for j in range(s.degree_v + 1):
        at = j * dim
        n, d = scratch[2, j], scratch[3, j]
        x, y, z = line[at], line[at + 1], line[at + 2]
        p0, p1, p2 = p0 + n * x, p1 + n * y, p2 + n * z
        v0, v1, v2 = v0 + d * x, v1 + d * y, v2 + d * z
        u0, u1, u2 = u0 + n * slope[at], u1 + n * slope[at + 1], u2 + n * slope[at + 2]
        if dim == 4:
            w, wv, wu = w + n * line[at + 3], wv + d * line[at + 3], wu + n * slope[at + 3]
    _put_projected(dim == 4, p0, p1, p2, w, u0, u1, u2, wu, v0, v1, v2, wv, out)


@leaf
def _nurbs_point(g: Tables, row: int, u: float, v: float, scratch: Floats, out: Floats) -> None:
    """Tensor-product point and partials; ``scratch`` rows: N(u), N'(u), N(v), N'(v)."""
    s = g.surfaces[row]
    values = g.values
    span_u = find_span(values, s.knots_u, s.n_u, s.degree_u, u)
    span_v = find_span(values, s.knots_v, s.n_v, s.degree_v, v)
    basis(values, s.knots_u, span_u, s.degree_u, u, scratch[0], scratch[1])
    basis(values, s.knots_v, span_v, s.degree_v, v, scratch[2], scratch[3])
    dim = 4 if s.rational else 3
    if (s.degree_v + 1) * dim >= WIDE:
        _wide_point(g, row, span_u, span_v, scratch, out)
        return
    # Sums in registers: a row of control points along v and its slope, then rows along u.
    p0, p1, p2, w = 0.0, 0.0, 0.0, 0.0
    u0, u1, u2, wu = 0.0, 0.0, 0.0, 0.0
    v0, v1, v2, wv = 0.0, 0.0, 0.0, 0.0
    for i in range(s.degree_u + 1):
        at = s.points + ((span_u - s.degree_u + i) * s.n_v + span_v - s.degree_v) * dim
        a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
        b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
        for j in range(s.degree_v + 1):
            n, d = scratch[2, j], scratch[3, j]
            a0 += n * values[at]
            a1 += n * values[at + 1]
            a2 += n * values[at + 2]
            b0 += d * values[at]
            b1 += d * values[at + 1]
            b2 += d * values[at + 2]
            if dim == 4:
                a3 += n * values[at + 3]
                b3 += d * values[at + 3]
            at += dim
        n, d = scratch[0, i], scratch[1, i]
        p0, p1, p2, w = p0 + n * a0, p1 + n * a1, p2 + n * a2, w + n * a3
        u0, u1, u2, wu = u0 + d * a0, u1 + d * a1, u2 + d * a2, wu + d * a3
        v0, v1, v2, wv = v0 + n * b0, v1 + n * b1, v2 + n * b2, wv + n * b3
    _put_projected(dim == 4, p0, p1, p2, w, u0, u1, u2, wu, v0, v1, v2, wv, out)


@leaf
def _swept_point(g: Tables, row: int, u: float, v: float, scratch: Floats, out: Floats) -> None:
    """Surfaces with a profile curve: revolution about the frame's axis, extrusion along it."""
    s = g.surfaces[row]
    f = s.frame
    if s.kind == EXTRUSION:
        curve_point(g, s.profile, u, scratch, out)
        for k in range(3):
            z = g.values[f + 9 + k]
            out[k] += v * z
            out[6 + k] = z
        return
    curve_point(g, s.profile, v, scratch, out)
    o0, o1, o2 = g.values[f], g.values[f + 1], g.values[f + 2]
    z0, z1, z2 = g.values[f + 9], g.values[f + 10], g.values[f + 11]
    cu, su = math.cos(u), math.sin(u)
    # Turn the position (from the axis point) and the profile's tangent about the axis.
    d0, d1, d2 = out[0] - o0, out[1] - o1, out[2] - o2
    t0, t1, t2 = out[3], out[4], out[5]
    h = d0 * z0 + d1 * z1 + d2 * z2
    p0, p1, p2 = d0 - h * z0, d1 - h * z1, d2 - h * z2
    q0, q1, q2 = z1 * p2 - z2 * p1, z2 * p0 - z0 * p2, z0 * p1 - z1 * p0
    out[0] = o0 + h * z0 + cu * p0 + su * q0
    out[1] = o1 + h * z1 + cu * p1 + su * q1
    out[2] = o2 + h * z2 + cu * p2 + su * q2
    out[3] = cu * q0 - su * p0
    out[4] = cu * q1 - su * p1
    out[5] = cu * q2 - su * p2
    h = t0 * z0 + t1 * z1 + t2 * z2
    p0, p1, p2 = t0 - h * z0, t1 - h * z1, t2 - h * z2
    q0, q1, q2 = z1 * p2 - z2 * p1, z2 * p0 - z0 * p2, z0 * p1 - z1 * p0
    out[6] = h * z0 + cu * p0 + su * q0
    out[7] = h * z1 + cu * p1 + su * q1
    out[8] = h * z2 + cu * p2 + su * q2


@leaf
def surface_point(g: Tables, row: int, u: float, v: float, scratch: Floats, out: Floats) -> None:
    """Write S, S_u, S_v to ``out[0:9]``; ``scratch`` is (4, MAX_DEGREE + 2)."""
    s = g.surfaces[row]
    if s.kind == NURBS:
        _nurbs_point(g, row, u, v, scratch, out)
        return
    if s.kind == REVOLUTION or s.kind == EXTRUSION:
        _swept_point(g, row, u, v, scratch, out)
        return
    f = s.frame
    a, b = g.values[f + 12], g.values[f + 13]
    # All others are O + p X + q Y + r Z with coefficients of u and v.
    if s.kind == PLANE:
        p, q, r = u, v, 0.0
        pu, qu, ru = 1.0, 0.0, 0.0
        pv, qv, rv = 0.0, 1.0, 0.0
    else:
        cu, su = math.cos(u), math.sin(u)
        if s.kind == CYLINDER:
            rho, r, drho, rv = 1.0, v, 0.0, 1.0
        elif s.kind == CONE:
            rho, r, drho, rv = a + v * math.sin(b), v * math.cos(b), math.sin(b), math.cos(b)
        elif s.kind == SPHERE:
            rho, r, drho, rv = a * math.cos(v), a * math.sin(v), -a * math.sin(v), a * math.cos(v)
        else:
            rho, r, drho, rv = a + b * math.cos(v), b * math.sin(v), -b * math.sin(v), b * math.cos(v)
        p, q = rho * cu, rho * su
        pu, qu, ru = -rho * su, rho * cu, 0.0
        pv, qv = drho * cu, drho * su
    for k in range(3):
        x, y, z = g.values[f + 3 + k], g.values[f + 6 + k], g.values[f + 9 + k]
        out[k] = g.values[f + k] + p * x + q * y + r * z
        out[3 + k] = pu * x + qu * y + ru * z
        out[6 + k] = pv * x + qv * y + rv * z


@leaf
def unit_cross(d: Floats, out: Floats) -> bool:
    """Write the unit vector of S_u x S_v (``d[3:9]``) to ``out``; False where it has no direction."""
    x = d[4] * d[8] - d[5] * d[7]
    y = d[5] * d[6] - d[3] * d[8]
    z = d[3] * d[7] - d[4] * d[6]
    size = math.sqrt(x * x + y * y + z * z)
    sides = math.sqrt(d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) * math.sqrt(d[6] * d[6] + d[7] * d[7] + d[8] * d[8])
    if not size > POLE_SINE * sides or size == 0.0:
        return False
    out[0] = x / size
    out[1] = y / size
    out[2] = z / size
    return True


@leaf
def vanishing_partials(g: Tables, row: int, d: Floats) -> tuple[bool, bool]:
    """Whether S_u, and whether S_v, of S, S_u, S_v in ``d`` (9,) is nothing beside the other and roundoff.

    Partials count times the size of the used domain, so the answer does not depend on the parameters' unit.
    """
    s = g.surfaces[row]
    size_u, size_v = s.u1 - s.u0, s.v1 - s.v0
    # Squares throughout.
    roundoff = VANISHING * VANISHING * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    along_u = (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) * size_u * size_u
    along_v = (d[6] * d[6] + d[7] * d[7] + d[8] * d[8]) * size_v * size_v
    sine = POLE_SINE * POLE_SINE
    return along_u <= max(roundoff, sine * along_v), along_v <= max(roundoff, sine * along_u)


@leaf
def normal_of(g: Tables, row: int, d: Floats, out: Floats) -> bool:
    """Write the unit vector of S_u x S_v to ``out`` (3,), from S, S_u, S_v in ``d`` (9,); False at a pole."""
    no_u, no_v = vanishing_partials(g, row, d)
    return not no_u and not no_v and unit_cross(d, out)


@leaf
def _limit_normal(g: Tables, row: int, u: float, v: float, scratch: Floats, out: Floats) -> bool:
    """The normal a little inside the domain, as near to the pole (u, v) as one is found."""
    s = g.surfaces[row]
    near = local_line(12)
    for step in POLE_STEPS:
        un = u + (0.5 * (s.u0 + s.u1) - u) * step
        vn = v + (0.5 * (s.v0 + s.v1) - v) * step
        surface_point(g, row, un, vn, scratch, near)
        if normal_of(g, row, near, out):
            return True
        # Leave the pole along v or u alone: the middle may lie straight across it.
        surface_point(g, row, u, vn, scratch, near)
        if normal_of(g, row, near, out):
            return True
        surface_point(g, row, un, v, scratch, near)
        if normal_of(g, row, near, out):
            return True
    return False


@leaf
def surface_normal(g: Tables, row: int, u: float, v: float, scratch: Floats, d: Floats, out: Floats) -> bool:
    """Write the unit normal to the outside; at a pole the limit from inside the domain.

    ``d`` (>= 12) holds S, S_u, S_v at (u, v) on entry and is kept. Where no direction exists even nearby
    the z axis is written. Returns whether the surface has a normal of its own there: False at a pole.
    """
    own = normal_of(g, row, d, out)
    if not own and not _limit_normal(g, row, u, v, scratch, out):
        out[0], out[1], out[2] = 0.0, 0.0, 1.0
        return False
    if g.surfaces[row].reversed:
        for k in range(3):
            out[k] = -out[k]
    return own


@kernel
def _surface_points(g: Tables, row: int, uv: Floats, points: Floats, normals: Floats, partials: Floats) -> None:
    scratch = np.empty((4, MAX_DEGREE + 2))
    d = np.empty(12)
    for i in range(len(uv)):
        surface_point(g, row, uv[i, 0], uv[i, 1], scratch, d)
        surface_normal(g, row, uv[i, 0], uv[i, 1], scratch, d, normals[i])
        for k in range(3):
            points[i, k] = d[k]
            partials[i, 0, k] = d[3 + k]
            partials[i, 1, k] = d[6 + k]


def evaluate(geometry: GeometryBatch, row: int, uv: Floats) -> tuple[Floats, Floats]:
    """Points and outside unit normals of the surface in ``row``.

    Args:
        geometry: the part.
        row: row in ``geometry.surfaces``.
        uv: (n, 2) native parameters (radians for what turns, mm for what is straight, knot units).

    Returns:
        (n, 3) points in mm and (n, 3) unit normals; at poles the limit normal.
    """
    points, normals, _ = evaluate_partials(geometry, row, uv)
    return points, normals


def evaluate_partials(geometry: GeometryBatch, row: int, uv: Floats) -> tuple[Floats, Floats, Floats]:
    """As ``evaluate``, with the partial derivatives (n, 2, 3) as third result."""
    uv = np.ascontiguousarray(uv, dtype=np.float64).reshape(-1, 2)
    points = np.empty((len(uv), 3))
    normals = np.empty((len(uv), 3))
    partials = np.empty((len(uv), 2, 3))
    _surface_points(tables(geometry), row, uv, points, normals, partials)
    return points, normals, partials
