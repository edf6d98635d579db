r"""Constrained Delaunay triangulation on an integer lattice.

Points are inserted one by one (walk, split, flip), constraints by flipping the edges they cross;
every topological decision is an exact orientation test. Triangles are counter-clockwise; index i of
the neighbours and of the constraint counts belongs to the edge opposite corner i::

            c
           / \        tri = (a, b, c)
      e1  /   \  e0   neighbour 0 lies across e0 = b-c, and so on
         /     \
        a ----- b
            e2

A box of four outer points encloses everything, so real points always have a closed fan. The
constraint count says how often an edge was asked for: crossing an edge of odd count changes inside to outside.

Source: C. L. Lawson, "Software for C1 surface interpolation", 1977 (flipping); S. W. Sloan, "A fast
algorithm for generating constrained Delaunay triangulations", Computers & Structures 47, 1993.
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


class Triangulation(NamedTuple):
    """A growing triangulation in arrays of fixed capacity, few and wide so that calls stay cheap."""

    points: Ints  # (capacity, 3) lattice x, y, and one triangle at the point
    tri: Ints  # (capacity, COLUMNS): corners; neighbours, -1 outside; constraint counts; inside, checked, scratch
    n: Ints  # points, triangles, last triangle touched
    scale: Floats  # (2,) metric of the in-circle test


@helper
def new_triangulation(capacity: int, sx: float, sy: float) -> Triangulation:
    """An empty one for up to ``capacity`` points: the outer box, cut into two triangles."""
    points = capacity + N_OUTER
    t = Triangulation(
        np.empty((points, 3), dtype=np.int64),
        np.zeros((2 * points + 64, COLUMNS), dtype=np.int64),
        np.zeros(3, dtype=np.int64),
        np.empty(2),
    )
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
    t.n[N_POINTS] = N_OUTER
    t.n[N_TRIANGLES] = 2
    t.scale[0], t.scale[1] = sx, sy
    return t


@leaf
def _corner(t: Triangulation, triangle: int, point: int) -> int:
    """Which corner of ``triangle`` is ``point``."""
    if t.tri[triangle, 0] == point:
        return 0
    return 1 if t.tri[triangle, 1] == point else 2


@leaf
def _side(t: Triangulation, triangle: int, neighbour: int) -> int:
    """Which edge of ``triangle`` leads to ``neighbour``."""
    if t.tri[triangle, ADJACENT] == neighbour:
        return 0
    return 1 if t.tri[triangle, ADJACENT + 1] == neighbour else 2


@leaf
def opposite(t: Triangulation, triangle: int, neighbour: int) -> int:
    """The corner of ``triangle`` that faces ``neighbour``."""
    return t.tri[triangle, _side(t, triangle, neighbour)]


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
        t.tri[triangle, ADJACENT + _side(t, triangle, old)] = new


@leaf
def flip(t: Triangulation, k: int, i: int) -> None:
    """Turn the diagonal opposite corner i of ``k``: (p, a, b) and (d, b, a) become (p, a, d) and (p, d, b)."""
    o = t.tri[k, ADJACENT + i]
    j = _side(t, o, k)
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
        d = t.tri[o, _side(t, o, k)]
        p, a, b = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
        if in_circle(t.points, t.scale, p, a, b, d) and orient(t.points, p, a, d) > 0 and orient(t.points, p, d, b) > 0:
            flip(t, k, 0)
            if top + 2 < len(t.tri):
                t.tri[top, STACK] = k
                t.tri[top + 1, STACK] = o
                top += 2


@leaf
def locate(t: Triangulation, p: int) -> tuple[int, int]:
    """Walk to the triangle that holds lattice point ``p`` (coordinates at row p of x, y).

    Returns the triangle and 3 if p is inside, i if it lies on edge i, 4 + i if it is corner i.
    """
    k = t.n[LAST]
    turn = 0
    steps = 0
    limit = 2 * t.n[N_TRIANGLES] + 16
    while True:
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
            break
        # Turning the order of the edges keeps the walk from circling in triangulations that are not Delaunay.
        turn = (turn + 1) % 3
        steps += 1
        if steps > limit:
            k = _search(t, p)
            steps = -(1 << 30)
    t.n[LAST] = k
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
    j = _side(t, o, k)
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
def find_edge(t: Triangulation, a: int, b: int) -> tuple[int, int]:
    """Triangle and index of the edge a-b, turning about a; (-1, 0) if there is none."""
    start = t.points[a, 2]
    k = start
    while True:
        i = _corner(t, k, a)
        if t.tri[k, (i + 1) % 3] == b:
            return k, (i + 2) % 3
        if t.tri[k, (i + 2) % 3] == b:
            return k, (i + 1) % 3
        k = t.tri[k, ADJACENT + (i + 1) % 3]
        if k == start or k < 0:
            return -1, 0


@leaf
def _mark(t: Triangulation, k: int, i: int) -> None:
    """Count one more constraint along edge i of k, on both sides."""
    o = t.tri[k, ADJACENT + i]
    t.tri[k, FIXED + i] += 1
    if o >= 0:
        t.tri[o, FIXED + _side(t, o, k)] += 1


@leaf
def _along(t: Triangulation, a: int, r: int, b: int) -> int:
    """Positive if r lies on the same side of a as b, for r on their line."""
    dx, dy = t.points[r, 0] - t.points[a, 0], t.points[r, 1] - t.points[a, 1]
    return dx * (t.points[b, 0] - t.points[a, 0]) + dy * (t.points[b, 1] - t.points[a, 1])


@leaf
def _first_crossing(t: Triangulation, a: int, b: int) -> tuple[int, int, int]:
    """The triangle at a through which a-b leaves: (triangle, corner of a, -1), or (-1, 0, point) on the way."""
    start = t.points[a, 2]
    k = start
    while True:
        i = _corner(t, k, a)
        r, left = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        if r == b or left == b:
            return -1, 0, b
        right_of = orient(t.points, a, r, b)
        left_of = orient(t.points, a, b, left)
        if right_of == 0 and _along(t, a, r, b) > 0:
            return -1, 0, r
        if right_of > 0 and left_of > 0:
            return k, i, -1
        k = t.tri[k, ADJACENT + (i + 1) % 3]
        if k == start or k < 0:
            return -1, 0, -1


@leaf
def _collect(t: Triangulation, a: int, b: int, k: int, i: int, pairs: Ints) -> tuple[int, int, int]:
    """List the edges that a-b crosses, starting opposite corner i of k.

    Returns how many, the point where the crossing ends (b, or a point exactly on the way), and the
    number of the first crossed edge that is fixed itself (-1 if none).
    """
    n = 0
    blocked = -1
    r, left = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
    while True:
        if n >= len(pairs):
            return n, -1, blocked
        pairs[n, 0], pairs[n, 1] = left, r
        if t.tri[k, FIXED + i] > 0 and blocked < 0:
            blocked = n
        n += 1
        o = t.tri[k, ADJACENT + i]
        j = _side(t, o, k)
        d = t.tri[o, j]
        side = orient(t.points, a, b, d)
        if d == b or side == 0:
            return n, d, blocked
        k = o
        # The next crossed edge joins d to the corner on the other side of a-b.
        if side > 0:
            i = _corner(t, o, left)
            left = d
        else:
            i = _corner(t, o, r)
            r = d


@helper
def _flip_through(t: Triangulation, a: int, b: int, pairs: Ints, n: int) -> bool:
    """Flip the crossed edges until a-b is an edge; False if that does not end."""
    capacity = len(pairs)
    head = 0
    waiting = n
    made = 0
    tries = 0
    fresh = np.empty((capacity, 2), dtype=np.int64)
    while waiting > 0:
        tries += 1
        if tries > 16 * n * n + 64 * n + 256:
            return False
        left, r = pairs[head, 0], pairs[head, 1]
        head = (head + 1) % capacity
        waiting -= 1
        k, i = find_edge(t, left, r)
        if k < 0:
            continue
        p, q, s = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
        o = t.tri[k, ADJACENT + i]
        d = t.tri[o, _side(t, o, k)]
        tail = (head + waiting) % capacity
        if orient(t.points, p, q, d) <= 0 or orient(t.points, p, d, s) <= 0:
            pairs[tail, 0], pairs[tail, 1] = left, r
            waiting += 1
            continue
        flip(t, k, i)
        ends = p == a or p == b or d == a or d == b
        side_p, side_d = orient(t.points, a, b, p), orient(t.points, a, b, d)
        if not ends and ((side_p > 0 and side_d < 0) or (side_p < 0 and side_d > 0)):
            pairs[tail, 0], pairs[tail, 1] = p, d
            waiting += 1
        elif made < capacity:
            fresh[made, 0], fresh[made, 1] = p, d
            made += 1
    # Give the new edges back the Delaunay property, except the constraint itself.
    for _ in range(4):
        flipped = False
        for m in range(made):
            p, d = fresh[m, 0], fresh[m, 1]
            if (p == a and d == b) or (p == b and d == a):
                continue
            k, i = find_edge(t, p, d)
            if k < 0 or t.tri[k, FIXED + i] > 0:
                continue
            o = t.tri[k, ADJACENT + i]
            e = t.tri[o, _side(t, o, k)]
            f, q, s = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
            if (
                in_circle(t.points, t.scale, f, q, s, e)
                and orient(t.points, f, q, e) > 0
                and orient(t.points, f, e, s) > 0
            ):
                flip(t, k, i)
                fresh[m, 0], fresh[m, 1] = f, e
                flipped = True
        if not flipped:
            break
    return True


@helper
def insert_constraint(t: Triangulation, a: int, b: int, pairs: Ints, crossed: Ints) -> bool:
    """Make a-b an edge (or a chain of edges through points exactly on it) and count it as fixed.

    ``pairs`` is scratch (capacity of triangles, 2). On False the segment crosses a fixed edge, whose
    ends are in ``crossed``; nothing beyond what was passed is marked.
    """
    while a != b:
        k, i, point = _first_crossing(t, a, b)
        if k < 0:
            if point < 0:
                crossed[0], crossed[1] = a, b
                return False
            k, i = find_edge(t, a, point)
            _mark(t, k, i)
            a = point
            continue
        n, end, blocked = _collect(t, a, b, k, i, pairs)
        if blocked >= 0 or end < 0:
            at = max(blocked, 0)
            crossed[0], crossed[1] = pairs[at, 0], pairs[at, 1]
            return False
        if not _flip_through(t, a, end, pairs, n):
            crossed[0], crossed[1] = a, b
            return False
        k, i = find_edge(t, a, end)
        if k < 0:
            crossed[0], crossed[1] = a, b
            return False
        _mark(t, k, i)
        a = end
    return True


@helper
def flood_inside(t: Triangulation) -> None:
    """Set ``inside`` by the even-odd rule, walking in from the outer box."""
    n = t.n[N_TRIANGLES]
    seen = np.zeros(n, dtype=np.uint8)
    top = 1
    t.tri[0, STACK] = t.points[0, 2]
    seen[t.points[0, 2]] = 1
    t.tri[t.points[0, 2], INSIDE] = 0
    while top > 0:
        top -= 1
        k = t.tri[top, STACK]
        for i in range(3):
            o = t.tri[k, ADJACENT + i]
            if o >= 0 and seen[o] == 0:
                seen[o] = 1
                t.tri[o, INSIDE] = (t.tri[k, INSIDE] + t.tri[k, FIXED + i]) % 2
                t.tri[top, STACK] = o
                top += 1
