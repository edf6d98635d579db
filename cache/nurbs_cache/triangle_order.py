r"""An order of triangles in which each continues from an edge of a recent one, as ``connectivity`` codes them best.

From the first triangle that is left, in the order given, the walk goes over the edge it reached last to the
triangle on the other side; where there is none it goes back to the edge before. Equal input gives equal order,
whatever the machine.

         /\  /\
        /1_\/_3\        1 -> 2 -> 3 -> …: a strip grows until it meets itself, then from its youngest free edge
        \  /\  /
         \/2_\/
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel

_EMPTY = -1


def order_triangles(triangles: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """The same (t, 3) triangles in walking order; their corners keep their places."""
    n_slots = 8
    while n_slots < 6 * len(triangles):  # at most half full
        n_slots *= 2
    ordered = np.empty_like(triangles)
    _walk(triangles, np.full(n_slots, _EMPTY, np.int32), ordered)
    return ordered


@helper
def _slot(a, b, mask):  # type: ignore[no-untyped-def]
    """Where to look first for the directed edge from a to b."""
    mixed = np.int64(a) * 0x9E3779B1 + np.int64(b) * 0x85EBCA6B  # numbers below 2**28: nothing wraps
    return mixed >> 16 & mask


@kernel
def _walk(triangles, table, ordered):  # type: ignore[no-untyped-def]
    flat = triangles.reshape(-1)
    n = flat.shape[0]
    mask = np.int64(table.shape[0] - 1)
    # enter every directed edge by the number of its first corner
    for corner in range(n):
        a = flat[corner]
        b = flat[corner + 1 if corner % 3 < 2 else corner - 2]
        at = _slot(a, b, mask)
        while table[at] != _EMPTY:
            at = (at + 1) & mask
        table[at] = corner
    done = np.zeros(triangles.shape[0], np.bool_)
    stack = np.empty(n + 3, np.int32)  # corners whose edge may have a triangle on its other side
    n_stack = 0
    n_done = 0
    for start in range(triangles.shape[0]):
        if done[start]:
            continue
        corner = 3 * start
        while corner >= 0:
            # take the triangle; the edge it was entered by starts at ``corner``
            t = corner // 3
            done[t] = True
            for k in range(3):
                ordered[n_done, k] = flat[3 * t + k]
            n_done += 1
            if corner == 3 * start:
                stack[n_stack] = corner
                n_stack += 1
            for turn in range(1, 3):
                stack[n_stack] = 3 * t + (corner - 3 * t + turn) % 3
                n_stack += 1
            # cross the youngest edge that leads to a triangle that is left
            corner = -1
            while n_stack > 0 and corner < 0:
                n_stack -= 1
                edge = stack[n_stack]
                b = flat[edge]
                a = flat[edge + 1 if edge % 3 < 2 else edge - 2]
                at = _slot(a, b, mask)
                while table[at] != _EMPTY:
                    other = int(table[at])
                    end = flat[other + 1 if other % 3 < 2 else other - 2]
                    if flat[other] == a and end == b and not done[other // 3]:
                        corner = other
                        break
                    at = (at + 1) & mask
