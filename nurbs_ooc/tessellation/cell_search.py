"""What the cells of a kd-tree say of a parameter box: the walk begins where the last one ended."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.piece_boxes import unite
from nurbs_ooc.bounds.triangle_bound import box_radii
from nurbs_ooc.tessellation.cells import AXIS, CHILD, CUT, PARENT, SECOND, VECTORS, Cells

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@leaf
def cell_around(c: Cells, u0: float, u1: float, v0: float, v1: float, near: Ints) -> int:
    """The smallest cell that holds a parameter box.

    ``near`` (1,) is where the search begins, the number of any cell, and gets the one found.
    """
    node = near[0]
    while node > 0:
        b = c.box[node]
        if b[0] <= u0 and u1 <= b[1] and b[2] <= v0 and v1 <= b[3]:
            break
        node = c.node[node, PARENT]
    while c.node[node, CHILD] >= 0:
        low, high = (u0, u1) if c.node[node, AXIS] == 0 else (v0, v1)
        if high <= c.box[node, CUT]:
            node = c.node[node, CHILD]
        elif low >= c.box[node, CUT]:
            node = c.node[node, CHILD] + 1
        else:
            break
    near[0] = node
    return int(node)


@leaf
def cell_bounds(
    c: Cells, start: int, u0: float, u1: float, v0: float, v1: float, vectors: bool, stack: Ints, out: Floats
) -> None:
    """Second-derivative bounds (3,) of the leaves below ``start`` that meet a parameter box, and their boxes if wanted.

    They go to ``out`` (MEASURES,).
    """
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    if vectors:
        for m in range(3):
            for k in range(3):
                out[3 + 6 * m + k], out[6 + 6 * m + k] = np.inf, -np.inf
    top = 1
    stack[0] = start
    while top > 0:
        top -= 1
        node = stack[top]
        if c.node[node, CHILD] < 0:
            for k in range(3):
                out[k] = max(out[k], c.box[node, SECOND + k])
            if vectors:
                unite(c.box[node, VECTORS:], out[3:])
            continue
        low, high = (u0, u1) if c.node[node, AXIS] == 0 else (v0, v1)
        if low < c.box[node, CUT] or high <= c.box[node, CUT]:
            stack[top] = c.node[node, CHILD]
            top += 1
        if high > c.box[node, CUT]:
            stack[top] = c.node[node, CHILD] + 1
            top += 1
    if vectors:
        box_radii(out)
