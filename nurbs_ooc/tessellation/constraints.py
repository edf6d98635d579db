"""Boundary segments in a triangulation: made edges by flipping what they cross, then inside told from outside.

The constraint count of an edge says how often it was asked for; crossing an edge of odd count changes
inside to outside. Whether a segment passes a point is an exact test, so none is missed by a hair.

Source: S. W. Sloan, "A fast algorithm for generating constrained Delaunay triangulations", Computers &
Structures 47, 1993.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.geometry.predicates import in_circle, orient
from nurbs_ooc.tessellation.triangulate import (
    ADJACENT,
    CHECKED,
    FIXED,
    INSIDE,
    N_TRIANGLES,
    STACK,
    Triangulation,
    corner_of,
    flip,
    side_to,
)

Ints = npt.NDArray[np.int64]


@leaf
def find_edge(t: Triangulation, a: int, b: int) -> tuple[int, int]:
    """Triangle and index of the edge a-b, turning about a; (-1, 0) if there is none."""
    start = t.points[a, 2]
    k = start
    while True:
        i = corner_of(t, k, a)
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
        t.tri[o, FIXED + side_to(t, o, k)] += 1


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
        i = corner_of(t, k, a)
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
        j = side_to(t, o, k)
        d = t.tri[o, j]
        side = orient(t.points, a, b, d)
        if d == b or side == 0:
            return n, d, blocked
        k = o
        # The next crossed edge joins d to the corner on the other side of a-b.
        if side > 0:
            i = corner_of(t, o, left)
            left = d
        else:
            i = corner_of(t, o, r)
            r = d


@leaf
def _flip_through(t: Triangulation, a: int, b: int, pairs: Ints, n: int) -> bool:
    """Flip the crossed edges until a-b is an edge; False if that does not end."""
    capacity = len(pairs)  # its columns 2 and 3: edges that were made
    head = 0
    waiting = n
    made = 0
    tries = 0
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
        d = t.tri[o, side_to(t, o, k)]
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
            pairs[made, 2], pairs[made, 3] = p, d
            made += 1
    # Give the new edges back the Delaunay property, except the constraint itself.
    for _ in range(4):
        flipped = False
        for m in range(made):
            p, d = pairs[m, 2], pairs[m, 3]
            if (p == a and d == b) or (p == b and d == a):
                continue
            k, i = find_edge(t, p, d)
            if k < 0 or t.tri[k, FIXED + i] > 0:
                continue
            o = t.tri[k, ADJACENT + i]
            e = t.tri[o, side_to(t, o, k)]
            f, q, s = t.tri[k, i], t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
            if (
                in_circle(t.points, t.scale, f, q, s, e)
                and orient(t.points, f, q, e) > 0
                and orient(t.points, f, e, s) > 0
            ):
                flip(t, k, i)
                pairs[m, 2], pairs[m, 3] = f, e
                flipped = True
        if not flipped:
            break
    return True


@leaf
def insert_constraint(t: Triangulation, a: int, b: int, pairs: Ints, crossed: Ints) -> bool:
    """Make a-b an edge (or a chain of edges through points exactly on it) and count it as fixed.

    ``pairs`` is scratch (see ``Room``). On False the segment crosses a fixed edge, whose
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


@leaf
def flood_inside(t: Triangulation) -> None:
    """Set ``inside`` by the even-odd rule, walking in from the outer box."""
    n = t.n[N_TRIANGLES]
    # The mark of triangles that were checked serves for those that were seen.
    for k in range(n):
        t.tri[k, CHECKED] = 0
    top = 1
    t.tri[0, STACK] = t.points[0, 2]
    t.tri[t.points[0, 2], CHECKED] = 1
    t.tri[t.points[0, 2], INSIDE] = 0
    while top > 0:
        top -= 1
        k = t.tri[top, STACK]
        for i in range(3):
            o = t.tri[k, ADJACENT + i]
            if o >= 0 and t.tri[o, CHECKED] == 0:
                t.tri[o, CHECKED] = 1
                t.tri[o, INSIDE] = (t.tri[k, INSIDE] + t.tri[k, FIXED + i]) % 2
                t.tri[top, STACK] = o
                top += 1
    for k in range(n):
        t.tri[k, CHECKED] = 0
