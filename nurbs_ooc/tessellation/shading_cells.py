"""A plan of grid points for what ``shading`` asks: a kd-tree whose leaves carry grids, by samples of the normal.

Unlike ``cells`` it bounds nothing: a grid of normals in each cell tells how fast they turn and how unevenly, and
how many columns and rows that takes. Triangles are checked one by one afterwards.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.bounds.circle_turn import turn_of_circle
from nurbs_ooc.bounds.creases import JUMP, VALUE
from nurbs_ooc.bounds.piece_boxes import find_break
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces
from nurbs_ooc.geometry.surface import CONE, CYLINDER, normal_of, surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.attribute_plan import attribute_counts
from nurbs_ooc.tessellation.cells import (
    AXIS,
    CHILD,
    COLUMNS,
    CUT,
    GRID,
    NODE_COLUMNS,
    UNDIVIDED,
    WORTH,
    Cells,
)
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.grid_counts import grid_counts
from nurbs_ooc.tessellation.grid_points import FULL, insert_grids
from nurbs_ooc.tessellation.shading import Aim
from nurbs_ooc.tessellation.triangulate import Triangulation

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

BASIS = MAX_DEGREE + 2
# Samples of a cell each way, how far inside its border the outer ones lie (poles and creases are borders), and the
# step of differences at each, as shares of the cell.
SIDE = 4
INSET = 0.02
STEP = 0.005
# A cell over more knot spans than its samples see is split in any case; for attributes, which may have kinks at knots
# (the curvature of cubics has), over more than one.
SEEN_SPANS = 4
MAX_DEPTH = 24
MAX_CELLS = 1 << 14
# Shares of what is allowed that a plan counts on.
PLANNED = 0.8
# Where normals turn evenly the bound is about this times the cube of a triangle's turn (see ``normal_bound``).
EVEN_TURN = 0.16
# Of the combined error, the part that distance and shading take each.
DISTANCE_SHARE, SHADING_SHARE = 0.7071, 0.7071


@leaf
def _sample(g: Tables, row: int, u: float, v: float, h_u: float, h_v: float, place: Floats, normal: Floats) -> bool:
    """Points and normals (9, 3) of a 3 x 3 grid around (u, v), v fastest; False if one is a pole."""
    scratch = local_table(4, BASIS)
    at = local_line(12)
    n = local_line(3)
    for i in range(3):
        for j in range(3):
            surface_point(g, row, u + (i - 1) * h_u, v + (j - 1) * h_v, scratch, at)
            if not normal_of(g, row, at, n):
                return False
            for k in range(3):
                place[3 * i + j, k] = at[k]
                normal[3 * i + j, k] = n[k]
    return True


@leaf
def _change(x: Floats, i: int, j: int) -> float:
    size = 0.0
    for k in range(3):
        size += (x[i, k] - x[j, k]) ** 2
    return math.sqrt(size)


@leaf
def _bend(n: Floats, a: int, b: int, c: int, d: int) -> float:
    """|n_a - n_b - n_c + n_d| without what only shortens the normal in the middle."""
    along, size = 0.0, 0.0
    for k in range(3):
        x = n[a, k] - n[b, k] - n[c, k] + n[d, k]
        along += x * n[4, k]
        size += x * x
    return math.sqrt(max(size - along * along, 0.0))


@leaf
def _turns(g: Tables, row: int, box: Floats, out: Floats) -> None:
    """Over a whole cell, at its samples: turn along u and v, second derivatives uu, uv, vv; the mean turn per mm."""
    place, normal = local_table(9, 3), local_table(9, 3)
    a, b = box[1] - box[0], box[3] - box[2]
    for k in range(6):
        out[k] = 0.0
    count = 0
    for i in range(SIDE):
        u = box[0] + a * (INSET + (1.0 - 2.0 * INSET) * i / (SIDE - 1.0))
        for j in range(SIDE):
            v = box[2] + b * (INSET + (1.0 - 2.0 * INSET) * j / (SIDE - 1.0))
            if not _sample(g, row, u, v, STEP * a, STEP * b, place, normal):
                continue
            steepest = 0.0
            for along in range(2):
                before, after = (1, 7) if along == 0 else (3, 5)
                turn, way = _change(normal, before, after), _change(place, before, after)
                out[along] = max(out[along], 0.5 * turn / STEP)
                steepest = max(steepest, turn / way if way > 0.0 else 0.0)
                out[2 + 2 * along] = max(out[2 + 2 * along], _bend(normal, before, 4, 4, after) / STEP**2)
            out[3] = max(out[3], 0.25 * _bend(normal, 0, 2, 6, 8) / STEP**2)
            out[5] += steepest
            count += 1
    out[5] /= max(count, 1)


@leaf
def _widest_arc(allowed: float) -> float:
    """The angle of an arc of a circle whose normals' error is what is allowed."""
    low, high = 0.0, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if turn_of_circle(middle) <= allowed:
            low = middle
        else:
            high = middle
    return low


@leaf
def _normal_counts(g: Tables, aim: Aim, row: int, box: Floats, error: float) -> tuple[int, int]:
    """Columns and rows of a cell that normals ask for."""
    if not aim.normal < math.inf and not aim.shaded > 0.0:
        return 1, 1
    turns = local_line(6)
    _turns(g, row, box, turns)
    allowed = aim.normal
    if aim.appearance > 0.0 and aim.shaded > 0.0:
        allowed = min(allowed, max(aim.unseen, SHADING_SHARE * error * turns[5]))
    if allowed > 1.5 or allowed <= 0.0:
        return 1, 1
    kind = g.surfaces[row].kind
    if kind == CYLINDER:
        return int(max(1.0, math.ceil(turns[0] / _widest_arc(PLANNED * allowed)))), 1
    nu, nv = grid_counts(turns[2], turns[3], turns[4], 1.0, 1.0, PLANNED * allowed)
    widest = (PLANNED * allowed / EVEN_TURN) ** (1.0 / 3.0)
    if kind == CONE:
        widest = 2.5 * widest
    return max(nu, int(math.ceil(turns[0] / widest))), max(nv, int(math.ceil(turns[1] / widest)))


@leaf
def _plan(g: Tables, aim: Aim, row: int, c: Cells, node: int, error: float) -> None:
    """Columns and rows of a cell, to its ``node`` row."""
    nu, nv = _normal_counts(g, aim, row, c.box[node], error)
    if aim.n_attributes > 0:
        more_u, more_v = attribute_counts(g, aim, row, c.box[node], SHADING_SHARE * error, PLANNED)
        nu, nv = max(nu, more_u), max(nv, more_v)
    c.node[node, GRID + 0], c.node[node, GRID + 1] = nu, nv


@leaf
def _cut_at(p: Pieces, row: int, box: Floats, along_u: bool, creases: bool) -> float:
    """The knot (or crease) nearest to the middle of a box in one direction; its middle if there is none inside."""
    n = p.table[row, N_U] if along_u else p.table[row, N_V]
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    low, high = (box[0], box[1]) if along_u else (box[2], box[3])
    middle = 0.5 * (low + high)
    best = math.inf
    for k in range(1, n):
        value = p.breaks[at + k, VALUE]
        counts = low < value < high and (not creases or p.breaks[at + k, JUMP] > 0.0)
        if counts and abs(value - middle) < abs(best - middle):
            best = value
    return middle if best == math.inf and not creases else best


@leaf
def _spans(p: Pieces, row: int, box: Floats, along_u: bool) -> int:
    n = p.table[row, N_U] if along_u else p.table[row, N_V]
    if n == 0:
        return 1
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    low, high = (box[0], box[1]) if along_u else (box[2], box[3])
    return find_break(p, at, n, high - 1e-12 * (high - low)) - find_break(p, at, n, low) + 1


@leaf
def _halve(
    g: Tables, aim: Aim, row: int, c: Cells, node: int, kid: int, along_u: bool, cut: float, error: float
) -> float:
    """Plan two halves of a cell at ``kid``; how many quadrilaterals they have."""
    both = 0.0
    for k in range(2):
        for m in range(4):
            c.box[kid + k, m] = c.box[node, m]
        c.box[kid + k, (1 if along_u else 3) - k] = cut
        _plan(g, aim, row, c, kid + k, error)
        both += float(c.node[kid + k, GRID + 0]) * float(c.node[kid + k, GRID + 1])
    return both


@leaf
def _split(g: Tables, aim: Aim, p: Pieces, row: int, c: Cells, node: int, kid: int, error: float) -> bool:
    """Split a cell, where it must be or where that pays, its halves to ``kid`` and after."""
    box = c.box[node]
    spans_u, spans_v = _spans(p, row, box, True), _spans(p, row, box, False)
    crease_u, crease_v = _cut_at(p, row, box, True, True), _cut_at(p, row, box, False, True)
    cost = float(c.node[node, GRID + 0]) * float(c.node[node, GRID + 1])
    if crease_u < math.inf or crease_v < math.inf:
        along_u = crease_u < math.inf
        cut = crease_u if along_u else crease_v
        _halve(g, aim, row, c, node, kid, along_u, cut, error)
    elif max(spans_u, spans_v) > (SEEN_SPANS if aim.n_attributes == 0 or cost <= UNDIVIDED else 1):
        along_u = spans_u >= spans_v
        cut = _cut_at(p, row, box, along_u, False)
        _halve(g, aim, row, c, node, kid, along_u, cut, error)
    else:
        if cost <= UNDIVIDED:
            return False
        cut_u, cut_v = _cut_at(p, row, box, True, False), _cut_at(p, row, box, False, False)
        by_u = _halve(g, aim, row, c, node, kid, True, cut_u, error)
        by_v = _halve(g, aim, row, c, node, kid, False, cut_v, error)
        along_u, cut = by_u < by_v, (cut_u if by_u < by_v else cut_v)
        if min(by_u, by_v) > WORTH * cost:
            return False
        if along_u:
            _halve(g, aim, row, c, node, kid, True, cut, error)
    c.node[node, CHILD], c.node[node, AXIS] = kid, 0 if along_u else 1
    c.box[node, CUT] = cut
    return True


@helper
def shading_cells(g: Tables, aim: Aim, p: Pieces, row: int, box: Floats, error: float) -> Cells:
    """The plan for surface ``row`` over ``box`` (u0, u1, v0, v1); of ``Cells`` only tree, boxes and grids count."""
    room = 64
    node = np.empty((room, NODE_COLUMNS), dtype=np.int64)
    boxes = np.empty((room, COLUMNS))
    depth = np.zeros(room, dtype=np.int64)
    c = Cells(node, boxes)
    for k in range(4):
        boxes[0, k] = box[k]
    _plan(g, aim, row, c, 0, error)
    n = 1
    at = 0
    while at < n:
        if n + 2 > room:
            more_node = np.empty((2 * room, NODE_COLUMNS), dtype=np.int64)
            more_boxes = np.empty((2 * room, COLUMNS))
            more_depth = np.zeros(2 * room, dtype=np.int64)
            more_node[:n], more_boxes[:n], more_depth[:n] = node[:n], boxes[:n], depth[:n]
            node, boxes, depth, room = more_node, more_boxes, more_depth, 2 * room
            c = Cells(node, boxes)
        node[at, CHILD] = -1
        if depth[at] < MAX_DEPTH and n < MAX_CELLS and _split(g, aim, p, row, c, at, n, error):
            depth[n], depth[n + 1] = depth[at] + 1, depth[at] + 1
            n += 2
        at += 1
    return Cells(node[:n], boxes[:n])


@leaf
def _points(c: Cells) -> int:
    total = 0
    for node in range(len(c.node)):
        if c.node[node, CHILD] < 0:
            total += c.node[node, GRID + 0] * c.node[node, GRID + 1]
    return total


@leaf
def insert_both(t: Triangulation, c: Cells, shades: Cells, f: Frame, stack: Ints) -> int:
    """Offer the grid points of both plans, the denser first: what the other adds there is too close then."""
    first, then = (c, shades) if _points(c) >= _points(shades) else (shades, c)
    if insert_grids(t, first, f, stack) == FULL:
        return FULL
    return insert_grids(t, then, f, stack)
