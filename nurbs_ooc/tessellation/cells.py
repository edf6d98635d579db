"""The kd-tree of a surface: where its derivatives are large, cells are small.

A cell knows bounds of the second derivatives over its box, and from them how many columns and rows
of triangles keep the error::

    (a^2 M_uu / n_u^2 + 2 a b M_uv / (n_u n_v) + b^2 M_vv / n_v^2) / 8 <= error

It is split (at a knot while it covers several Bézier pieces, else in the middle) where two halves
need fewer triangles than the whole; a leaf carries its regular grid of n_u x n_v. So uniform
curvature costs one cell and an exact count instead of a power of two, and flat parts cost nothing.

Source: A. Balázs, M. Guthe, R. Klein, "Efficient trimmed NURBS tessellation", WSCG 2004 (kd-tree);
the count per cell replaces its bisection.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.creases import HIDDEN
from nurbs_ooc.bounds.derivatives import BOXES, MUU, MUV, MVV, second_bounds
from nurbs_ooc.bounds.piece_boxes import box_bounds, box_boxes, find_break
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces
from nurbs_ooc.bounds.triangle_bound import MEASURES, box_radii, grid_bounds
from nurbs_ooc.geometry.bezier_net import bezier_net, split_net
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.grid_counts import grid_counts

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_DEPTH = 48
# Columns or rows of one leaf: beyond it the cell is split for locality.
MAX_GRID = 1 << 12
# Cells plan for less than the whole error, unless one will do: triangles that reach over a border between cells then
# keep it more often, and one that must be split wastes more than the margin (measured: fewer triangles in less time).
CELL_SHARE = 0.9
# Two halves must save this much to be worth a split.
WORTH = 0.85
# So two halves of one triangle pair each can never be worth the split of two.
UNDIVIDED = 2.0
# Where the sum of norms exceeds the error so many times, directions of derivatives are not looked at.
MOST_CRUDE = 16.0
# A rational cell of more quadrilaterals is split in any case.
MOST_UNTRIED = 64.0
# Cells of all surfaces together stay far below; a single one is cut off here and says so by its error.
MAX_CELLS = 1 << 18


# Bézier nets that a descent keeps: one a level, and those of the halves that are being tried.
SPARE = MAX_DEPTH + 2
NETS = SPARE + 2
# What a cell covers of its surface's pieces.
SEVERAL, WHOLE, PART = 0, 1, 2
# Columns of ``Cells.node`` and ``Cells.box``.
CHILD, AXIS, GRID, DEPTH, EXTENT, PARENT = 0, 1, 2, 4, 5, 6
NODE_COLUMNS = 7
CUT, SECOND, VECTORS = 4, 5, 8
COLUMNS = SECOND + MEASURES


class Cells(NamedTuple):
    """A kd-tree in two arrays; row 0 is the root, children are consecutive."""

    node: Ints  # (n, NODE_COLUMNS): first child (-1: a leaf), axis (0: u), columns, rows, depth, extent, parent
    box: Floats  # (n, COLUMNS): u0, u1, v0, v1; where it is split; ``MEASURES``


@leaf
def _least(boxes: Floats, at: int) -> float:
    """The smallest norm of any vector in the box at ``at``."""
    size = 0.0
    for k in range(at, at + 3):
        size += max(boxes[k], -boxes[k + 3], 0.0) ** 2
    return math.sqrt(size)


@leaf
def _is_even(b: Floats) -> bool:
    """Whether second derivatives are so much the same all over a cell that no split of it can be worth while.

    ``b``: the cell's row from SECOND on.
    """
    saved = 1.0
    for k in range(0, 3, 2):
        if b[k] > 0.0:
            saved *= math.sqrt(_least(b[3:], 6 * k) / b[k])
    return saved >= WORTH


@leaf
def _extent(p: Pieces, row: int, box: Floats) -> int:
    """Whether a box covers SEVERAL pieces, the WHOLE of one or PART of one; a surface without pieces is one."""
    if p.table[row, N_U] == 0:
        return PART
    i = find_break(p, p.table[row, BREAK_U], p.table[row, N_U], box[0])
    j = find_break(p, p.table[row, BREAK_V], p.table[row, N_V], box[2])
    at_u, at_v = p.table[row, BREAK_U] + i, p.table[row, BREAK_V] + j
    if box[1] > p.breaks[at_u + 1, 0] or box[3] > p.breaks[at_v + 1, 0]:
        return SEVERAL
    whole_u = box[0] <= p.breaks[at_u, 0] and box[1] >= p.breaks[at_u + 1, 0]
    whole_v = box[2] <= p.breaks[at_v, 0] and box[3] >= p.breaks[at_v + 1, 0]
    return WHOLE if whole_u and whole_v else PART


@leaf
def _measure(g: Tables, p: Pieces, row: int, box: Floats, error: float, out: Floats) -> None:
    """Second-derivative bounds of the pieces over a box to ``out`` (MEASURES,).

    Tagged surfaces have bounds alone. Where an ``error`` in mm needs many triangles by any measure, boxes are as wide
    as the bounds allow: such a cell will be split.
    """
    bounds = local_line(5)
    u0, u1, v0, v1 = box[0], box[1], box[2], box[3]
    box_bounds(g, p, row, u0, u1, v0, v1, bounds)
    out[0], out[1], out[2] = bounds[MUU], bounds[MUV], bounds[MVV]
    if g.surfaces[row].kind == NURBS:
        boxes = out[3:]
        a, b = u1 - u0, v1 - v0
        if a * a * bounds[MUU] + 2.0 * a * b * bounds[MUV] + b * b * bounds[MVV] > 8.0 * error * MOST_CRUDE:
            for k in range(BOXES):
                boxes[k] = bounds[MUU + k // 6] * (-1.0 if k % 6 < 3 else 1.0)
        else:
            box_boxes(p, row, u0, u1, v0, v1, boxes)
        box_radii(out)


@leaf
def _measure_net(g: Tables, row: int, box: Floats, net: Floats, error: float, out: Floats) -> None:
    """The same of the Bézier net of just this box, as good as an ``error`` in mm needs."""
    s = g.surfaces[row]
    dim = 4 if s.rational else 3
    second_bounds(net, s.degree_u, s.degree_v, dim, box[1] - box[0], box[3] - box[2], error, out)
    box_radii(out)


@leaf
def _count_grid(c: Cells, node: int, vectors: bool, error: float) -> tuple[int, int]:
    """Columns and rows of a cell, also to its ``node`` row; with vectors their directions count, not norms alone."""
    b = c.box[node]
    muu, muv, mvv = b[SECOND], b[SECOND + 1], b[SECOND + 2]
    size_u, size_v = b[1] - b[0], b[3] - b[2]
    sum_of_norms = size_u * size_u * muu + 2.0 * size_u * size_v * muv + size_v * size_v * mvv
    if vectors and sum_of_norms > 8.0 * error:
        muu, muv, mvv = grid_bounds(b[SECOND:])
    nu, nv = grid_counts(muu, muv, mvv, b[1] - b[0], b[3] - b[2], error)
    c.node[node, GRID + 0], c.node[node, GRID + 1] = nu, nv
    return nu, nv


@leaf
def _keep_smaller(known: Floats, b: Floats, vectors: bool) -> None:
    """Let bounds and boxes ``b`` (MEASURES,) be no wider than what is known, whatever roundoff does to them."""
    for m in range(3):
        b[m] = min(b[m], known[m])
    if vectors:
        for m in range(3):
            for k in range(3 + 6 * m, 6 + 6 * m):
                low, high = max(b[k], known[k]), min(b[k + 3], known[k + 3])
                if low <= high:
                    b[k], b[k + 3] = low, high
        box_radii(b)


@leaf
def _plan(g: Tables, p: Pieces, row: int, c: Cells, node: int, parent: int, error: float, net: Floats) -> bool:
    """Bounds, grid and extent of a cell whose box is set, within the bounds of its parent (-1: none).

    Returns whether its Bézier net was needed, and is in ``net``.
    """
    nurbs = g.surfaces[row].kind == NURBS
    b = c.box[node]
    extent = _extent(p, row, b)
    c.node[node, EXTENT] = extent
    own = nurbs and extent == PART
    if own:
        bezier_net(g, row, b[0], b[1], b[2], b[3], net)
        _measure_net(g, row, b, net, error, b[SECOND:])
    else:
        _measure(g, p, row, b, error, b[SECOND:])
    if parent >= 0:
        # What holds for a cell holds for its children.
        _keep_smaller(c.box[parent, SECOND:], b[SECOND:], nurbs)
    nu, nv = _count_grid(c, node, nurbs, error)
    if nurbs and extent == WHOLE and nu * nv > UNDIVIDED and g.surfaces[row].rational == 0:
        # The pieces' bounds were found without cutting; where that costs triangles the piece is cut out.
        coarse = local_line(MEASURES)
        for k in range(MEASURES):
            coarse[k] = b[SECOND + k]
        bezier_net(g, row, b[0], b[1], b[2], b[3], net)
        _measure_net(g, row, b, net, error, b[SECOND:])
        _keep_smaller(coarse, b[SECOND:], True)
        _count_grid(c, node, nurbs, error)
        own = True
    return own


@leaf
def _plan_part(g: Tables, row: int, c: Cells, node: int, parent: int, error: float, net: Floats) -> None:
    """The same of a part of one piece whose ``net`` is known."""
    b = c.box[node]
    c.node[node, EXTENT] = PART
    _measure_net(g, row, b, net, error, b[SECOND:])
    _keep_smaller(c.box[parent, SECOND:], b[SECOND:], True)
    _count_grid(c, node, True, error)


@leaf
def _cut(p: Pieces, row: int, box: Floats, along_u: bool) -> float:
    """Where to split a box: at the knot nearest to its middle if there is one inside, else in the middle."""
    low, high = (box[0], box[1]) if along_u else (box[2], box[3])
    middle = 0.5 * (low + high)
    if p.table[row, N_U] == 0:
        return middle
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    n = p.table[row, N_U] if along_u else p.table[row, N_V]
    i = find_break(p, at, n, middle)
    while i > 0 and p.breaks[at + i, HIDDEN] > 0.0:
        i -= 1
    k = i + 1
    while k < n and p.breaks[at + k, HIDDEN] > 0.0:
        k += 1
    below, above = p.breaks[at + i, 0], p.breaks[at + k, 0]
    best = middle
    found = False
    if below > low:
        best = below
        found = True
    if above < high and (not found or above - middle < middle - below):
        best = above
    return best


@leaf
def _split_axis(g: Tables, p: Pieces, row: int, c: Cells, node: int, single: bool) -> bool:
    """Whether to split along u: the direction of more columns, or, at equal counts, of more knots.

    Breaks of a swept surface are there to be reached: they go first.
    """
    nu, nv = c.node[node, GRID + 0], c.node[node, GRID + 1]
    if single or p.table[row, N_U] == 0:
        return nu >= nv
    b = c.box[node]
    spans_u = find_break(p, p.table[row, BREAK_U], p.table[row, N_U], b[1]) - find_break(
        p, p.table[row, BREAK_U], p.table[row, N_U], b[0]
    )
    spans_v = find_break(p, p.table[row, BREAK_V], p.table[row, N_V], b[3]) - find_break(
        p, p.table[row, BREAK_V], p.table[row, N_V], b[2]
    )
    if nu == nv or g.surfaces[row].kind != NURBS:
        return spans_u >= spans_v
    return nu > nv


@leaf
def _split(
    g: Tables, p: Pieces, row: int, c: Cells, node: int, first: int, error: float, nets: Floats, known: Ints, slot: int
) -> float:
    """Write the two halves of a cell to rows ``first`` and after; the quadrilaterals of both.

    ``nets[slot]`` is the cell's own if ``known[slot]`` says so; those of the halves go to ``nets[SPARE:]``.
    """
    s = g.surfaces[row]
    b = c.box[node]
    single = c.node[node, EXTENT] != SEVERAL
    along_u = _split_axis(g, p, row, c, node, single)
    cut = _cut(p, row, b, along_u)
    c.node[node, AXIS] = 0 if along_u else 1
    b[CUT] = cut
    inherit = single and s.kind == NURBS
    if inherit:
        if known[slot] == 0:
            bezier_net(g, row, b[0], b[1], b[2], b[3], nets[slot])
            known[slot] = 1
        low, high = (b[0], b[1]) if along_u else (b[2], b[3])
        dim = 4 if s.rational else 3
        t = (cut - low) / (high - low)
        split_net(nets[slot], s.degree_u, s.degree_v, dim, along_u, t, nets[SPARE], nets[SPARE + 1])
    both = 0.0
    for k in range(2):
        kid = first + k
        for m in range(4):
            c.box[kid, m] = b[m]
        c.box[kid, 1 - k if along_u else 3 - k] = cut
        c.node[kid, CHILD], c.node[kid, PARENT] = -1, node
        c.node[kid, DEPTH] = c.node[node, DEPTH] + 1
        known[SPARE + k] = 1
        if inherit:
            _plan_part(g, row, c, kid, node, error, nets[SPARE + k])
        elif not _plan(g, p, row, c, kid, node, error, nets[SPARE + k]):
            known[SPARE + k] = 0
        both += float(c.node[kid, GRID + 0]) * float(c.node[kid, GRID + 1])
    return both


@leaf
def _move_net(nets: Floats, known: Ints, source: int, to: int) -> None:
    known[to] = known[source]
    if known[source] != 0:
        for m in range(nets.shape[1]):
            nets[to, m] = nets[source, m]


@leaf
def _may_split(g: Tables, row: int, c: Cells, node: int) -> bool:
    """Whether halves of a cell might need fewer triangles than it does."""
    cost = float(c.node[node, GRID + 0]) * float(c.node[node, GRID + 1])
    if cost <= UNDIVIDED or c.node[node, DEPTH] >= MAX_DEPTH:
        return False
    single = c.node[node, EXTENT] != SEVERAL
    return not (single and g.surfaces[row].kind == NURBS and _is_even(c.box[node, SECOND:]))


@leaf
def build_cells(g: Tables, p: Pieces, row: int, box: Floats, error: float, c: Cells, nets: Floats, stack: Ints) -> int:
    """The kd-tree of surface ``row`` over ``box`` (u0, u1, v0, v1) for a chord error in mm, written to ``c``.

    Args:
        g, p, row: the surface and its pieces.
        box: (4,) parameters.
        error: mm.
        c: room for it.
        nets: (NETS, >= the net's numbers) scratch.
        stack: (2 * NETS,) scratch.

    Returns:
        The number of nodes; 0 if ``c`` has no room for them.
    """
    known = stack[NETS:]
    for k in range(4):
        c.box[0, k] = box[k]
    c.node[0, CHILD], c.node[0, DEPTH], c.node[0, PARENT] = -1, 0, 0
    known[0] = 1 if _plan(g, p, row, c, 0, -1, error, nets[0]) else 0
    if c.node[0, GRID + 0] * c.node[0, GRID + 1] > 1:
        error *= CELL_SHARE
        _count_grid(c, 0, g.surfaces[row].kind == NURBS, error)
    n = 1
    top = 1
    stack[0] = 0
    while top > 0:
        top -= 1
        node = stack[top]
        if n + 2 > MAX_CELLS or not _may_split(g, row, c, node):
            continue
        if n + 2 > len(c.node):
            return 0
        both = _split(g, p, row, c, node, n, error, nets, known, top)
        cost = float(c.node[node, GRID + 0]) * float(c.node[node, GRID + 1])
        single = c.node[node, EXTENT] != SEVERAL
        large = c.node[node, GRID + 0] > MAX_GRID or c.node[node, GRID + 1] > MAX_GRID
        # Bounds of a rational cell shrink much faster than it does while its weights are far from equal.
        coarse = cost > MOST_UNTRIED and g.surfaces[row].rational != 0
        if both <= WORTH * cost or (not single and cost > 4.0) or large or coarse:
            c.node[node, CHILD] = n
            for k in range(2):
                stack[top] = n + k
                _move_net(nets, known, SPARE + k, top)
                top += 1
            n += 2
    return n
