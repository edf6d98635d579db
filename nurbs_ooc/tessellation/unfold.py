r"""Triangles beside a pole that are sound in (u, v) and folded back in space.

All of the line v = v1 is one point O, and u turns around it. A triangle much longer towards O than around
it may have its corners in another order when it is seen from O, for straight lines in (u, v) are not
straight there; a hair's breadth of u decides::

    P------------- v1      A and B nearly on one meridian, B an inch to the left: seen from O, B comes
    |\`-.                  first, although P A B is counter-clockwise here.
    | \  `B
    |  \ /                 The edge P A is flipped to X B: X A B is not folded, and X comes before B.
    X---A

Folds are no more than a triangle's height off, which its bound allows, but they turn the light round. So
an edge of a folded triangle is flipped where neither new triangle is folded and both keep the bound. Where there is
no such edge, as of three corners on one meridian, the longest one gets a point: it lies on another meridian.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.predicates import orient
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import Cells
from nurbs_ooc.tessellation.deviation import Check, Frame, points_bound
from nurbs_ooc.tessellation.grid_points import FULL
from nurbs_ooc.tessellation.refine import break_up
from nurbs_ooc.tessellation.triangulate import (
    ADJACENT,
    FIXED,
    INSIDE,
    N_POINTS,
    N_TRIANGLES,
    Triangulation,
    flip,
    opposite,
)
from nurbs_ooc.tessellation.trimming import Boundary
from nurbs_ooc.tessellation.workspace import Workspace

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.uint8]

FLAT = 2.0**-40  # sine of an angle that is roundoff
MAX_PASSES = 4  # a flip may let another one in


class Drawn(NamedTuple):
    """Points of a triangulation as they are drawn, each evaluated when it is first looked at."""

    place: Floats  # (n, 3) mm
    normal: Floats  # (n, 3) of S_u x S_v's sense; 0 at poles
    known: Flags  # (n,)
    owner: Ints  # (n,) boundary point of a lattice point, -1 for inner ones
    scratch: Floats  # (4, MAX_DEGREE + 2)


@leaf
def _any_pole(b: Boundary) -> bool:
    for i in range(len(b.pole)):
        if b.pole[i] != 0:
            return True
    return False


@leaf
def _at_pole(t: Triangulation, b: Boundary, d: Drawn, k: int) -> bool:
    """Whether triangle ``k`` has a corner at a pole: no other is ever folded before one of them is flipped."""
    for i in range(3):
        m = d.owner[t.tri[k, i]]
        if m >= 0 and b.pole[m] != 0:
            return True
    return False


@leaf
def _look(g: Tables, row: int, f: Frame, t: Triangulation, b: Boundary, d: Drawn, i: int) -> None:
    """Evaluate point ``i`` unless that is done."""
    if d.known[i] != 0:
        return
    d.known[i] = 1
    k = d.owner[i]
    u, v = f.u0 + t.points[i, 0] * f.du, f.v0 + t.points[i, 1] * f.dv
    if k >= 0:
        u, v = b.uv[k, 0], b.uv[k, 1]
    at = local_line(12)
    surface_point(g, row, u, v, d.scratch, at)
    sign = -1.0 if g.surfaces[row].reversed else 1.0
    if not surface_normal(g, row, u, v, d.scratch, at, d.normal[i]):
        sign = 0.0
    for m in range(3):
        d.place[i, m] = b.position[k, m] if k >= 0 else at[m]
        d.normal[i, m] *= sign


@leaf
def _folded(g: Tables, row: int, f: Frame, t: Triangulation, b: Boundary, d: Drawn, i: int, j: int, k: int) -> bool:
    """Whether a triangle, counter-clockwise in (u, v), looks away from all normals at its corners, or nowhere."""
    for c in (i, j, k):
        _look(g, row, f, t, b, d, c)
    place, normal = d.place, d.normal
    across, along, back = 0.0, 0.0, 0.0
    known, against = 0, 0
    for m in range(3):
        x, y = place[j, m] - place[i, m], place[k, m] - place[i, m]
        across += x * x
        along += y * y
        back += (y - x) * (y - x)
    if across == 0.0 or along == 0.0 or back == 0.0:
        return False  # two corners in the pole: it is not drawn
    hair = FLAT * math.sqrt(across * along)
    for c in (i, j, k):
        dots, size = 0.0, 0.0
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            flat = (place[j, n] - place[i, n]) * (place[k, o] - place[i, o])
            flat -= (place[j, o] - place[i, o]) * (place[k, n] - place[i, n])
            dots += flat * normal[c, m]
            size += abs(normal[c, m])
        if size > 0.0:
            known += 1
            if dots <= hair:
                against += 1
    return known > 0 and against == known


@leaf
def _turn(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, k: int, target: float,
    check: Check, d: Drawn,
) -> bool:  # fmt: skip
    """Flip an edge of the folded triangle ``k``, if that unfolds it and both triangles keep the bound."""
    for i in range(3):
        o = t.tri[k, ADJACENT + i]
        if t.tri[k, FIXED + i] > 0 or o < 0 or t.tri[o, INSIDE] == 0:
            continue
        tip, low, high = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        far = opposite(t, o, k)
        if orient(t.points, tip, low, far) <= 0 or orient(t.points, tip, far, high) <= 0:
            continue
        if _folded(g, row, f, t, b, d, tip, low, far) or _folded(g, row, f, t, b, d, tip, far, high):
            continue
        if (
            points_bound(g, p, row, c, f, t, tip, low, far, check, target) <= target
            and points_bound(g, p, row, c, f, t, tip, far, high, check, target) <= target
        ):
            flip(t, k, i)
            return True
    return False


@leaf
def _is_folded(g: Tables, row: int, f: Frame, t: Triangulation, b: Boundary, d: Drawn, k: int) -> bool:
    """Whether triangle ``k`` is an inner one, at a pole and folded."""
    return (
        t.tri[k, INSIDE] != 0
        and _at_pole(t, b, d, k)
        and _folded(g, row, f, t, b, d, t.tri[k, 0], t.tri[k, 1], t.tri[k, 2])
    )


@leaf
def _pass(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, target: float, check: Check,
    d: Drawn,
) -> tuple[int, int]:  # fmt: skip
    """Look at all inner triangles at poles once; how many were folded, and how many of them no more."""
    folded, turned = 0, 0
    for k in range(t.n[N_TRIANGLES]):
        if _is_folded(g, row, f, t, b, d, k):
            folded += 1
            if _turn(g, p, row, c, f, t, b, k, target, check, d):
                turned += 1
    return folded, turned


@leaf
def _forget(t: Triangulation, w: Workspace) -> int:
    """Let no point of a triangulation have been evaluated; how many there are."""
    for i in range(t.n[N_POINTS]):
        w.drawn.kind[i] = 0
    return t.n[N_POINTS]


@leaf
def unfold_poles(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, w: Workspace, target: float
) -> bool:
    """Flip edges of folded triangles of a face with poles, where no bound exceeds ``target``, mm.

    ``w.drawn.owner`` gives the boundary point of a lattice point, -1 for inner ones. Returns whether some stay folded.
    """
    if not _any_pole(b):
        return False
    n, r = _forget(t, w), w.drawn
    d = Drawn(r.place[:n], r.normal[:n], r.kind[:n], r.owner[:n], w.scratch)
    folded, turned = 0, 0
    for _ in range(MAX_PASSES):
        folded, turned = _pass(g, p, row, c, f, t, b, target, w.check, d)
        if turned == 0:
            break
    return folded > turned


@leaf
def break_folded(g: Tables, row: int, f: Frame, t: Triangulation, b: Boundary, w: Workspace) -> bool:
    """Insert a point on the longest edge of each folded triangle; whether there were any.

    The triangles around it have no bound yet.
    """
    n, r = _forget(t, w), w.drawn
    d = Drawn(r.place[:n], r.normal[:n], r.kind[:n], r.owner[:n], w.scratch)
    for k in range(t.n[N_TRIANGLES]):
        if max(t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]) >= n or not _is_folded(g, row, f, t, b, d, k):
            continue
        longest = -1
        most = 0.0
        for i in range(3):
            j, m = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
            size = 0.0
            for e in range(3):
                size += (d.place[j, e] - d.place[m, e]) ** 2
            if size > most:
                longest, most = i, size
        if longest >= 0 and t.tri[k, FIXED + longest] == 0 and break_up(t, k, longest, -1) == FULL:
            break
    return t.n[N_POINTS] > n
