"""Points where free edges of a triangle cross a crease: with enough of them creases are edges.

Halving edges never lands on a crease; where one is steep, or several lie close together, it would take points
without end. Of two creases a hair apart each point of one soon has a companion on the other, and then no edge
crosses either.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.creases import crease_charge
from nurbs_ooc.bounds.piece_boxes import find_break
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, CREASED, N_U, N_V, Pieces
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.grid_points import DONE, FULL
from nurbs_ooc.tessellation.triangulate import FIXED, N_POINTS, Triangulation, split_inside

Floats = npt.NDArray[np.float64]

# A crease that takes more than this share of the target, mm, is made an edge; a smaller one shrinks with the triangle.
CREASE_SHARE = 0.25


@leaf
def _cross_point(t: Triangulation, f: Frame, along: int, value: float, k: int, p: int) -> bool:
    """Put lattice point ``p`` where the longest free edge of triangle k that crosses u (``along`` 0) or v = value does.

    False if there is no such edge.
    """
    start, step = (f.u0, f.du) if along == 0 else (f.v0, f.dv)
    line = int(math.floor((value - start) / step + 0.5))
    best = 0
    for i in range(3):
        if t.tri[k, FIXED + i] > 0:
            continue
        a, b = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        x, y = t.points[a, along], t.points[b, along]
        if ((x < line < y) or (y < line < x)) and abs(y - x) > best:
            # The longer the edge, the fewer points it takes.
            best = abs(y - x)
            share = (line - x) / float(y - x)
            t.points[p, along] = line
            other = 1 - along
            t.points[p, other] = t.points[a, other] + int(
                math.floor(share * (t.points[b, other] - t.points[a, other]) + 0.5)
            )
    return best > 0


@leaf
def split_at_crease(t: Triangulation, f: Frame, along: int, value: float, k: int) -> int:
    """Insert a point where an edge of triangle k crosses the crease u (``along`` 0) or v = value.

    Returns FULL if there is no room; no edge that can be split there is no fault.
    """
    p = t.n[N_POINTS]
    if p >= len(t.points):
        return FULL
    if _cross_point(t, f, along, value, k, p):
        split_inside(t, k, p)
    return DONE


@leaf
def _costliest(p: Pieces, row: int, along: int, low: float, high: float, found: Floats) -> None:
    """Let ``found`` (charge in mm, direction, value) be a crease of one direction that costs more over [low, high]."""
    n = p.table[row, N_U] if along == 0 else p.table[row, N_V]
    at = p.table[row, BREAK_U] if along == 0 else p.table[row, BREAK_V]
    if n < 2:
        return
    breaks = p.breaks[at : at + n + 1]
    k = find_break(p, at, n, low) + 1
    while k < n and breaks[k, 0] < high:
        charge = crease_charge(breaks[k - 1 : k + 2], 2, 0, low, high)
        if charge > found[0]:
            found[0], found[1], found[2] = charge, float(along), breaks[k, 0]
        k += 1


@leaf
def split_costly_crease(p: Pieces, row: int, f: Frame, t: Triangulation, k: int, target: float) -> int:
    """Insert a point of triangle k on the crease that costs it most, if that is much of ``target``, mm.

    Returns FULL if there is no room.
    """
    if p.table[row, CREASED] == 0:
        return DONE
    found = local_line(3)
    found[0], found[1], found[2] = CREASE_SHARE * target, 0.0, 0.0
    before = found[0]
    for along in range(2):
        start, step = (f.u0, f.du) if along == 0 else (f.v0, f.dv)
        x, y, z = t.points[t.tri[k, 0], along], t.points[t.tri[k, 1], along], t.points[t.tri[k, 2], along]
        _costliest(p, row, along, start + step * min(x, y, z), start + step * max(x, y, z), found)
    if found[0] > before:
        return split_at_crease(t, f, int(found[1]), found[2], k)
    return DONE
