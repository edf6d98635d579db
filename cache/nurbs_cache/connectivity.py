r"""Triangles as one byte each: which recent edge a triangle continues from, and its third vertex.

Coder and decoder keep the same two rings: the last 16 edges at which the mesh can grow, each with the
vertex on its other side, and the last 16 vertices that were new or far away. A triangle that shares
one of the last 15 edges is turned so that the edge comes first::

         c           code = slot of edge (a, b) << 4 | code of c
        / \          code of a vertex: 0 new, 1 to 13 slot in the vertex ring + 1,
       a---b                           14 one after the last far one, 15 far: a number follows
        \ /          15 << 4 | code of a: no shared edge; the codes of b and c follow in a byte
         d           numbers follow as variable-length bytes of the zigzag difference to the last far one

Vertices are numbered by first use, so "new" needs no number. The vertex d across the shared edge gives
the parallelogram's guess a + b - d for a new c; ``predictors`` holds (a, b, d) for every vertex.

Source: the edge and vertex rings follow A. Kapoulkine, meshoptimizer, index codec; the parallelogram
C. Touma and C. Gotsman, Triangle mesh compression, Graphics Interface 1998.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel, leaf

EXTRA_BYTES = 16  # at most, per triangle: a byte of codes and three numbers of five bytes
RING = 16
NO_EDGE = 15
NEW, NEXT, FAR = 0, 14, 15
RING_CODES = 13  # codes 1 to 13 are slots of the vertex ring


def encode_triangles(
    triangles: npt.NDArray[np.uint32],
    labels: npt.NDArray[np.int32],
    order: npt.NDArray[np.int32],
    predictors: npt.NDArray[np.int32],
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8], int]:
    """Code triangles, number their vertices by first use and say what each is predicted from.

    Args:
        triangles: (t, 3) uint32, in order; corners differ.
        labels: (n,) int32, -1 on entry; on return the new number of every vertex used.
        order: (n,) int32; on return the old number of every new one.
        predictors: (n, 3) int32; on return rows (a, b, d) by new number, in *old* numbers, a = b = d for a
            plain difference.

    Returns:
        (t,) codes, (e,) extra bytes, number of vertices used.
    """
    codes = np.empty(len(triangles), np.uint8)
    extras = np.empty(EXTRA_BYTES * len(triangles), np.uint8)
    n_extras, n_used = _encode(triangles, labels, order, predictors, codes, extras)
    return codes, extras[:n_extras], n_used


@leaf
def write_number(extras, at, value) -> int:  # type: ignore[no-untyped-def]
    """Zigzag, then seven bits to a byte, the lowest first; returns where to go on."""
    rest = (value << 1) ^ (value >> 63)
    while rest > 127:
        extras[at] = np.uint8(rest & 127 | 128)
        rest >>= 7
        at += 1
    extras[at] = np.uint8(rest)
    return at + 1


@leaf
def read_number(extras, at) -> tuple[int, int]:  # type: ignore[no-untyped-def]
    """Inverse of ``write_number``: (value, where to go on); five bytes at most."""
    rest = np.int64(0)
    for k in range(5):
        byte = np.int64(extras[at])
        at += 1
        rest |= (byte & 127) << (7 * k)
        if byte < 128:
            break
    return int((rest >> 1) ^ -(rest & 1)), at


@leaf
def _encode_vertex(vertex, is_new, extras, at, far, ring, head) -> tuple[int, int, int, int]:  # type: ignore[no-untyped-def]
    """(code, where to go on, last far vertex, ring head)."""
    code = np.int64(NEW)
    if not is_new:
        for slot in range(RING_CODES):
            if ring[(head - 1 - slot) & 15] == vertex:
                return int(slot + 1), at, far, head
        code = np.int64(NEXT)
        if vertex != far + 1:
            code = np.int64(FAR)
            at = write_number(extras, at, vertex - far)
        far = vertex
    ring[head & 15] = vertex
    return int(code), at, far, head + 1


@helper
def _edge(a, b):  # type: ignore[no-untyped-def]
    return np.uint64(a) << np.uint64(32) | np.uint64(b)


@kernel
def _encode(triangles, labels, order, predictors, codes, extras):  # type: ignore[no-untyped-def]
    code: Any
    far: Any
    edges = np.full(RING, np.uint64(0xFFFFFFFFFFFFFFFF))
    across = np.zeros(RING, np.int64)
    ring = np.full(RING, np.int64(-1))
    edge_head, ring_head, at = 0, 0, 0
    n_used = np.int64(0)
    far = np.int64(-1)
    for t in range(triangles.shape[0]):
        # number the corners
        before = n_used
        for k in range(3):
            if labels[triangles[t, k]] < 0:
                labels[triangles[t, k]] = n_used
                order[n_used] = triangles[t, k]
                n_used += 1
        a = np.int64(labels[triangles[t, 0]])
        b = np.int64(labels[triangles[t, 1]])
        c = np.int64(labels[triangles[t, 2]])
        # look for an edge to continue from
        ab, bc, ca = _edge(a, b), _edge(b, c), _edge(c, a)
        slot = np.int64(NO_EDGE)
        edge = ab
        for recent in range(NO_EDGE):
            edge = edges[(edge_head - 1 - recent) & 15]
            if (edge == ab) | (edge == bc) | (edge == ca):  # one branch, not three
                slot = np.int64(recent)
                break
        if slot < NO_EDGE:
            # turn the triangle so that the edge comes first, code the third corner
            if edge == bc:
                a, b, c = b, c, a
            elif edge == ca:
                a, b, c = c, a, b
            code = np.int64(NEW)
            if c >= before:
                predictors[c, 0] = order[a]
                predictors[c, 1] = order[b]
                predictors[c, 2] = order[across[(edge_head - 1 - slot) & 15]]
                ring[ring_head & 15] = c
                ring_head += 1
            else:
                code, at, far, ring_head = _encode_vertex(c, False, extras, at, far, ring, ring_head)
            codes[t] = np.uint8(slot << 4 | code)
        else:
            # code all corners; a new one is predicted from the corner or the vertex before
            if a >= before:
                predictors[a, :] = order[max(a - 1, 0)]
            if b >= before:
                predictors[b, :] = order[a]
            if c >= before:
                predictors[c, :] = order[b]
            pair_at = at
            code, at, far, ring_head = _encode_vertex(a, a >= before, extras, at + 1, far, ring, ring_head)
            codes[t] = np.uint8(NO_EDGE << 4 | code)
            code, at, far, ring_head = _encode_vertex(b, b >= before, extras, at, far, ring, ring_head)
            last, at, far, ring_head = _encode_vertex(c, c >= before, extras, at, far, ring, ring_head)
            extras[pair_at] = np.uint8(code << 4 | last)
            edges[edge_head & 15] = _edge(b, a)
            across[edge_head & 15] = c
            edge_head += 1
        # the edges at which the mesh can grow
        edges[edge_head & 15] = _edge(c, b)
        across[edge_head & 15] = a
        edges[(edge_head + 1) & 15] = _edge(a, c)
        across[(edge_head + 1) & 15] = b
        edge_head += 2
    return at, n_used
