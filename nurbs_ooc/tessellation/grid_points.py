"""Inner points of a face that its cells promise: the points of their grids, offered to its triangulation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.tessellation.cells import CHILD, GRID, Cells
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.triangulate import FIXED, INSIDE, N_POINTS, Triangulation, locate, split

Ints = npt.NDArray[np.int64]

# Grid points closer than this part of their spacing to a point or a boundary edge are left out.
CLEARANCE = 0.45
# Results of ``insert_grids``, and of ``certify``.
DONE, FULL = 0, 1


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
