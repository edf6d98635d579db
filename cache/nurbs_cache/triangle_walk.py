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

import numpy as np
import numpy.typing as npt

from nurbs_cache.connectivity import EXTRA_BYTES, FAR, NEW, NEXT, NO_EDGE, RING_CODES, write_number
from nurbs_cache.jit import helper, kernel

_LONG_AGO = -1 << 30


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
    """Corner 4 t + k of triangle t: its vertex, and lists of the corners at each vertex with their lengths.

    The fourth place of a triangle repeats its first vertex: the edge from corner ``i`` ends at ``vertex[i + 1]``.
    """
    vertex = np.empty(4 * triangles.shape[0], np.int32)
    follow = np.empty(4 * triangles.shape[0], np.int32)
    latest = np.full(n_vertices, -1, np.int32)
    left = np.zeros(n_vertices, np.int32)
    for t in range(triangles.shape[0]):
        for k in range(3):
            a = np.int32(triangles[t, k])
            vertex[4 * t + k] = a
            follow[4 * t + k] = latest[a]
            latest[a] = 4 * t + k
            left[a] += 1
        vertex[4 * t + 3] = triangles[t, 0]
    return vertex, follow, latest, left


@helper
def _code_vertex(vertex, far, times, ring_head, extras, at):  # type: ignore[no-untyped-def]
    """Code of a vertex that was seen before: (code, last far vertex, ring head, where to go on)."""
    age = ring_head - times[vertex]
    if age <= RING_CODES:
        return np.int64(age), far, ring_head, at
    code = np.int64(NEXT)
    if vertex != far + 1:
        code = np.int64(FAR)
        at = write_number(extras, at, np.int64(vertex - far))
    times[vertex] = ring_head
    return code, np.int64(vertex), ring_head + 1, at


@kernel
def _walk(triangles, labels, order, predictors, codes, extras):  # type: ignore[no-untyped-def]
    vertex, follow, latest, left = _adjacency(triangles, labels.shape[0])
    n_triangles = triangles.shape[0]
    done = np.zeros(n_triangles, np.bool_)
    stack = np.empty((3 * n_triangles + 3, 2), np.int32)  # corner whose edge may be crossed; when it was reached
    times = np.full(labels.shape[0], _LONG_AGO, np.int32)  # when a vertex, by its new number, entered the ring
    n_stack, n_done, n_used = 0, 0, 0
    edge_head, ring_head, at = 0, 0, 0
    far = np.int64(-1)
    for start in range(n_triangles):
        if done[start]:
            continue
        corner = 4 * start
        slot = np.int64(NO_EDGE)
        across = np.int32(0)
        while corner >= 0:
            t = corner >> 2
            turn = corner & 3
            i_b = corner + 1 if turn < 2 else corner - 2
            i_c = corner + 2 if turn < 1 else corner - 1
            a, b, c = vertex[corner], vertex[i_b], vertex[i_c]
            done[t] = True
            left[a] -= 1
            left[b] -= 1
            left[c] -= 1
            if slot < NO_EDGE:
                # two corners come with the edge
                code = np.int64(NEW)
                label = np.int64(labels[c])
                if label < 0:
                    labels[c] = n_used
                    order[n_used] = c
                    predictors[n_used, 0] = a
                    predictors[n_used, 1] = b
                    predictors[n_used, 2] = across
                    times[n_used] = ring_head
                    ring_head += 1
                    n_used += 1
                else:
                    code, far, ring_head, at = _code_vertex(label, far, times, ring_head, extras, at)
                codes[n_done] = np.uint8(slot << 4 | code)
            else:
                # all three are coded; a new one is predicted from the corner or the vertex before
                pair_at = at
                at += 1
                three = np.int64(0)
                before = order[n_used - 1] if n_used > 0 else a
                for here in (a, b, c):
                    code = np.int64(NEW)
                    label = np.int64(labels[here])
                    if label < 0:
                        labels[here] = n_used
                        order[n_used] = here
                        predictors[n_used, :] = before
                        times[n_used] = ring_head
                        ring_head += 1
                        n_used += 1
                    else:
                        code, far, ring_head, at = _code_vertex(label, far, times, ring_head, extras, at)
                    three = three << 4 | code
                    before = here
                codes[n_done] = np.uint8(NO_EDGE << 4 | three >> 8)
                extras[pair_at] = np.uint8(three & 255)
                stack[n_stack, 0] = corner
                stack[n_stack, 1] = edge_head
                n_stack += 1
                edge_head += 1
            n_done += 1
            stack[n_stack, 0] = i_b
            stack[n_stack, 1] = edge_head
            stack[n_stack + 1, 0] = i_c
            stack[n_stack + 1, 1] = edge_head + 1
            n_stack += 2
            edge_head += 2
            # cross the youngest edge that leads to a triangle that is left
            corner = -1
            while n_stack > 0 and corner < 0:
                n_stack -= 1
                edge = np.int64(stack[n_stack, 0])
                begin = vertex[edge]
                end = vertex[edge + 1]
                if left[end] == 0 or left[begin] == 0:
                    continue
                corner = int(latest[end])
                while corner >= 0 and ((vertex[corner + 1] != begin) | done[corner >> 2]):
                    corner = int(follow[corner])
                if corner >= 0:
                    slot = min(np.int64(edge_head - 1 - stack[n_stack, 1]), np.int64(NO_EDGE))
                    across = vertex[edge + 2 if edge & 3 < 1 else edge - 1]
    return at, n_used
