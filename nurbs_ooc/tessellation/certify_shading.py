"""Refinement for what ``shading`` asks: triangles that keep the distance get points until they keep that too.

A pass over the triangles follows every pass of ``certify``, for a new triangle must keep the distance first. One
that fails is halved on its longest free edge, lengths measured by the second derivatives behind the bound that
failed; one that a crease runs through, where an edge crosses the crease, until creases are edges.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_ooc.bounds.normal_bound import NOISE, unbounded_metric
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import Cells
from nurbs_ooc.tessellation.crease_points import split_at_crease
from nurbs_ooc.tessellation.deviation import Check, Frame, edge_bound, face_bound, segment_bound
from nurbs_ooc.tessellation.grid_points import DONE, FULL
from nurbs_ooc.tessellation.refine import (
    FEW_STEPS,
    LONG_EDGE,
    blame_edge,
    break_up,
    certify,
    local_metric,
    longest_edges,
    parts_needed,
)
from nurbs_ooc.tessellation.shading import (
    ONE,
    Aim,
    Corners,
    Facet,
    edge_ratio,
    ends_at_pole,
    facet_ratio,
    fill_facet,
    new_facet,
)
from nurbs_ooc.tessellation.triangulate import CHECKED, INSIDE, N_POINTS, N_TRIANGLES, Triangulation
from nurbs_ooc.tessellation.trimming import Boundary
from nurbs_ooc.tessellation.unfold import unfold_poles
from nurbs_ooc.tessellation.workspace import Workspace

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A triangle of which roundoff alone takes this share of what is allowed is not refined: that would make it worse.
NOISY = 0.5
# What a triangle that has no bound at all counts as when its boundary edge is cut into parts.
UNBOUNDED = 10.0
# Of ``t.tri[k, CHECKED]``: the distance is kept, everything is.
NEAR, KEPT = 1, 2


@leaf
def _is_tiny(t: Triangulation, k: int) -> bool:
    """Whether a triangle is a few lattice steps large."""
    for n in range(2):
        x, y, z = t.points[t.tri[k, 0], n], t.points[t.tri[k, 1], n], t.points[t.tri[k, 2], n]
        if max(x, y, z) - min(x, y, z) > FEW_STEPS:
            return False
    return True


@leaf
def _improve(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, d: Corners, k: int, error: float,
    ratio: float, check: Check, o: Facet, side: Facet, blame: Ints,
) -> int:  # fmt: skip
    """Refine triangle k, whose facet is ``o`` and whose ratio exceeds 1: FULL, LONG_EDGE (it is blamed), or DONE."""
    if d.creased and o.crease[0] >= 0.0:
        return split_at_crease(t, f, int(o.crease[0]), o.crease[1], k)
    m = o.second
    if ratio == math.inf or not m[0] + m[2] > 0.0:
        unbounded_metric(g, p, row, d.sides, o.uv, m)
    if not m[0] + m[2] > 0.0:
        return DONE
    local_metric(t, c, f, m, 1.0)
    free, q_free, fixed, q_fixed = longest_edges(t, f, k, m)
    if fixed >= 0 and q_fixed >= q_free:
        distance = edge_bound(g, p, row, c, f, t, k, fixed, check, error) if aim.appearance > 0.0 else 0.0
        alone = edge_ratio(g, p, aim, row, d, o, fixed, distance, error, side)
        if alone > 1.0:
            blame_edge(t, k, fixed, min(alone, UNBOUNDED), blame)
            return LONG_EDGE
    points = t.n[N_POINTS]
    code = break_up(t, k, free if q_free >= q_fixed else -1, fixed)
    if code == DONE and t.n[N_POINTS] == points and fixed >= 0 and q_fixed >= q_free and ratio < math.inf:
        # A sliver along the boundary, which takes no point.
        blame_edge(t, k, fixed, min(ratio, UNBOUNDED), blame)
        return LONG_EDGE
    return code


@leaf
def _refine_once(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, error: float,
    check: Check, d: Corners, o: Facet, side: Facet, at: Ints, refine: bool, blame: Ints,
) -> tuple[int, bool]:  # fmt: skip
    """Look at all triangles that are near but not yet kept; whether there are new ones."""
    code = DONE
    changed = False
    k = 0
    while k < t.n[N_TRIANGLES]:
        if t.tri[k, INSIDE] == 0 or t.tri[k, CHECKED] != NEAR:
            k += 1
            continue
        t.tri[k, CHECKED] = KEPT
        for i in range(3):
            at[i] = t.tri[k, i]
        if fill_facet(g, p, aim, row, f, t, b, d, at, o):
            distance = face_bound(g, p, row, c, f, t, k, check, error) if aim.appearance > 0.0 else 0.0
            o.crease[0] = -1.0
            ratio = facet_ratio(g, p, aim, row, d, o, distance, error, False)
            points = t.n[N_POINTS]
            endless = _is_tiny(t, k) or o.second[NOISE] >= NOISY or (ratio == math.inf and ends_at_pole(d, at, o))
            if ratio > 1.0 and refine and not endless:
                outcome = _improve(g, p, aim, row, c, f, t, d, k, error, ratio, check, o, side, blame)
                if outcome == FULL:
                    return FULL, changed
                code = max(code, outcome)
            if t.n[N_POINTS] > points:
                changed = True
            else:
                facet_ratio(g, p, aim, row, d, o, distance, error, True)
        k += 1
    return code, changed


@helper
def certify_shading(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, error: float,
    target: float, check: Check, d: Corners, final: bool, blame: Ints,
) -> tuple[int, float]:  # fmt: skip
    """As ``certify``, until everything else that is asked for is kept too; what was reached goes to ``d.found``.

    ``error`` is what appearance may take, ``target`` what distance alone may.
    """
    o, side = new_facet(), new_facet()
    at = np.empty(3, dtype=np.int64)
    worst = 0.0
    code = DONE
    while True:
        near, bound = certify(g, p, row, c, f, t, target, check, blame)
        worst = max(worst, bound)
        code = max(code, near)
        if near == FULL or (code != DONE and not final):
            return near if near == FULL else code, worst
        kept, changed = _refine_once(g, p, aim, row, c, f, t, b, error, check, d, o, side, at, True, blame)
        if kept == FULL:
            return FULL, worst
        code = max(code, kept)
        if not changed or (code != DONE and not final):
            return code, worst


@leaf
def forget_shading(t: Triangulation) -> None:
    """Let all triangles be looked at again."""
    for k in range(t.n[N_TRIANGLES]):
        t.tri[k, CHECKED] = NEAR


@helper
def measure_shading(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, error: float,
    check: Check, d: Corners,
) -> None:  # fmt: skip
    """Count triangles that have changed since, or of all if ``d.found`` was set back, into ``d.found``."""
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, CHECKED] != KEPT:
            t.tri[k, CHECKED] = NEAR
    o, side = new_facet(), new_facet()
    at = np.empty(3, dtype=np.int64)
    blame = np.zeros(1, dtype=np.int64)
    _refine_once(g, p, aim, row, c, f, t, b, error, check, d, o, side, at, False, blame)


@helper
def segments_too_long(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, error: float,
    check: Check, d: Corners, parts: Ints,
) -> bool:  # fmt: skip
    """Into how many ``parts`` (n_boundary,) boundary segments must be cut that exceed what is allowed; whether any."""
    o, side = new_facet(), new_facet()
    at = np.empty(3, dtype=np.int64)
    found = False
    point = b.point
    distance = 0.0
    for i in range(len(point)):
        at[0], at[1], at[2] = point[i], point[i], point[b.next[i]]
        parts[i] = 0
        fill_facet(g, p, aim, row, f, t, b, d, at, o)
        # At creases and poles the third corner of the triangle decides, which is not there yet.
        if d.kind[at[0]] == ONE and d.kind[at[2]] == ONE:
            if aim.appearance > 0.0:
                distance = segment_bound(g, p, row, c, f, t, at[0], at[2], check, error)
            ratio = edge_ratio(g, p, aim, row, d, o, 0, distance, error, side)
            if ratio > 1.0 and side.second[NOISE] < NOISY and side.crease[0] < 0.0:
                parts[i] = parts_needed(min(ratio, UNBOUNDED))
                found = True
    return found


@helper
def refine_shading(
    g: Tables, p: Pieces, aim: Aim, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, target: float,
    w: Workspace, d: Corners, final: bool,
) -> tuple[int, float]:  # fmt: skip
    """``certify_shading``, and once more for what unfolding poles has turned."""
    code, worst = certify_shading(g, p, aim, row, c, f, t, b, target, target, w.check, d, final, w.blame)
    if code != DONE:
        return code, worst
    unfold_poles(g, p, row, c, f, t, b, w, target)
    code, bound = certify_shading(g, p, aim, row, c, f, t, b, target, target, w.check, d, final, w.blame)
    return code, max(worst, bound)
