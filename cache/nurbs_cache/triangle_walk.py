r"""Orders and codes triangles in one walk: each continues from an edge of a recent one where the mesh allows it.

From the first triangle that is left, in the order given, the walk goes over the edge it reached last to the
triangle on the other side; where there is none it goes back to the edge before. The walk knows when it came by
an edge and when a vertex was last coded, so the slots of ``connectivity``'s rings are differences of two
times instead of searches. Equal input gives equal bytes, whatever the machine.

         /\  /\
        /1_\/_3\        1 -> 2 -> 3 -> …: a strip grows until it meets itself, then from its youngest free edge
        \  /\  /
         \/2_\/
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.connectivity import EXTRA_BYTES, FAR, NEW, NEXT, NO_EDGE, RING_CODES, write_number
from nurbs_cache.jit import helper, kernel, leaf

_LONG_AGO = -1 << 30

Rows = npt.NDArray[np.int32]


def walk_triangles(
    triangles: npt.NDArray[np.uint32],
    labels: npt.NDArray[np.int32],
    order: npt.NDArray[np.int32],
    predictors: npt.NDArray[np.int32],
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8], int]:
    """Code triangles in the order of the walk, number their vertices by first use.

    Args:
        triangles: (t, 3) uint32; corners differ.
        labels: (n,) int32, -1 on entry; on return the new number of every vertex used.
        order: (n,) int32; on return the old number of every new one.
        predictors: (n, 3) int32; on return rows (a, b, d) by new number, in *old* numbers.

    Returns:
        (t,) codes, (e,) extra bytes, number of vertices used.
    """
    codes = np.empty(len(triangles), np.uint8)
    extras = np.empty(EXTRA_BYTES * len(triangles), np.uint8)
    n_extras, n_used = _walk(triangles, labels, order, predictors, codes, extras)
    return codes, extras[:n_extras], n_used


@helper
def _adjacency(triangles, n_vertices):  # type: ignore[no-untyped-def]
    """Corner 4 t + k of triangle t: its vertex, and the corners at each vertex, those of late triangles last.

    The fourth place of a triangle repeats its first vertex: the edge from corner ``i`` ends at ``vertex[i + 1]``.
    The corners at vertex v are ``corners[start[v] : start[v + 1]]``, their edges end at ``ends`` of the same range.
    """
    n = triangles.shape[0]
    vertex = np.empty(4 * n, np.int32)
    left = np.zeros(n_vertices, np.int32)
    for t in range(n):
        at = np.uint64(4 * t)
        for k in range(3):
            vertex[at + np.uint64(k)] = triangles[t, k]
            left[np.uint64(triangles[t, k])] += 1
        vertex[at + np.uint64(3)] = triangles[t, 0]
    start = np.empty(n_vertices + 2, np.int32)  # first one place late: the next loop moves it on
    start[0] = start[1] = 0
    for v in range(n_vertices):
        start[v + 2] = start[v + 1] + left[v]
    ends, corners = np.empty(3 * n, np.int32), np.empty(3 * n, np.int32)
    for t in range(n):
        for k in range(3):
            corner = np.uint64(4 * t + k)
            place = np.uint64(vertex[corner]) + np.uint64(1)
            ends[np.uint64(start[place])] = vertex[corner + np.uint64(1)]
            corners[np.uint64(start[place])] = corner
            start[place] += 1
    return vertex, left, start, ends, corners


@leaf
def _across(begin, end, start, ends, corners, done) -> int:  # type: ignore[no-untyped-def]
    """Corner of the last triangle that is left whose edge runs from ``end`` to ``begin``, or -1."""
    low, at = np.uint64(start[np.uint64(end)]), np.uint64(start[np.uint64(end) + np.uint64(1)])
    while at > low:
        at -= np.uint64(1)
        if ends[at] == begin and not done[np.uint64(corners[at]) >> np.uint64(2)]:
            return int(corners[at])
    return -1


@leaf
def _code_vertex(vertex, far, times, ring_head, extras, at) -> tuple[int, int, int, int]:  # type: ignore[no-untyped-def]
    """Code of a vertex that was seen before: (code, last far vertex, ring head, where to go on)."""
    age = ring_head - times[vertex]
    if age <= RING_CODES:
        return int(age), far, ring_head, at
    code = np.int64(NEXT)
    if vertex != far + 1:
        code = np.int64(FAR)
        at = write_number(extras, at, np.int64(vertex - far))
    times[vertex] = ring_head
    return int(code), vertex, ring_head + 1, at


@kernel
def _walk(triangles, labels, order, predictors, codes, extras):  # type: ignore[no-untyped-def]
    code: Any
    far: Any
    ring_head: Any
    at: Any
    corner: Any
    vertex, left, start, ends, corners = _adjacency(triangles, labels.shape[0])
    n_triangles = triangles.shape[0]
    done = np.zeros(n_triangles, np.bool_)
    stack = np.empty((3 * n_triangles + 3, 2), np.int32)  # corner whose edge may be crossed; when it was reached
    times = np.full(labels.shape[0], _LONG_AGO, np.int32)  # when a vertex, by its new number, entered the ring
    one = np.uint64(1)  # unsigned numbers need no check for counting from the end
    n_stack, n_done, n_used = np.uint64(0), np.uint64(0), np.uint64(0)
    edge_head, ring_head, at = np.int64(0), np.int64(0), np.int64(0)
    far = np.int64(-1)
    for first in range(n_triangles):
        if done[first]:
            continue
        corner = np.int64(4 * first)
        slot = np.int64(NO_EDGE)
        across = np.int32(0)
        while corner >= 0:
            turn = corner & 3
            i_b = corner + 1 if turn < 2 else corner - 2
            i_c = corner + 2 if turn < 1 else corner - 1
            a, b, c = vertex[np.uint64(corner)], vertex[np.uint64(i_b)], vertex[np.uint64(i_c)]
            done[np.uint64(corner >> 2)] = True
            left[np.uint64(a)] -= 1
            left[np.uint64(b)] -= 1
            left[np.uint64(c)] -= 1
            if slot < NO_EDGE:
                # two corners come with the edge
                code = np.int64(NEW)
                label = np.int64(labels[np.uint64(c)])
                if label < 0:
                    labels[np.uint64(c)] = n_used
                    order[n_used] = c
                    predictors[n_used, 0] = a
                    predictors[n_used, 1] = b
                    predictors[n_used, 2] = across
                    times[n_used] = ring_head
                    ring_head += 1
                    n_used += one
                else:
                    code, far, ring_head, at = _code_vertex(label, far, times, ring_head, extras, at)
                codes[n_done] = np.uint8(slot << 4 | code)
            else:
                # all three are coded; a new one is predicted from the corner or the vertex before
                pair_at = at
                at += 1
                three = np.int64(0)
                before = order[n_used - one] if n_used > 0 else a
                for here in (a, b, c):
                    code = np.int64(NEW)
                    label = np.int64(labels[here])
                    if label < 0:
                        labels[here] = n_used
                        order[n_used] = here
                        predictors[n_used, :] = before
                        times[n_used] = ring_head
                        ring_head += 1
                        n_used += one
                    else:
                        code, far, ring_head, at = _code_vertex(label, far, times, ring_head, extras, at)
                    three = three << 4 | code
                    before = here
                codes[n_done] = np.uint8(NO_EDGE << 4 | three >> 8)
                extras[pair_at] = np.uint8(three & 255)
                stack[n_stack, 0] = corner
                stack[n_stack, 1] = edge_head
                n_stack += one
                edge_head += 1
            n_done += one
            stack[n_stack, 0] = i_b
            stack[n_stack, 1] = edge_head
            stack[n_stack + one, 0] = i_c
            stack[n_stack + one, 1] = edge_head + 1
            n_stack += np.uint64(2)
            edge_head += 2
            # cross the youngest edge that leads to a triangle that is left
            corner = np.int64(-1)
            while n_stack > 0 and corner < 0:
                n_stack -= one
                edge = np.uint64(stack[n_stack, 0])
                begin, end = vertex[edge], vertex[edge + one]
                if left[np.uint64(end)] == 0 or left[np.uint64(begin)] == 0:
                    continue
                corner = _across(begin, end, start, ends, corners, done)
                if corner >= 0:
                    slot = min(np.int64(edge_head - 1 - stack[n_stack, 1]), np.int64(NO_EDGE))
                    across = vertex[edge + np.uint64(2) if edge & np.uint64(3) < 1 else edge - one]
    return at, np.int64(n_used)
