"""Inner points of a face: the grids of its cells, then points where a triangle breaks its bound.

A triangle deviates from the surface by at most its ``triangle_bound``, for which second derivatives
are bounded over its parameter box, plus what creases inside the box add. Triangles are checked one by
one; one that fails has an edge flipped if that helps both sides, or else gets a point on its longest
free edge, or, where its boundary edge is the longest, between that edge and the opposite corner; the
flips that follow measure lengths as the error does at that place. Boundary edges are never split here:
they belong to two faces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import MUU, MUV, MVV
from nurbs_ooc.bounds.pieces import Pieces, creases_in_box
from nurbs_ooc.bounds.triangle_bound import norm_bound, vector_bound
from nurbs_ooc.geometry.predicates import orient
from nurbs_ooc.geometry.surface import EXTRUSION, NURBS, REVOLUTION
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import CHILD, GRID, Cells, cell_bounds
from nurbs_ooc.tessellation.triangulate import (
    ADJACENT,
    CHECKED,
    FIXED,
    INSIDE,
    LAST,
    N_POINTS,
    N_TRIANGLES,
    Triangulation,
    flip,
    locate,
    opposite,
    split,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Grid points closer than this part of their spacing to a point or a boundary edge are left out.
CLEARANCE = 0.45
DONE, FULL, LONG_EDGE = 0, 1, 2
# A boundary edge is cut into so many parts at once at most: its neighbour has not been asked.
MOST_PARTS = 8


class Frame(NamedTuple):
    """Lattice to parameters: u = u0 + x * du."""

    u0: float
    v0: float
    du: float
    dv: float


class Check(NamedTuple):
    """Scratch of the bound of a triangle."""

    work: Floats
    bounds: Floats
    second: Floats
    stack: Ints


@leaf
def _too_close(t: Triangulation, k: int, p: int, hx: float, hy: float) -> bool:
    """Whether point p is too near to a corner or a boundary edge of its triangle, in units of the grid."""
    for i in range(3):
        c = t.tri[k, i]
        dx, dy = (t.points[c, 0] - t.points[p, 0]) / hx, (t.points[c, 1] - t.points[p, 1]) / hy
        if dx * dx + dy * dy < CLEARANCE * CLEARANCE:
            return True
        if t.tri[k, FIXED + i] > 0:
            a, b = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
            ex, ey = (t.points[b, 0] - t.points[a, 0]) / hx, (t.points[b, 1] - t.points[a, 1]) / hy
            wx, wy = (t.points[p, 0] - t.points[a, 0]) / hx, (t.points[p, 1] - t.points[a, 1]) / hy
            cross = ex * wy - ey * wx
            if cross * cross < CLEARANCE * CLEARANCE * (ex * ex + ey * ey):
                return True
    return False


@leaf
def _offer(t: Triangulation, px: int, py: int, hx: float, hy: float) -> int:
    """Insert a grid point if it lies inside and clear of what is there; FULL if there is no room."""
    p = t.n[N_POINTS]
    if p >= len(t.points):
        return FULL
    t.points[p, 0], t.points[p, 1] = px, py
    k, on = locate(t, p)
    if t.tri[k, INSIDE] == 0 or on >= 4 or (on < 3 and t.tri[k, FIXED + on] > 0) or _too_close(t, k, p, hx, hy):
        return DONE
    t.n[N_POINTS] = p + 1
    split(t, k, on, p)
    return DONE


@leaf
def insert_grids(t: Triangulation, c: Cells, f: Frame, stack: Ints) -> int:
    """Offer the grid points of all leaves that do not lie on the root's border, neighbours after each other."""
    root = c.box[0]
    top = 1
    stack[0] = 0
    while top > 0:
        top -= 1
        node = stack[top]
        if c.node[node, CHILD] >= 0:
            # Depth first: leaves follow in the order of their places, so the walk between them is short.
            stack[top] = c.node[node, CHILD] + 1
            stack[top + 1] = c.node[node, CHILD]
            top += 2
            continue
        nu, nv = c.node[node, GRID + 0], c.node[node, GRID + 1]
        u0, u1, v0, v1 = c.box[node, 0], c.box[node, 1], c.box[node, 2], c.box[node, 3]
        hx, hy = (u1 - u0) / nu / f.du, (v1 - v0) / nv / f.dv
        t.scale[0], t.scale[1] = 1.0 / hx, 1.0 / hy
        i_low, i_high = (1 if u0 <= root[0] else 0), (nu - 1 if u1 >= root[1] else nu)
        j_low, j_high = (1 if v0 <= root[2] else 0), (nv - 1 if v1 >= root[3] else nv)
        for i in range(i_low, i_high + 1):
            px = int((u0 + (u1 - u0) * i / nu - f.u0) / f.du + 0.5)
            for m in range(j_low, j_high + 1):
                # To and fro, for the same reason.
                j = m if i % 2 == 0 else j_high + j_low - m
                py = int((v0 + (v1 - v0) * j / nv - f.v0) / f.dv + 0.5)
                if _offer(t, px, py, hx, hy) == FULL:
                    return FULL
    return DONE


@leaf
def _corners_bound(
    g: Tables,
    p: Pieces,
    row: int,
    c: Cells,
    f: Frame,
    check: Check,
    enough: float,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    x2: float,
    y2: float,
) -> float:
    """Deviation bound of a triangle with corners at lattice places, mm; what it rests on stays in ``check.second``.

    The directions of second derivatives are looked at only where their norms do not give ``enough`` (mm).
    """
    m = check.second
    # Half a lattice step wider, for corners were rounded.
    u0, u1 = f.u0 + f.du * (min(x0, x1, x2) - 0.5), f.u0 + f.du * (max(x0, x1, x2) + 0.5)
    v0, v1 = f.v0 + f.dv * (min(y0, y1, y2) - 0.5), f.v0 + f.dv * (max(y0, y1, y2) + 0.5)
    charge = 0.0
    kind = g.surfaces[row].kind
    if kind == NURBS or kind == REVOLUTION or kind == EXTRUSION:
        cell_bounds(c, u0, u1, v0, v1, False, check.stack, m)
        if kind == NURBS:
            charge = creases_in_box(p, row, u0, u1, v0, v1)
    else:
        closed_form_bounds(g, row, u0, u1, v0, v1, check.work, check.bounds)
        m[0], m[1], m[2] = check.bounds[MUU], check.bounds[MUV], check.bounds[MVV]
    du, dv = f.du, f.dv
    bound = charge + norm_bound(m, x0 * du, y0 * dv, x1 * du, y1 * dv, x2 * du, y2 * dv, du, dv)
    if kind == NURBS and bound > enough:
        cell_bounds(c, u0, u1, v0, v1, True, check.stack, m)
        finer = charge + vector_bound(m, x0 * du, y0 * dv, x1 * du, y1 * dv, x2 * du, y2 * dv, du, dv)
        bound = min(bound, finer)
    return bound


@leaf
def _bound_of(
    g: Tables,
    p: Pieces,
    row: int,
    c: Cells,
    f: Frame,
    t: Triangulation,
    i: int,
    j: int,
    k: int,
    check: Check,
    enough: float,
) -> float:
    """Deviation bound of the triangle of points i, j and k, mm, as good as ``enough`` or the best known."""
    a, b, d = t.points[i], t.points[j], t.points[k]
    return _corners_bound(
        g, p, row, c, f, check, enough, float(a[0]), float(a[1]), float(b[0]), float(b[1]), float(d[0]), float(d[1])
    )


@leaf
def _bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, check: Check, enough: float
) -> float:
    """Deviation bound of triangle k, mm, as good as ``enough`` or the best known."""
    return _bound_of(g, p, row, c, f, t, t.tri[k, 0], t.tri[k, 1], t.tri[k, 2], check, enough)


@leaf
def segment_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, a: int, b: int, check: Check, enough: float
) -> float:
    """Bound of the segment between two points alone, mm: no triangle on it has a smaller one."""
    q = t.points
    x0, y0, x1, y1 = float(q[a, 0]), float(q[a, 1]), float(q[b, 0]), float(q[b, 1])
    return _corners_bound(g, p, row, c, f, check, enough, x0, y0, x1, y1, 0.5 * (x0 + x1), 0.5 * (y0 + y1))


@leaf
def _edge_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, i: int, check: Check
) -> float:
    """Bound of a flat triangle on edge i of k that reaches 1/16 of the way to the opposite corner, mm."""
    q = t.points
    a, b, d = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3], t.tri[k, i]
    x0, y0, x1, y1 = float(q[a, 0]), float(q[a, 1]), float(q[b, 0]), float(q[b, 1])
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    x, y = x + (q[d, 0] - x) / 16.0, y + (q[d, 1] - y) / 16.0
    return _corners_bound(g, p, row, c, f, check, 0.0, x0, y0, x1, y1, x, y)


@leaf
def _length(t: Triangulation, f: Frame, m: Floats, a: int, b: int) -> float:
    """The bound of the edge a-b alone, under the second derivatives ``m``."""
    x, y = abs(t.points[a, 0] - t.points[b, 0]) * f.du, abs(t.points[a, 1] - t.points[b, 1]) * f.dv
    return (x * x * m[0] + 2.0 * x * y * m[1] + y * y * m[2]) / 8.0


@leaf
def _flip_to_fit(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, target: float, check: Check
) -> bool:
    """Flip a free edge of triangle k if both triangles then keep the target; whether there is such an edge."""
    for i in range(3):
        o = t.tri[k, ADJACENT + i]
        if t.tri[k, FIXED + i] > 0 or o < 0 or t.tri[o, INSIDE] == 0:
            continue
        tip, a, b = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        far = opposite(t, o, k)
        if orient(t.points, tip, a, far) <= 0 or orient(t.points, tip, far, b) <= 0:
            continue
        if (
            _bound_of(g, p, row, c, f, t, tip, a, far, check, target) <= target
            and _bound_of(g, p, row, c, f, t, tip, far, b, check, target) <= target
        ):
            flip(t, k, i)
            return True
    return False


@leaf
def _local_metric(t: Triangulation, c: Cells, f: Frame, m: Floats, target: float) -> None:
    """Let the in-circle test see lengths as the error does here, flat directions as long as the face."""
    root = c.box[0]
    t.scale[0] = f.du * max(math.sqrt(m[0] / (8.0 * target)), 1.0 / (root[1] - root[0]))
    t.scale[1] = f.dv * max(math.sqrt(m[2] / (8.0 * target)), 1.0 / (root[3] - root[2]))


@leaf
def _longest_edges(t: Triangulation, f: Frame, k: int, m: Floats) -> tuple[int, float, int, float]:
    """The longest free and the longest boundary edge of triangle k, each with its length as the error sees it."""
    longest_free = -1.0
    longest_fixed = -1.0
    free = -1
    fixed = -1
    for i in range(3):
        q = _length(t, f, m, t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3])
        if t.tri[k, FIXED + i] > 0:
            if q > longest_fixed:
                longest_fixed, fixed = q, i
        elif q > longest_free:
            longest_free, free = q, i
    return free, longest_free, fixed, longest_fixed


@leaf
def _break_up(t: Triangulation, k: int, free: int, fixed: int) -> int:
    """Insert a point on edge ``free`` of triangle k, or, if that is -1, between ``fixed`` and the corner opposite."""
    p = t.n[N_POINTS]
    if p >= len(t.points):
        return FULL
    q = t.points
    if free >= 0:
        a, b = t.tri[k, (free + 1) % 3], t.tri[k, (free + 2) % 3]
        q[p, 0], q[p, 1] = (q[a, 0] + q[b, 0]) // 2, (q[a, 1] + q[b, 1]) // 2
    else:
        a, b, c = t.tri[k, (fixed + 1) % 3], t.tri[k, (fixed + 2) % 3], t.tri[k, fixed]
        q[p, 0] = (q[a, 0] + q[b, 0]) // 4 + q[c, 0] // 2
        q[p, 1] = (q[a, 1] + q[b, 1]) // 4 + q[c, 1] // 2
    t.n[LAST] = k
    where, on = locate(t, p)
    if t.tri[where, INSIDE] == 0 or on >= 4 or (on < 3 and t.tri[where, FIXED + on] > 0):
        # The lattice is exhausted here; the triangle stays with the bound it has.
        return DONE
    t.n[N_POINTS] = p + 1
    split(t, where, on, p)
    return DONE


@leaf
def parts_needed(excess: float) -> int:
    """Into how many parts a segment whose bound is ``excess`` (> 1) times the target must be cut."""
    return min(max(2, math.ceil(math.sqrt(min(excess, 1e6)))), MOST_PARTS)


@leaf
def _blame(t: Triangulation, k: int, i: int, excess: float, blame: Ints) -> None:
    """Note a boundary edge, i of k, whose bound is ``excess`` times the target: its ends, the parts it needs.

    ``blame[0]`` counts them.
    """
    at = 3 * blame[0] + 1
    if at + 2 < len(blame):
        blame[at], blame[at + 1] = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        blame[at + 2] = parts_needed(excess)
        blame[0] += 1


@leaf
def certify(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, target: float, check: Check, blame: Ints
) -> tuple[int, float]:
    """Refine until every inner triangle's bound is within ``target`` (mm).

    Returns a code (DONE; FULL: the arrays are too small; LONG_EDGE: boundary edges are too long for
    this surface; ``blame`` gives their number, then of each its two points and how many parts it needs)
    and the largest bound of any triangle.
    """
    worst = 0.0
    again = True
    code = DONE
    while again:
        again = False
        k = 0
        while k < t.n[N_TRIANGLES]:
            if t.tri[k, INSIDE] == 0 or t.tri[k, CHECKED] != 0:
                k += 1
                continue
            t.tri[k, CHECKED] = 1
            bound = _bound(g, p, row, c, f, t, k, check, target)
            if bound > target:
                before = t.n[N_POINTS]
                _local_metric(t, c, f, check.second, target)
                free, q_free, fixed, q_fixed = _longest_edges(t, f, k, check.second)
                alone = _edge_bound(g, p, row, c, f, t, k, fixed, check) if q_fixed > target else 0.0
                if alone > target:
                    _blame(t, k, fixed, alone / target, blame)
                    code = LONG_EDGE
                elif _flip_to_fit(g, p, row, c, f, t, k, target, check):
                    again, bound = True, 0.0
                elif _break_up(t, k, free if q_free >= q_fixed else -1, fixed) == FULL:
                    return FULL, worst
                if t.n[N_POINTS] > before:
                    again, bound = True, 0.0
            # Of a triangle that stays; one that goes later counts too, and had a bound within the target.
            worst = max(worst, bound)
            k += 1
    return code, worst


@leaf
def worst_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, target: float, check: Check
) -> float:
    """The largest deviation bound of any inner triangle, mm."""
    worst = 0.0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] != 0:
            worst = max(worst, _bound(g, p, row, c, f, t, k, check, target))
    return worst
