"""What a face promises beside its distance from the surface, if that is asked for: normals, appearance, attributes.

Each criterion gives every triangle a ratio of its bound and what is allowed; a triangle is kept if none exceeds 1.

- **normals**: the angle of ``normal_bound`` within ``normal`` radians.
- **appearance**: eps^2 = eps_g^2 + eps_s^2 within the chord error, where eps_g is the triangle's distance bound and
  eps_s its shading error carried into space, see ``shading_length``: how far one must go on the surface for the normal
  to change by as much as it is off. Angles that nobody sees do not count.
- **attribute**: the same with any other function on the surface, a B-spline over the same domain.

Source: A. Balázs, M. Guthe, R. Klein, "Appearance preserving tessellation" of trimmed NURBS (the combined error).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.attribute_bound import attribute_bound
from nurbs_ooc.bounds.creases import JUMP, REACH, VALUE
from nurbs_ooc.bounds.normal_bound import NOISE, SIZE, normal_bound
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, CREASED, N_U, N_V, Pieces
from nurbs_ooc.bounds.spline_slopes import pole_sides
from nurbs_ooc.geometry.surface import NURBS, surface_normal, surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.corner_normals import crease_normal, on_crease, pole_normal
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.fallback import box_diagonal
from nurbs_ooc.tessellation.shading_length import as_length, edge_rate, inner_rate, triangle_reach
from nurbs_ooc.tessellation.triangulate import Triangulation
from nurbs_ooc.tessellation.trimming import Boundary

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.uint8]

# Columns of ``Corners.at``: parameters, place as drawn, normal in the sense of S_u x S_v, attribute, place on the
# surface itself.
UV, PLACE, NORMAL, VALUES, FOOT = 0, 2, 5, 8, 11
WIDTH = 14
BASIS = MAX_DEGREE + 2  # room for the basis functions of a point
UNKNOWN, ONE, CREASE, POLE = 0, 1, 2, 3
# Numbers of ``Aim.found``.
ANGLE, APPEARANCE = 0, 1
# Of the values that nobody sees: a B-spline that is off by no more stands for its function well enough.
RESOLVED = 0.125
# Nothing is divided by less, in radians and in an attribute's unit.
LEAST = 1e-300
# Of the face's size: where a pole has no limit of the normal, triangles at it come to an end.
POLE_SHARE = 2.0**-8


class Aim(NamedTuple):
    """What a tessellation is asked to keep; lengths in mm."""

    normal: float  # radians, infinite: no bound of the normal
    appearance: float  # 1: combined error within the chord error, 0: distance alone
    shaded: float  # 1: normals count in the appearance
    unseen: float  # radians, normals this close to the true one look like it
    attribute: Tables  # row i: the attribute of surface i as a B-spline surface; none: any tables
    n_attributes: int  # rows of it that count: all surfaces, or 0
    unseen_value: float  # the same of the attribute, in its unit
    missed: Floats  # in its unit, span by span, what B-splines are off from the functions they stand for
    missed_from: Ints  # (n_attributes,) where those of a surface begin, -1: it is no function's


class Corners(NamedTuple):
    """Points of a face's triangulation as they are drawn, each evaluated when it is first looked at."""

    at: Floats  # (n, WIDTH)
    kind: Flags  # (n,)
    found: Floats  # (2,) largest angle (radians) and combined error (mm) of a triangle that stays
    owner: Ints  # (n,) boundary point of a lattice point, -1 for inner ones
    scratch: Floats  # (4, MAX_DEGREE + 2)
    sides: int  # poles, see ``pole_sides``
    creased: bool
    smallest: float  # mm, triangles at poles that have no bound are not made smaller


class Facet(NamedTuple):
    """One triangle's corners, and what was found out about it."""

    uv: Floats  # (3, 2) where the normals belong
    place: Floats  # (3, 3)
    normal: Floats  # (3, 3)
    values: Floats  # (3, 3)
    foot: Floats  # (3, 3)
    step: Floats  # (3, 2) how far from there the normals were taken
    second: Floats  # (SIZE,) what the bound that was exceeded most rests on, in units of what is allowed
    crease: Floats  # (2,) 0 or 1 and the value of u or v, of a crease that is crossed; else -1


@helper
def new_facet() -> Facet:
    """Room for one."""
    return Facet(
        np.empty((3, 2)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)),
        np.empty((3, 2)), np.empty(SIZE), np.empty(2),
    )  # fmt: skip


@helper
def new_corners(
    g: Tables, p: Pieces, row: int, n: int, b: Boundary, owner: Ints, found: Floats, scratch: Floats
) -> Corners:
    """Room for ``n`` points of surface ``row``, none of them known."""
    sides = pole_sides(g, row) if g.surfaces[row].kind == NURBS else 0
    return Corners(
        np.empty((n, WIDTH)), np.zeros(n, dtype=np.uint8), found, owner, scratch, sides,
        p.table[row, CREASED] != 0, POLE_SHARE * box_diagonal(b.position),
    )  # fmt: skip


@leaf
def _look(
    g: Tables, p: Pieces, aim: Aim, row: int, f: Frame, t: Triangulation, b: Boundary, d: Corners, i: int
) -> None:
    """Evaluate point ``i`` unless that is done, as it will be drawn."""
    if d.kind[i] != UNKNOWN:
        return
    place = local_line(12)
    normal = local_line(3)
    k = d.owner[i]
    u, v = f.u0 + t.points[i, 0] * f.du, f.v0 + t.points[i, 1] * f.dv
    if k >= 0:
        u, v = b.uv[k, 0], b.uv[k, 1]
    surface_point(g, row, u, v, d.scratch, place)
    own = surface_normal(g, row, u, v, d.scratch, place, normal)
    d.kind[i] = ONE
    if not own:
        d.kind[i] = POLE
    elif d.creased and on_crease(p, row, f, u, v):
        d.kind[i] = CREASE
    sign = -1.0 if g.surfaces[row].reversed else 1.0
    at = d.at[i]
    at[UV], at[UV + 1] = u, v
    for m in range(3):
        at[PLACE + m] = b.position[k, m] if k >= 0 else place[m]
        at[NORMAL + m] = sign * normal[m]
        at[FOOT + m] = place[m]
    if aim.n_attributes > 0:
        surface_point(aim.attribute, row, u, v, d.scratch, place)
        for m in range(3):
            at[VALUES + m] = place[m]


@leaf
def _turn_corner(g: Tables, p: Pieces, row: int, f: Frame, d: Corners, c: Ints, i: int, o: Facet) -> None:
    """Give corner ``i`` of a triangle, at a crease or a pole, the normal that it will be drawn with."""
    uv, middle, normal = local_line(2), local_line(2), local_line(3)
    j, k = c[(i + 1) % 3], c[(i + 2) % 3]
    for m in range(2):
        uv[m] = d.at[c[i], UV + m]
        middle[m] = 0.5 * (d.at[j, UV + m] + d.at[k, UV + m])
    if d.kind[c[i]] == POLE:
        share = pole_normal(g, row, uv, middle, d.scratch, normal)
        for m in range(2):
            o.step[i, m] = share * abs(middle[m] - uv[m]) if share < 1.0 else math.inf
    else:
        crease_normal(g, p, row, f, uv, middle, d.scratch, normal)
    sign = -1.0 if g.surfaces[row].reversed else 1.0
    for m in range(2):
        o.uv[i, m] = uv[m]
    for m in range(3):
        o.normal[i, m] = sign * normal[m]


@leaf
def _crossed(p: Pieces, row: int, o: Facet) -> bool:
    """Whether a crease runs through a triangle; which one goes to ``o.crease``."""
    o.crease[0] = -1.0
    for direction in range(2):
        n = p.table[row, N_U] if direction == 0 else p.table[row, N_V]
        at = p.table[row, BREAK_U] if direction == 0 else p.table[row, BREAK_V]
        low = min(o.uv[0, direction], o.uv[1, direction], o.uv[2, direction])
        high = max(o.uv[0, direction], o.uv[1, direction], o.uv[2, direction])
        for k in range(1, n):
            value = p.breaks[at + k, VALUE]
            if p.breaks[at + k, JUMP] > 0.0 and low < value and value + p.breaks[at + k, REACH] < high:
                o.crease[0], o.crease[1] = float(direction), value
                return True
    return False


@leaf
def fill_facet(
    g: Tables, p: Pieces, aim: Aim, row: int, f: Frame, t: Triangulation, b: Boundary, d: Corners, c: Ints, o: Facet
) -> bool:
    """Corners of the triangle of points ``c`` (3,) to ``o``; False if two are one place, so that it is not drawn."""
    for i in range(3):
        _look(g, p, aim, row, f, t, b, d, c[i])
        at = d.at[c[i]]
        for m in range(2):
            o.uv[i, m], o.step[i, m] = at[UV + m], 0.0
        for m in range(3):
            o.place[i, m], o.normal[i, m], o.values[i, m] = at[PLACE + m], at[NORMAL + m], at[VALUES + m]
            o.foot[i, m] = at[FOOT + m]
    for i in range(3):
        if d.kind[c[i]] != ONE:
            _turn_corner(g, p, row, f, d, c, i, o)
    for i in range(3):
        j = (i + 1) % 3
        if o.place[i, 0] == o.place[j, 0] and o.place[i, 1] == o.place[j, 1] and o.place[i, 2] == o.place[j, 2]:
            return False
    return True


@leaf
def _scale(m: Floats, factor: float, out: Floats) -> None:
    for k in range(3):
        out[k] = m[k] * factor


@leaf
def facet_ratio(
    g: Tables, p: Pieces, aim: Aim, row: int, d: Corners, o: Facet, distance: float, error: float, keep: bool
) -> float:
    """By how much a triangle exceeds what is allowed; at most 1 if it keeps all, infinite if there is no bound.

    Args:
        g, p, aim, row, d: the face.
        o: the triangle; ``second`` gets the second derivatives behind the worst criterion, over what is allowed,
            NOISE the share that roundoff alone takes.
        distance: mm, bound of the triangle's distance from the surface.
        error: mm, the chord error that is asked for.
        keep: count what is found into the face's.
    """
    m = local_line(SIZE)
    o.second[NOISE] = 0.0
    reach = triangle_reach(g, row, o.uv, o.foot, distance) if aim.appearance > 0.0 else 0.0
    if d.creased and _crossed(p, row, o):
        if keep:
            d.found[ANGLE] = math.pi
            d.found[APPEARANCE] = max(d.found[APPEARANCE], error, math.hypot(distance, 2.0 * reach))
        return math.inf
    worst = 0.0
    angle = 0.0
    if aim.normal < math.inf or aim.shaded > 0.0:
        angle = normal_bound(g, p, row, d.sides, o.uv, o.normal, o.step, m)
        if aim.normal < math.inf:
            worst = angle / aim.normal
            _scale(m, 1.0 / aim.normal, o.second)
            o.second[NOISE] = m[NOISE] / aim.normal
    whole = distance * distance
    part = 0.0
    if aim.shaded > 0.0:
        rate = edge_rate(o.foot, o.normal)
        part = as_length(angle, aim.unseen, rate, 2.0 * reach)
        whole += part * part
        ratio = math.sqrt(whole) / error
        if ratio > worst:
            worst = ratio
            _scale(m, 1.0 / max(rate * error, aim.unseen, LEAST), o.second)
            o.second[NOISE] = m[NOISE] / max(aim.unseen, 0.5 * rate * error, LEAST)
    known = whole
    if aim.n_attributes > 0:
        bound, missed = attribute_bound(aim.attribute, row, aim.missed, aim.missed_from[row], o.uv, m)
        rate = max(edge_rate(o.foot, o.values), inner_rate(g, aim.attribute, row, o.uv, d.scratch))
        known += as_length(bound + missed, aim.unseen_value, rate, reach) ** 2
        # More triangles do not help against what the B-spline itself is off by.
        length = as_length(bound + min(missed, RESOLVED * aim.unseen_value), aim.unseen_value, rate, reach)
        whole += length * length
        ratio = math.sqrt(whole) / error
        if ratio > worst:
            worst = ratio
            if length >= part:
                _scale(m, 1.0 / max(rate * error, aim.unseen_value, LEAST), o.second)
                o.second[NOISE] = 0.0
    if keep:
        d.found[ANGLE] = max(d.found[ANGLE], min(angle, math.pi))
        d.found[APPEARANCE] = max(d.found[APPEARANCE], math.sqrt(known))
    return worst


@leaf
def edge_ratio(
    g: Tables, p: Pieces, aim: Aim, row: int, d: Corners, o: Facet, i: int, distance: float, error: float, side: Facet
) -> float:
    """``facet_ratio`` of the flat triangle that is edge i of ``o`` alone, its distance given; ``side`` is scratch."""
    for k in range(3):
        c = (i + 1) % 3 if k == 0 else (i + 2) % 3
        for m in range(2):
            side.uv[k, m], side.step[k, m] = o.uv[c, m], o.step[c, m]
        for m in range(3):
            side.place[k, m], side.normal[k, m], side.values[k, m] = o.place[c, m], o.normal[c, m], o.values[c, m]
            side.foot[k, m] = o.foot[c, m]
    side.crease[0] = -1.0
    return facet_ratio(g, p, aim, row, d, side, distance, error, False)


@leaf
def ends_at_pole(d: Corners, c: Ints, o: Facet) -> bool:
    """Whether a triangle of points ``c`` (3,) lies at a pole and is as small as any there."""
    pole = False
    longest = 0.0
    for i in range(3):
        pole = pole or d.kind[c[i]] == POLE
        j = (i + 1) % 3
        way = 0.0
        for m in range(3):
            way += (o.place[i, m] - o.place[j, m]) ** 2
        longest = max(longest, way)
    return pole and longest <= d.smallest * d.smallest
