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
    """The edges that begin at each vertex, those of late triangles last: vertex at the end, vertex across, triangle.

    Those of vertex v are rows ``start[v]`` to ``start[v + 1]``; ``left`` counts them.
    """
    n = triangles.shape[0]
    left = np.zeros(n_vertices, np.int32)
    for t in range(n):
        for k in range(3):
            left[np.uint64(triangles[t, k])] += 1
    start = np.empty(n_vertices + 2, np.int32)  # first one place late: the next loop moves it on
    start[0] = start[1] = 0
    for v in range(n_vertices):
        start[v + 2] = start[v + 1] + left[v]
    edges = np.empty((3 * n, 3), np.int32)
    for t in range(n):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        for _ in range(3):
            place = np.uint64(a) + np.uint64(1)
            at = np.uint64(start[place])
            edges[at, 0] = b
            edges[at, 1] = c
            edges[at, 2] = t
            start[place] += 1
            a, b, c = b, c, a
    return left, start, edges


@leaf
def _twin(begin, end, start, edges, done) -> int:  # type: ignore[no-untyped-def]
    """Row of the edge from ``end`` to ``begin`` of the last triangle that is left, or -1."""
    low, at = np.uint64(start[np.uint64(end)]), np.uint64(start[np.uint64(end) + np.uint64(1)])
    while at > low:
        at -= np.uint64(1)
        if edges[at, 0] == begin and not done[np.uint64(edges[at, 2])]:
            return int(at)
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
    left, start, edges = _adjacency(triangles, labels.shape[0])
    n_triangles = triangles.shape[0]
    done = np.zeros(n_triangles, np.bool_)
    stack = np.empty((3 * n_triangles + 3, 4), np.int32)  # edges that may be crossed: ends, vertex across, when reached
    times = np.full(labels.shape[0], _LONG_AGO, np.int32)  # when a vertex, by its new number, entered the ring
    one = np.uint64(1)  # unsigned numbers need no check for counting from the end
    n_stack, n_done, n_used = np.uint64(0), np.uint64(0), np.uint64(0)
    edge_head, ring_head, at = np.int64(0), np.int64(0), np.int64(0)
    far = np.int64(-1)
    for first in range(n_triangles):
        if done[first]:
            continue
        t = np.uint64(first)
        a, b, c = np.int32(triangles[t, 0]), np.int32(triangles[t, 1]), np.int32(triangles[t, 2])
        slot = np.int64(NO_EDGE)
        across = np.int32(0)
        going_on = True
        while going_on:
            done[t] = True
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
                stack[n_stack, 0], stack[n_stack, 1], stack[n_stack, 2] = a, b, c
                stack[n_stack, 3] = edge_head
                n_stack += one
                edge_head += 1
            n_done += one
            stack[n_stack, 0], stack[n_stack, 1], stack[n_stack, 2] = b, c, a
            stack[n_stack, 3] = edge_head
            n_stack += one
            stack[n_stack, 0], stack[n_stack, 1], stack[n_stack, 2] = c, a, b
            stack[n_stack, 3] = edge_head + 1
            n_stack += one
            edge_head += 2
            # cross the youngest edge that leads to a triangle that is left
            going_on = False
            while n_stack > 0 and not going_on:
                n_stack -= one
                begin, end = stack[n_stack, 0], stack[n_stack, 1]
                if left[np.uint64(end)] == 0 or left[np.uint64(begin)] == 0:
                    continue
                twin = _twin(begin, end, start, edges, done)
                if twin >= 0:
                    slot = min(np.int64(edge_head - 1 - stack[n_stack, 3]), np.int64(NO_EDGE))
                    across = stack[n_stack, 2]
                    a, b, c = end, begin, edges[np.uint64(twin), 1]
                    t = np.uint64(edges[np.uint64(twin), 2])
                    going_on = True
    return at, np.int64(n_used)
