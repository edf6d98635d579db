"""How far the triangles of a face are from its surface: ``triangle_bound`` at work on a triangulation.

Second derivatives are bounded over the triangle's parameter box: by the kd-tree's cells it meets, or in
closed form. Creases inside the box add to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import MUU, MUV, MVV
from nurbs_ooc.bounds.piece_boxes import creases_in_box, pieces_met, second_of_pieces
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces
from nurbs_ooc.bounds.sampled_bound import largest_deviation
from nurbs_ooc.bounds.triangle_bound import MEASURES, corner_hair, norm_bound, rounding_slack, vector_bound
from nurbs_ooc.geometry.surface import EXTRUSION, NURBS, REVOLUTION
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cell_search import cell_around, cell_bounds
from nurbs_ooc.tessellation.cells import CHILD, EXTENT, SECOND, SEVERAL, Cells
from nurbs_ooc.tessellation.triangulate import INSIDE, N_TRIANGLES, Triangulation

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


# Where roundoff of the corners may take more than this share of the error, cells beyond them are looked at instead.
HAIR_SHARE = 1e-4
# Sides are cut in so many parts where a triangle fails, and where a face's bound is looked at once more.
HALVES, QUARTERS = 2, 4
# Points of halves hardly ever save a triangle whose bound is so many times what it must keep.
FAR = 2.0
# Of a leaf that covers several pieces those are looked at that the triangle meets, up to so many.
MOST_PIECES = 16


class Frame(NamedTuple):
    """Lattice to parameters: u = u0 + x * du."""

    u0: float
    v0: float
    du: float
    dv: float


class Check(NamedTuple):
    """Scratch of the bound of a triangle."""

    second: Floats  # (MEASURES,) what the last bound rests on, see ``cell_bounds``: its norms always, boxes perhaps
    stack: Ints  # (256,) of a walk in the kd-tree
    near: Ints  # (1,) the cell where the last walk began
    off: Floats  # (1,) mm, ``evaluation_error`` of the surface
    widest: Ints  # (1,) the triangle that had the largest bound when it was looked at


@leaf
def seen_length(m: Floats, x: float, y: float) -> float:
    """Squared length of a side (x, y) as the error under second derivatives ``m`` sees it: 8 times its own bound."""
    return x * x * m[0] + 2.0 * abs(x * y) * m[1] + y * y * m[2]


@leaf
def _measure_met(p: Pieces, row: int, u0: float, u1: float, v0: float, v1: float, out: Floats) -> bool:
    """Second-derivative bounds of just the pieces that a box meets to ``out`` (MEASURES,), unless they are many."""
    i0, i1 = pieces_met(p, p.table[row, BREAK_U], p.table[row, N_U], u0, u1)
    j0, j1 = pieces_met(p, p.table[row, BREAK_V], p.table[row, N_V], v0, v1)
    if (i1 - i0) * (j1 - j0) > MOST_PIECES:
        return False
    second_of_pieces(p, row, i0, i1, j0, j1, out)
    return True


@leaf
def _sampled_bound(
    g: Tables, row: int, f: Frame, check: Check, x0: float, y0: float, x1: float, y1: float, x2: float, y2: float,
    bound: float, charge: float, n: int, enough: float,
) -> float:  # fmt: skip
    """The bound of a triangle from its deviation at points (see ``sampled_bound``); infinite if that is not ``enough``.

    ``bound`` is the one without, with the ``charge`` for creases and rounded corners in it: no small triangle has more.
    """
    m = check.second
    du, dv = f.du, f.dv
    # The side that the error sees as the longest first.
    p = seen_length(m, (x1 - x0) * du, (y1 - y0) * dv)
    q = seen_length(m, (x2 - x0) * du, (y2 - y0) * dv)
    r = seen_length(m, (x2 - x1) * du, (y2 - y1) * dv)
    if p > q and p > r:
        x0, y0, x2, y2 = x2, y2, x0, y0
    elif q > r:
        x0, y0, x1, y1 = x1, y1, x0, y0
    a, b = (max(x0, x1, x2) - min(x0, x1, x2)) * du, (max(y0, y1, y2) - min(y0, y1, y2)) * dv
    rest = (bound - charge) / (n * n) + charge + rounding_slack(m, a, b, du, dv) + check.off[0]
    if rest > enough:
        return math.inf
    u0, v0, u1, v1 = f.u0 + du * x0, f.v0 + dv * y0, f.u0 + du * x1, f.v0 + dv * y1
    return rest + largest_deviation(g, row, u0, v0, u1, v1, f.u0 + du * x2, f.v0 + dv * y2, n, enough - rest)


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
    parts: int = HALVES,
) -> float:
    """Deviation bound of a triangle with corners at lattice places, mm; what it rests on stays in ``check.second``.

    The directions of second derivatives are looked at only where their norms do not give ``enough`` (mm), and then
    points of its sides cut in ``parts``.
    """
    m = check.second
    # Half a lattice step wider, for corners were rounded.
    u0, u1 = f.u0 + f.du * (min(x0, x1, x2) - 0.5), f.u0 + f.du * (max(x0, x1, x2) + 0.5)
    v0, v1 = f.v0 + f.dv * (min(y0, y1, y2) - 0.5), f.v0 + f.dv * (max(y0, y1, y2) + 0.5)
    # Cells are met half a step inside, or those of a grid would all meet their neighbours: what lies beyond is a
    # matter of ``hair``.
    hair_u, hair_v = min(f.du, 0.5 * (u1 - u0)), min(f.dv, 0.5 * (v1 - v0))
    hair = corner_hair(c.box[0, SECOND:], f.du, f.dv)
    if hair > HAIR_SHARE * enough:
        hair, hair_u, hair_v = 0.0, 0.0, 0.0
    charge = 0.0
    kind = g.surfaces[row].kind
    du, dv = f.du, f.dv
    whole = False
    node = 0
    if kind == NURBS or kind == REVOLUTION or kind == EXTRUSION:
        charge = hair + creases_in_box(p, row, u0, u1, v0, v1)
        u0, u1, v0, v1 = u0 + hair_u, u1 - hair_u, v0 + hair_v, v1 - hair_v
        node = cell_around(c, u0, u1, v0, v1, check.near)
        whole = c.node[node, CHILD] < 0
        if whole:
            m = c.box[node, SECOND:]
            check.second[0], check.second[1], check.second[2] = m[0], m[1], m[2]
        else:
            cell_bounds(c, node, u0, u1, v0, v1, False, check.stack, m)
    else:
        bounds = local_line(5)
        closed_form_bounds(g, row, u0, u1, v0, v1, bounds)
        m[0], m[1], m[2] = bounds[MUU], bounds[MUV], bounds[MVV]
    bound = charge + norm_bound(m, x0 * du, y0 * dv, x1 * du, y1 * dv, x2 * du, y2 * dv, du, dv)
    if kind == NURBS and bound > enough:
        if not whole:
            cell_bounds(c, node, u0, u1, v0, v1, True, check.stack, m)
        finer = charge + vector_bound(m, x0 * du, y0 * dv, x1 * du, y1 * dv, x2 * du, y2 * dv, du, dv)
        bound = min(bound, finer)
        if bound > enough and c.node[node, EXTENT] == SEVERAL:
            own = local_line(MEASURES)
            if _measure_met(p, row, u0, u1, v0, v1, own):
                finer = charge + vector_bound(own, x0 * du, y0 * dv, x1 * du, y1 * dv, x2 * du, y2 * dv, du, dv)
                bound = min(bound, finer)
        if bound > enough and (parts > HALVES or bound < FAR * enough):
            sampled = _sampled_bound(g, row, f, check, x0, y0, x1, y1, x2, y2, bound, charge, parts, enough)
            bound = min(bound, sampled)
    return bound


@leaf
def points_bound(
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
    parts: int = HALVES,
) -> float:
    """Deviation bound of the triangle of points i, j and k, mm, as good as ``enough`` or the best known."""
    a, b, d = t.points[i], t.points[j], t.points[k]
    x0, y0, x1, y1, x2, y2 = float(a[0]), float(a[1]), float(b[0]), float(b[1]), float(d[0]), float(d[1])
    return _corners_bound(g, p, row, c, f, check, enough, x0, y0, x1, y1, x2, y2, parts)


@leaf
def face_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, check: Check, enough: float
) -> float:
    """Deviation bound of triangle k, mm, as good as ``enough`` or the best known."""
    return points_bound(g, p, row, c, f, t, t.tri[k, 0], t.tri[k, 1], t.tri[k, 2], check, enough)


@leaf
def segment_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, a: int, b: int, check: Check, enough: float
) -> float:
    """Bound of the segment between two points alone, mm: no triangle on it has a smaller one."""
    q = t.points
    x0, y0, x1, y1 = float(q[a, 0]), float(q[a, 1]), float(q[b, 0]), float(q[b, 1])
    return _corners_bound(g, p, row, c, f, check, enough, x0, y0, x1, y1, 0.5 * (x0 + x1), 0.5 * (y0 + y1))


@leaf
def can_shrink(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, a: int, b: int, check: Check, enough: float
) -> bool:
    """Whether a shorter segment at either of two points can keep ``enough``, mm.

    It cannot where the surface moves by more within one step of the lattice.
    """
    for i in range(2):
        x, y = float(t.points[a if i == 0 else b, 0]), float(t.points[a if i == 0 else b, 1])
        if _corners_bound(g, p, row, c, f, check, enough, x, y, x, y, x, y) <= enough:
            return True
    return False


@leaf
def edge_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, i: int, check: Check, enough: float
) -> float:
    """Bound of a flat triangle on edge i of k that reaches 1/16 of the way to the opposite corner, mm."""
    q = t.points
    a, b, d = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3], t.tri[k, i]
    x0, y0, x1, y1 = float(q[a, 0]), float(q[a, 1]), float(q[b, 0]), float(q[b, 1])
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    x, y = x + (q[d, 0] - x) / 16.0, y + (q[d, 1] - y) / 16.0
    return _corners_bound(g, p, row, c, f, check, enough, x0, y0, x1, y1, x, y)


@leaf
def worst_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, target: float, check: Check
) -> float:
    """The largest deviation bound of any inner triangle, mm."""
    worst = 0.0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] != 0:
            worst = max(worst, face_bound(g, p, row, c, f, t, k, check, target))
    return worst


@leaf
def closer_bound(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, enough: float, check: Check
) -> float:
    """As ``worst_bound``, with a closer look at each triangle; infinite if one does not keep ``enough``, mm.

    That is most likely the one that had the widest bound, so it is the first.
    """
    n = t.n[N_TRIANGLES]
    worst = 0.0
    for turn in range(-1, n):
        k = turn if turn >= 0 else min(check.widest[0], n - 1)
        if t.tri[k, INSIDE] != 0:
            i, j, m = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
            bound = points_bound(g, p, row, c, f, t, i, j, m, check, enough, QUARTERS)
            if bound > enough:
                return math.inf
            worst = max(worst, bound)
    return worst
