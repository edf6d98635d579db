"""Points where a triangle of a face breaks its bound, until none does.

Triangles are checked one by one (see ``deviation``); one that fails has an edge flipped if that helps
both sides, or else gets a point: on a crease that costs much (see ``crease_points``), or on its longest
free edge, or, where its boundary edge is the longest, between that edge and the opposite corner; the flips
that follow measure lengths as the error does at that place. Boundary edges are never split here: they
belong to two faces.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.predicates import orient
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import Cells
from nurbs_ooc.tessellation.crease_points import split_costly_crease
from nurbs_ooc.tessellation.deviation import Check, Frame, can_shrink, edge_bound, face_bound, points_bound, seen_length
from nurbs_ooc.tessellation.grid_points import DONE, FULL
from nurbs_ooc.tessellation.triangulate import (
    ADJACENT,
    CHECKED,
    FIXED,
    INSIDE,
    N_POINTS,
    N_TRIANGLES,
    Triangulation,
    flip,
    opposite,
    split_inside,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A result of ``certify``, beside DONE and FULL.
LONG_EDGE = 2
# Lattice steps; a triangle so small may be as good as the lattice lets it be.
FEW_STEPS = 64
# A boundary edge is cut into so many parts at once at most: its neighbour has not been asked.
MOST_PARTS = 8


@leaf
def _length(t: Triangulation, f: Frame, m: Floats, a: int, b: int) -> float:
    """The bound of the edge a-b alone, under the second derivatives ``m``."""
    return seen_length(m, (t.points[a, 0] - t.points[b, 0]) * f.du, (t.points[a, 1] - t.points[b, 1]) * f.dv) / 8.0


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
            points_bound(g, p, row, c, f, t, tip, a, far, check, target) <= target
            and points_bound(g, p, row, c, f, t, tip, far, b, check, target) <= target
        ):
            flip(t, k, i)
            return True
    return False


@leaf
def local_metric(t: Triangulation, c: Cells, f: Frame, m: Floats, target: float) -> None:
    """Let the in-circle test see lengths as the error does here, flat directions as long as the face."""
    root = c.box[0]
    t.scale[0] = f.du * max(math.sqrt(m[0] / (8.0 * target)), 1.0 / (root[1] - root[0]))
    t.scale[1] = f.dv * max(math.sqrt(m[2] / (8.0 * target)), 1.0 / (root[3] - root[2]))


@leaf
def longest_edges(t: Triangulation, f: Frame, k: int, m: Floats) -> tuple[int, float, int, float]:
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
def break_up(t: Triangulation, k: int, free: int, fixed: int) -> int:
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
    split_inside(t, k, p)
    return DONE


@leaf
def _add_point(p: Pieces, row: int, f: Frame, t: Triangulation, k: int, free: int, fixed: int, target: float) -> int:
    """Insert a point of triangle k on a crease that costs much, else as ``break_up``."""
    before = t.n[N_POINTS]
    code = split_costly_crease(p, row, f, t, k, target)
    return break_up(t, k, free, fixed) if t.n[N_POINTS] == before and code != FULL else code


@leaf
def _hopeless(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, k: int, target: float, check: Check
) -> bool:
    """Whether triangle k is a few lattice steps large and no smaller one at its corners would keep the target."""
    i, j, m = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
    for n in range(2):
        x, y, z = t.points[i, n], t.points[j, n], t.points[m, n]
        if max(x, y, z) - min(x, y, z) > FEW_STEPS:
            return False
    return not can_shrink(g, p, row, c, f, t, i, j, check, target) and not can_shrink(
        g, p, row, c, f, t, m, m, check, target
    )


@leaf
def parts_needed(excess: float) -> int:
    """Into how many parts a segment whose bound is ``excess`` (> 1) times the target must be cut."""
    return min(max(2, math.ceil(math.sqrt(min(excess, 1e6)))), MOST_PARTS)


@leaf
def blame_edge(t: Triangulation, k: int, i: int, excess: float, blame: Ints) -> None:
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
            bound = face_bound(g, p, row, c, f, t, k, check, target)
            if bound > target:
                before = t.n[N_POINTS]
                local_metric(t, c, f, check.second, target)
                free, q_free, fixed, q_fixed = longest_edges(t, f, k, check.second)
                alone = edge_bound(g, p, row, c, f, t, k, fixed, check, target) if q_fixed > target else 0.0
                if alone > target:
                    ends = t.tri[k, (fixed + 1) % 3], t.tri[k, (fixed + 2) % 3]
                    if can_shrink(g, p, row, c, f, t, ends[0], ends[1], check, target):
                        blame_edge(t, k, fixed, alone / target, blame)
                        code = LONG_EDGE
                elif _hopeless(g, p, row, c, f, t, k, target, check):
                    # It stays with the bound it has.
                    pass
                elif _flip_to_fit(g, p, row, c, f, t, k, target, check):
                    again, bound = True, 0.0
                elif _add_point(p, row, f, t, k, free if q_free >= q_fixed else -1, fixed, target) == FULL:
                    return FULL, worst
                if t.n[N_POINTS] > before:
                    again, bound = True, 0.0
            # Of a triangle that stays; one that goes later counts too, and had a bound within the target.
            if bound > worst:
                worst, check.widest[0] = bound, k
            k += 1
    return code, worst
