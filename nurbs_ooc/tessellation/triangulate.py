r"""Delaunay triangulation on an integer lattice.

Points are inserted one by one (walk, split, flip); boundary segments follow in ``constraints``. Every
topological decision is an exact orientation test. Triangles are counter-clockwise; index i of
the neighbours and of the constraint counts belongs to the edge opposite corner i::

            c
           / \        tri = (a, b, c)
      e1  /   \  e0   neighbour 0 lies across e0 = b-c, and so on
         /     \
        a ----- b
            e2

A box of four outer points encloses everything, so real points always have a closed fan.

Source: C. L. Lawson, "Software for C1 surface interpolation", 1977 (flipping).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_ooc.geometry.predicates import LATTICE, in_circle, orient

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

N_OUTER = 4
# Columns of ``Triangulation.tri``: three corners, then these.
ADJACENT, FIXED, INSIDE, CHECKED, STACK = 3, 6, 9, 10, 11
COLUMNS = 12
# Entries of ``Triangulation.n``.
N_POINTS, N_TRIANGLES, LAST = 0, 1, 2
# Of a walk that has not arrived.
ASTRAY = -1
# A point that splits a triangle is found in it or next to it, unless the lattice is too coarse for both.
NEAR = 64


class Room(NamedTuple):
    """Arrays that one triangulation after the other lies in; their values mean nothing between."""

    points: Ints
    tri: Ints
    pairs: Ints  # (capacity of triangles, 4) scratch of ``insert_constraint``


class Triangulation(NamedTuple):
    """A growing triangulation in arrays of fixed capacity, few and wide so that calls stay cheap."""

    points: Ints  # (capacity, 3) lattice x, y, and one triangle at the point
    tri: Ints  # (capacity, COLUMNS): corners; neighbours, -1 outside; constraint counts; inside, checked, scratch
    n: Ints  # points, triangles, last triangle touched
    scale: Floats  # (2,) metric of the in-circle test


@leaf
def triangles_of(points: int) -> int:
    """Room for the triangles of that many points."""
    return 2 * points + 64


@helper
def room_for(capacity: int) -> Room:
    """Room for triangulations of up to ``capacity`` points."""
    points = capacity + N_OUTER
    return Room(
        np.empty((points, 3), dtype=np.int64),
        np.empty((triangles_of(points), COLUMNS), dtype=np.int64),
        np.empty((triangles_of(points), 4), dtype=np.int64),
    )


@leaf
def start_triangulation(t: Triangulation, sx: float, sy: float) -> None:
    """Let ``t`` be empty: the outer box, cut into two triangles."""
    margin = LATTICE // 4
    low, high = -margin, LATTICE + margin
    t.points[0, 0], t.points[0, 1] = low, low
    t.points[1, 0], t.points[1, 1] = high, low
    t.points[2, 0], t.points[2, 1] = high, high
    t.points[3, 0], t.points[3, 1] = low, high
    for k in range(4):
        t.points[k, 2] = 0
    t.points[3, 2] = 1
    t.tri[0, 0], t.tri[0, 1], t.tri[0, 2] = 0, 1, 2
    t.tri[1, 0], t.tri[1, 1], t.tri[1, 2] = 0, 2, 3
    t.tri[0, ADJACENT], t.tri[0, ADJACENT + 1], t.tri[0, ADJACENT + 2] = -1, 1, -1
    t.tri[1, ADJACENT], t.tri[1, ADJACENT + 1], t.tri[1, ADJACENT + 2] = -1, -1, 0
    for k in range(2):
        for column in range(FIXED, COLUMNS):
            t.tri[k, column] = 0
    t.n[N_POINTS] = N_OUTER
    t.n[N_TRIANGLES] = 2
    t.n[LAST] = 0
    t.scale[0], t.scale[1] = sx, sy


@helper
def new_triangulation(r: Room, capacity: int, sx: float, sy: float) -> Triangulation:
    """An empty one for up to ``capacity`` points, which ``r`` has room for."""
    points = capacity + N_OUTER
    t = Triangulation(r.points[:points], r.tri[: triangles_of(points)], np.zeros(3, dtype=np.int64), np.empty(2))
    start_triangulation(t, sx, sy)
    return t


@leaf
def corner_of(t: Triangulation, triangle: int, point: int) -> int:
    """Which corner of ``triangle`` is ``point``."""
    if t.tri[triangle, 0] == point:
        return 0
    return 1 if t.tri[triangle, 1] == point else 2


@leaf
def side_to(t: Triangulation, triangle: int, neighbour: int) -> int:
    """Which edge of ``triangle`` leads to ``neighbour``."""
    if t.tri[triangle, ADJACENT] == neighbour:
        return 0
    return 1 if t.tri[triangle, ADJACENT + 1] == neighbour else 2


@leaf
def opposite(t: Triangulation, triangle: int, neighbour: int) -> int:
    """The corner of ``triangle`` that faces ``neighbour``."""
    return t.tri[triangle, side_to(t, triangle, neighbour)]


@leaf
def _set(
    t: Triangulation, k: int, a: int, b: int, c: int, n0: int, n1: int, n2: int, f0: int, f1: int, f2: int
) -> None:
    """Overwrite triangle ``k`` and let its corners know it."""
    t.tri[k, 0], t.tri[k, 1], t.tri[k, 2] = a, b, c
    t.tri[k, ADJACENT], t.tri[k, ADJACENT + 1], t.tri[k, ADJACENT + 2] = n0, n1, n2
    t.tri[k, FIXED], t.tri[k, FIXED + 1], t.tri[k, FIXED + 2] = f0, f1, f2
    t.tri[k, CHECKED] = 0
    t.points[a, 2], t.points[b, 2], t.points[c, 2] = k, k, k


@leaf
def _relink(t: Triangulation, triangle: int, old: int, new: int) -> None:
    """The neighbour ``old`` of ``triangle`` is now ``new``."""
    if triangle >= 0:
        t.tri[triangle, ADJACENT + side_to(t, triangle, old)] = new


@leaf
def flip(t: Triangulation, k: int, i: int) -> None:
    """Turn the diagonal opposite corner i of ``k``: (p, a, b) and (d, b, a) become (p, a, d) and (p, d, b)."""
    o = t.tri[k, ADJACENT + i]
    j = side_to(t, o, k)
    p, a, b, d = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3], t.tri[o, j]
    n_bp, n_pa = t.tri[k, ADJACENT + (i + 1) % 3], t.tri[k, ADJACENT + (i + 2) % 3]
    f_bp, f_pa = t.tri[k, FIXED + (i + 1) % 3], t.tri[k, FIXED + (i + 2) % 3]
    n_ad, n_db = t.tri[o, ADJACENT + (j + 1) % 3], t.tri[o, ADJACENT + (j + 2) % 3]
    f_ad, f_db = t.tri[o, FIXED + (j + 1) % 3], t.tri[o, FIXED + (j + 2) % 3]
    _set(t, k, p, a, d, n_ad, o, n_pa, f_ad, 0, f_pa)
    _set(t, o, p, d, b, n_db, n_bp, k, f_db, f_bp, 0)
    _relink(t, n_ad, o, k)
    _relink(t, n_bp, k, o)


@leaf
def _legalise(t: Triangulation, top: int) -> None:
    """Flip edges opposite the new point (corner 0 of the ``top`` stacked triangles) until all are Delaunay."""
    while top > 0:
        top -= 1
        k = t.tri[top, STACK]
        o = t.tri[k, ADJACENT]
        if o < 0 or t.tri[k, FIXED] > 0:
            continue
        d = t.tri[o, side_to(t, o, k)]
        p, a, b = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
        if in_circle(t.points, t.scale, p, a, b, d) and orient(t.points, p, a, d) > 0 and orient(t.points, p, d, b) > 0:
            flip(t, k, 0)
            if top + 2 < len(t.tri):
                t.tri[top, STACK] = k
                t.tri[top + 1, STACK] = o
                top += 2


@leaf
def _walk(t: Triangulation, p: int, most: int) -> tuple[int, int]:
    """Walk from the triangle touched last towards lattice point ``p``, ``most`` steps at most.

    Returns as ``locate``, or ASTRAY in place of the second number.
    """
    k = t.n[LAST]
    turn = 0
    for _ in range(most):
        moved = False
        on = 3
        for m in range(3):
            i = (turn + m) % 3
            side = orient(t.points, t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3], p)
            if side < 0:
                k = t.tri[k, ADJACENT + i]
                moved = True
                break
            if side == 0:
                on = i if on == 3 else 4 + (3 - on - i)
        if not moved:
            t.n[LAST] = k
            return k, on
        # Turning the order of the edges keeps the walk from circling in triangulations that are not Delaunay.
        turn = (turn + 1) % 3
    return k, ASTRAY


@leaf
def locate(t: Triangulation, p: int) -> tuple[int, int]:
    """Walk to the triangle that holds lattice point ``p`` (coordinates at row p of x, y).

    Returns the triangle and 3 if p is inside, i if it lies on edge i, 4 + i if it is corner i.
    """
    k, on = _walk(t, p, 2 * t.n[N_TRIANGLES] + 16)
    if on == ASTRAY:
        t.n[LAST] = _search(t, p)
        k, on = _walk(t, p, 1)
    return k, on


@leaf
def _search(t: Triangulation, p: int) -> int:
    """The triangle that holds p, by looking at all."""
    for k in range(t.n[N_TRIANGLES]):
        a, b, c = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
        if orient(t.points, a, b, p) >= 0 and orient(t.points, b, c, p) >= 0 and orient(t.points, c, a, p) >= 0:
            return k
    return 0


@leaf
def split(t: Triangulation, k: int, on: int, p: int) -> None:
    """Insert point ``p`` into triangle k (``on`` = 3) or on its edge ``on``, then restore Delaunay."""
    m = t.n[N_TRIANGLES]
    if on == 3:
        a, b, c = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
        n0, n1, n2 = t.tri[k, ADJACENT], t.tri[k, ADJACENT + 1], t.tri[k, ADJACENT + 2]
        f0, f1, f2 = t.tri[k, FIXED], t.tri[k, FIXED + 1], t.tri[k, FIXED + 2]
        _set(t, k, p, b, c, n0, m, m + 1, f0, 0, 0)
        _set(t, m, p, c, a, n1, m + 1, k, f1, 0, 0)
        _set(t, m + 1, p, a, b, n2, k, m, f2, 0, 0)
        t.tri[m, INSIDE] = t.tri[k, INSIDE]
        t.tri[m + 1, INSIDE] = t.tri[k, INSIDE]
        _relink(t, n1, k, m)
        _relink(t, n2, k, m + 1)
        t.n[N_TRIANGLES] = m + 2
        t.tri[0, STACK], t.tri[1, STACK], t.tri[2, STACK] = k, m, m + 1
        _legalise(t, 3)
        return
    i = on
    o = t.tri[k, ADJACENT + i]
    j = side_to(t, o, k)
    a, b, c, d = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3], t.tri[o, j]
    f = t.tri[k, FIXED + i]
    n_ca, n_ab = t.tri[k, ADJACENT + (i + 1) % 3], t.tri[k, ADJACENT + (i + 2) % 3]
    f_ca, f_ab = t.tri[k, FIXED + (i + 1) % 3], t.tri[k, FIXED + (i + 2) % 3]
    # Seen from o the edge runs c, b: o = (d, c, b).
    n_bd, n_dc = t.tri[o, ADJACENT + (j + 1) % 3], t.tri[o, ADJACENT + (j + 2) % 3]
    f_bd, f_dc = t.tri[o, FIXED + (j + 1) % 3], t.tri[o, FIXED + (j + 2) % 3]
    _set(t, k, p, a, b, n_ab, o, m, f_ab, f, 0)
    _set(t, m, p, c, a, n_ca, k, m + 1, f_ca, 0, f)
    _set(t, o, p, b, d, n_bd, m + 1, k, f_bd, 0, f)
    _set(t, m + 1, p, d, c, n_dc, m, o, f_dc, f, 0)
    t.tri[m, INSIDE] = t.tri[k, INSIDE]
    t.tri[m + 1, INSIDE] = t.tri[o, INSIDE]
    _relink(t, n_ca, k, m)
    _relink(t, n_dc, o, m + 1)
    t.n[N_TRIANGLES] = m + 2
    t.tri[0, STACK], t.tri[1, STACK], t.tri[2, STACK], t.tri[3, STACK] = k, m, o, m + 1
    _legalise(t, 4)


@leaf
def insert_point(t: Triangulation, px: int, py: int) -> int:
    """Insert a lattice point; the number of the point there, old or new."""
    p = t.n[N_POINTS]
    t.points[p, 0], t.points[p, 1] = px, py
    k, on = locate(t, p)
    if on >= 4:
        return t.tri[k, on - 4]
    t.n[N_POINTS] = p + 1
    split(t, k, on, p)
    return p


@leaf
def split_inside(t: Triangulation, k: int, p: int) -> None:
    """Insert point ``p``, the next one, its coordinates written, which lies in triangle k or near it.

    Nothing is done where it is a corner or lies on a boundary edge, outside, or too far off: there the lattice is
    exhausted, and walks among slivers of its steps would have no end.
    """
    t.n[LAST] = k
    where, on = _walk(t, p, NEAR)
    if on == ASTRAY or t.tri[where, INSIDE] == 0 or on >= 4 or (on < 3 and t.tri[where, FIXED + on] > 0):
        return
    t.n[N_POINTS] = p + 1
    split(t, where, on, p)
