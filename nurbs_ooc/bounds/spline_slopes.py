"""Boxes of the normal's slopes of a B-spline surface over a box inside one of its knot spans.

Where a side of the surface is one point (a pole), the net of R in S = c + r R is found from that of the whole
span: control points of r R that do not vanish are those of R times j / q, or (q - j) / q from the other end.

Source: G. Farin, "Curves and Surfaces for CAGD", 5th ed. 2002, section 6.1 (degree elevation, of which this is the
reverse).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.derivative_boxes import COMPONENT, component_boxes, divide_by_weight, rescale, restrict
from nurbs_ooc.bounds.derivatives import LIFTED_SIZE, affine_map, less_affine
from nurbs_ooc.bounds.intervals import largest, over
from nurbs_ooc.bounds.slope_field import NO_POLE, POLE_U, POLE_V, normal_boxes, slope_boxes
from nurbs_ooc.geometry.bezier_net import NET, bezier_net
from nurbs_ooc.geometry.surface import VANISHING
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]

# Bits of the sides that are poles.
AT_U0, AT_U1, AT_V0, AT_V1 = 1, 2, 4, 8
ROUNDOFF = 2.0**-52
# A domain that ends this close to the knots' end, relative to their range, ends there.
SAME_KNOT = 1e-12


@leaf
def pole_sides(g: Tables, row: int) -> int:
    """Bits of the sides of a B-spline surface, as far as it is used, that are one point up to roundoff."""
    s = g.surfaces[row]
    ends = local_line(4)
    ends[0], ends[1] = g.values[s.knots_u + s.degree_u], g.values[s.knots_u + s.n_u]
    ends[2], ends[3] = g.values[s.knots_v + s.degree_v], g.values[s.knots_v + s.n_v]
    dim = 4 if s.rational else 3
    bits = 0
    for side in range(4):
        along_u = side >= 2  # the side runs along u
        n = s.n_u if along_u else s.n_v
        fixed = 0 if side % 2 == 0 else (s.n_v if along_u else s.n_u) - 1
        used = (s.u0 if side == 0 else s.u1) if side < 2 else (s.v0 if side == 2 else s.v1)
        low, high = (ends[0], ends[1]) if side < 2 else (ends[2], ends[3])
        one = abs(used - ends[side]) <= SAME_KNOT * (high - low)
        for m in range(1, n):
            here = s.points + ((m * s.n_v + fixed) if along_u else (fixed * s.n_v + m)) * dim
            first = s.points + (fixed if along_u else fixed * s.n_v) * dim
            w, w0 = 1.0, 1.0
            if dim == 4:
                w, w0 = g.values[here + 3], g.values[first + 3]
            off = 0.0
            size = 0.0
            for k in range(3):
                x, y = g.values[here + k] / w, g.values[first + k] / w0
                off += (x - y) ** 2
                size += x * x
            if off > VANISHING * VANISHING * size:
                one = False
                break
        if one:
            bits |= 1 << side
    return bits


@leaf
def _component(net: Floats, n: int, dim: int, frame: Floats, center: Floats, c: int, out: Floats) -> None:
    """Numbers of w (S - center) along axis ``c`` of the frame, or, c = 3, of w."""
    for m in range(n):
        w = net[m * dim + 3] if dim == 4 else 1.0
        x = w
        if c < 3:
            x = 0.0
            for k in range(3):
                x += frame[3 * c + k] * (net[m * dim + k] - center[k] * w)
        out[m] = x


@leaf
def _divide_out(net: Floats, p: int, q: int, pole: int, at_end: bool) -> None:
    """From a component of w (S - c), p x q, to that of w R, of one degree less towards the pole; in place."""
    lines, degree = (q + 1, p) if pole == POLE_U else (p + 1, q)
    if pole == POLE_U:
        for i in range(degree):
            take, factor = (i, degree / (degree - i)) if at_end else (i + 1, degree / (i + 1.0))
            for m in range(lines):
                net[i * (q + 1) + m] = factor * net[take * (q + 1) + m]
        return
    for m in range(lines):
        for i in range(degree):
            take, factor = (i, degree / (degree - i)) if at_end else (i + 1, degree / (i + 1.0))
            net[m * degree + i] = factor * net[m * (q + 1) + take]


@leaf
def _cut_out(net: Floats, p: int, q: int, part: Floats) -> None:
    """Restrict a component of a span's net to ``part`` (u0, u1, v0, v1) of it, each in [0, 1]."""
    for m in range(q + 1):
        restrict(net, m, q + 1, p, part[0], part[1])
    for m in range(p + 1):
        restrict(net, m * (q + 1), 1, q, part[2], part[3])


@leaf
def _choose_pole(sides: int, part: Floats) -> int:
    """The bit of the side, of those that are poles, that is nearest to a part of the span; 0 if there is none."""
    best = 0
    nearest = math.inf
    for side in range(4):
        if sides & (1 << side):
            distance = 1.0 - part[side] if side % 2 == 1 else part[side]
            if distance < nearest:
                best, nearest = 1 << side, distance
    return best


@leaf
def _noise(
    net: Floats, p: int, q: int, dim: int, x: Floats, y: Floats, n: Floats, scale_u: float, scale_v: float, out: Floats
) -> None:
    """What roundoff of control points may do to slopes by way of third differences along u and v, to ``out`` (2,)."""
    size = 0.0
    for m in range((p + 1) * (q + 1)):
        w = net[m * dim + 3] if dim == 4 else 1.0
        for k in range(3):
            size = max(size, abs(net[m * dim + k] / w))
    eta = 0.5 * (p + q + 4) * ROUNDOFF * size
    out[0] = eta * (p * scale_u) ** 3 * largest(y, 0, 3) / n[0, 4]
    out[1] = eta * (q * scale_v) ** 3 * largest(x, 0, 3) / n[0, 4]


@leaf
def _derivatives(net: Floats, p: int, q: int, dim: int, side: int, frame: Floats, center: Floats, r: Floats) -> bool:
    """Boxes of the derivatives of S - center over a net's patch to ``r``; False if a weight may be 0.

    Of a rational patch an affine map is taken off first, see ``derivatives``: row 0 is without it.
    """
    one = local_line(COMPONENT)
    if dim == 3:
        for c in range(3):
            _component(net, (p + 1) * (q + 1), dim, frame, center, c, one)
            component_boxes(one, p, q, side, r, 2 * c)
        return True
    lifted = local_line(LIFTED_SIZE)
    affine = local_table(3, 3)
    nowhere = local_line(3)
    affine_map(net, p, q, affine)
    less_affine(net, p, q, affine, lifted)
    for k in range(3):
        nowhere[k] = 0.0
    for c in range(4):
        _component(lifted, (p + 2) * (q + 2), dim, frame, nowhere, c, one)
        component_boxes(one, p + 1, q + 1, side, r, 2 * c)
    if not _divide(r):
        return False
    for c in range(3):
        for k in range(1, 3):
            slope = 0.0
            for e in range(3):
                slope += frame[3 * c + e] * affine[k, e]
            r[k, 2 * c] += slope
            r[k, 2 * c + 1] += slope
    return True


@leaf
def _divide(r: Floats) -> bool:
    """Derivatives of A / w from those of A and w, row 0 included."""
    if not r[0, 6] > 0.0:
        return False
    for c in range(0, 6, 2):
        r[0, c], r[0, c + 1] = over(r[0, c], r[0, c + 1], r[0, 6], r[0, 7])
    return divide_by_weight(r)


@leaf
def _pole_derivatives(
    net: Floats, p: int, q: int, dim: int, side: int, frame: Floats, pole: int, at_end: bool, part: Floats, r: Floats
) -> bool:
    """The same of R in S = c + r R over ``part`` of the span that ``net`` belongs to."""
    one = local_line(COMPONENT)
    origin = local_line(3)
    at = 0 if not at_end else (p * (q + 1) if pole == POLE_U else q) * dim
    for k in range(3):
        origin[k] = net[at + k] / (net[at + 3] if dim == 4 else 1.0)
    for c in range(dim):
        _component(net, (p + 1) * (q + 1), dim, frame, origin, c, one)
        low_p, low_q = p, q
        if c < 3:
            _divide_out(one, p, q, pole, at_end)
            low_p, low_q = (p - 1, q) if pole == POLE_U else (p, q - 1)
        _cut_out(one, low_p, low_q, part)
        component_boxes(one, low_p, low_q, side, r, 2 * c)
    return dim == 3 or _divide(r)


@leaf
def spline_slopes(
    g: Tables, row: int, box: Floats, span: Floats, sides: int, rows: int, frame: Floats, center: Floats,
    a: float, b: float, out: Floats, noise: Floats,
) -> bool:  # fmt: skip
    """Boxes of the slopes and their derivatives to ``out`` (SECONDS, 4), for parameters that run over a and b.

    Args:
        g: the tables.
        row: of the surface.
        box: u0, u1, v0, v1, not empty, inside ``span``.
        span: the knot span that holds it.
        sides: bits of the span's sides that are poles.
        rows: which control points count, see ``component_boxes``.
        frame: three axes, the third near the normals.
        center: a point near by.
        a, b: what counts as 1 in derivatives along u and v.
        out: see ``slope_boxes``.
        noise: (2,) gets what roundoff may add to a slope, along u and along v.

    Returns:
        False if there are no slopes in this frame.
    """
    s = g.surfaces[row]
    p, q = int(s.degree_u), int(s.degree_v)
    net = local_line(NET)
    r = local_table(10, 8)
    part = local_line(4)
    wide, high = span[1] - span[0], span[3] - span[2]
    part[0], part[1] = (box[0] - span[0]) / wide, (box[1] - span[0]) / wide
    part[2], part[3] = (box[2] - span[2]) / high, (box[3] - span[2]) / high
    bit = _choose_pole(sides, part)
    pole = NO_POLE if bit == 0 else (POLE_U if bit <= AT_U1 else POLE_V)
    at_end = bit == AT_U1 or bit == AT_V1
    if bit == 0:
        dim = bezier_net(g, row, box[0], box[1], box[2], box[3], net)
        if not _derivatives(net, p, q, dim, rows, frame, center, r):
            return False
    else:
        dim = bezier_net(g, row, span[0], span[1], span[2], span[3], net)
        if not _pole_derivatives(net, p, q, dim, rows, frame, pole, at_end, part, r):
            return False
    rescale(a / (box[1] - box[0]), b / (box[3] - box[2]), r, 6)
    rho0, rho1, slope = 1.0, 1.0, 0.0
    if pole == POLE_U:
        rho0, rho1, slope = (1.0 - part[1], 1.0 - part[0], -a / wide) if at_end else (part[0], part[1], a / wide)
    elif pole == POLE_V:
        rho0, rho1, slope = (1.0 - part[3], 1.0 - part[2], -b / high) if at_end else (part[2], part[3], b / high)
    x = local_table(6, 6)
    y = local_table(6, 6)
    n = local_table(6, 6)
    normal_boxes(r, pole, max(rho0, 0.0), rho1, slope, x, y, n)
    if not slope_boxes(n, out):
        return False
    _noise(net, p, q, dim, x, y, n, a / (box[1] - box[0]), b / (box[3] - box[2]), noise)
    return True
