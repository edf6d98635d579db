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

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel

EXTRA_BYTES = 16  # at most, per triangle: a byte of codes and three numbers of five bytes
_RING = 16
_NO_EDGE = 15
_NEW, _NEXT, _FAR = 0, 14, 15
_NOBODY = 0xFFFFFFFF


def encode_triangles(
    triangles: npt.NDArray[np.uint32], labels: npt.NDArray[np.int32], predictors: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8], int]:
    """Code triangles, number their vertices by first use and say what each is predicted from.

    Args:
        triangles: (t, 3) uint32, in order; corners differ.
        labels: (n,) int32, -1 on entry; on return the new number of every vertex used.
        predictors: (n, 3) uint32; on return rows (a, b, d) in new numbers, a = b = d for a plain difference.

    Returns:
        (t,) codes, (e,) extra bytes, number of vertices used.
    """
    codes = np.empty(len(triangles), np.uint8)
    extras = np.empty(EXTRA_BYTES * len(triangles), np.uint8)
    n_extras, n_used = _encode(triangles, labels, predictors, codes, extras)
    return codes, extras[:n_extras], n_used


def decode_triangles(
    codes: npt.NDArray[np.uint8], extras: npt.NDArray[np.uint8], n_vertices: int, predictors: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.uint32], int]:
    """Inverse of ``encode_triangles``: (t, 3) uint32 triangles, and the number of vertices they use.

    Raises:
        CorruptRecordError: a code refers to what is not there.
    """
    triangles = np.empty((len(codes), 3), np.uint32)
    padded = np.zeros(len(extras) + EXTRA_BYTES, np.uint8)
    padded[: len(extras)] = extras
    n_used = _decode(codes, padded, len(extras), n_vertices, triangles, predictors)
    if n_used < 0:
        raise CorruptRecordError("tile: its triangles refer to vertices that are not there")
    return triangles, n_used


@helper
def _write_number(extras, at, value):  # type: ignore[no-untyped-def]
    """Zigzag, then seven bits to a byte, the lowest first; returns where to go on."""
    rest = (value << 1) ^ (value >> 63)
    while rest > 127:
        extras[at] = np.uint8(rest & 127 | 128)
        rest >>= 7
        at += 1
    extras[at] = np.uint8(rest)
    return at + 1


@helper
def _read_number(extras, at):  # type: ignore[no-untyped-def]
    """Inverse of ``_write_number``: (value, where to go on); five bytes at most."""
    rest = np.int64(0)
    for k in range(5):
        byte = np.int64(extras[at])
        at += 1
        rest |= (byte & 127) << (7 * k)
        if byte < 128:
            break
    return (rest >> 1) ^ -(rest & 1), at


@helper
def _encode_vertex(vertex, is_new, extras, at, far, ring, head):  # type: ignore[no-untyped-def]
    """(code, where to go on, last far vertex, ring head)."""
    code = np.int64(_NEW)
    if not is_new:
        for slot in range(13):
            if ring[(head - 1 - slot) & 15] == vertex:
                return np.int64(slot + 1), at, far, head
        code = np.int64(_NEXT)
        if vertex != far + 1:
            code = np.int64(_FAR)
            at = _write_number(extras, at, vertex - far)
        far = vertex
    ring[head & 15] = vertex
    return code, at, far, head + 1


@helper
def _edge(a, b):  # type: ignore[no-untyped-def]
    return np.uint64(a) << np.uint64(32) | np.uint64(b)


@kernel
def _encode(triangles, labels, predictors, codes, extras):  # type: ignore[no-untyped-def]
    edges = np.full(_RING, np.uint64(0xFFFFFFFFFFFFFFFF))
    across = np.zeros(_RING, np.int64)
    ring = np.full(_RING, np.int64(-1))
    edge_head, ring_head, at = 0, 0, 0
    n_used = np.int64(0)
    far = np.int64(-1)
    for t in range(triangles.shape[0]):
        # number the corners
        before = n_used
        for k in range(3):
            if labels[triangles[t, k]] < 0:
                labels[triangles[t, k]] = n_used
                n_used += 1
        a = np.int64(labels[triangles[t, 0]])
        b = np.int64(labels[triangles[t, 1]])
        c = np.int64(labels[triangles[t, 2]])
        # look for an edge to continue from
        ab, bc, ca = _edge(a, b), _edge(b, c), _edge(c, a)
        slot = np.int64(_NO_EDGE)
        edge = ab
        for recent in range(_NO_EDGE):
            edge = edges[(edge_head - 1 - recent) & 15]
            if (edge == ab) | (edge == bc) | (edge == ca):  # one branch, not three
                slot = np.int64(recent)
                break
        if slot < _NO_EDGE:
            # turn the triangle so that the edge comes first, code the third corner
            if edge == bc:
                a, b, c = b, c, a
            elif edge == ca:
                a, b, c = c, a, b
            code = np.int64(_NEW)
            if c >= before:
                predictors[c, 0] = a
                predictors[c, 1] = b
                predictors[c, 2] = across[(edge_head - 1 - slot) & 15]
                ring[ring_head & 15] = c
                ring_head += 1
            else:
                code, at, far, ring_head = _encode_vertex(c, False, extras, at, far, ring, ring_head)
            codes[t] = np.uint8(slot << 4 | code)
        else:
            # code all corners; a new one is predicted from the corner or the vertex before
            if a >= before:
                predictors[a, :] = max(a - 1, 0)
            if b >= before:
                predictors[b, :] = a
            if c >= before:
                predictors[c, :] = b
            pair_at = at
            code, at, far, ring_head = _encode_vertex(a, a >= before, extras, at + 1, far, ring, ring_head)
            codes[t] = np.uint8(_NO_EDGE << 4 | code)
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


@helper
def _decode_vertex(code, extras, at, n_used, far, ring, ring_head):  # type: ignore[no-untyped-def]
    """(vertex, where to go on, vertices used, last far vertex, ring head); a vertex >= n_used is not there."""
    if code == _NEW:
        vertex = n_used
        n_used += 1
    elif code < _NEXT:
        return ring[(ring_head - code) & 15], at, n_used, far, ring_head
    else:
        difference = np.int64(1)
        if code == _FAR:
            difference, at = _read_number(extras, at)
        vertex = far + difference
        far = vertex
    ring[ring_head & 15] = vertex
    return vertex, at, n_used, far, ring_head + 1


@kernel
def _decode(codes, extras, n_extras, n_vertices, triangles, predictors):  # type: ignore[no-untyped-def]
    """Number of vertices used, or -1."""
    first = np.full(_RING, np.int64(_NOBODY))
    second = np.full(_RING, np.int64(_NOBODY))
    across = np.zeros(_RING, np.int64)
    ring = np.full(_RING, np.int64(_NOBODY))
    edge_head, ring_head, at = 0, 0, 0
    n_used = np.int64(0)
    far = np.int64(-1)
    for t in range(codes.shape[0]):
        slot = np.int64(codes[t]) >> 4
        code = np.int64(codes[t]) & 15
        before = n_used
        if slot < _NO_EDGE:
            # two corners from an edge, the third coded
            edge = (edge_head - 1 - slot) & 15
            a = first[edge]
            b = second[edge]
            d = across[edge]
            if code == _NEW:
                if n_used >= n_vertices:
                    return -1
                c = n_used
                n_used += 1
                ring[ring_head & 15] = c
                ring_head += 1
                predictors[c, 0] = a
                predictors[c, 1] = b
                predictors[c, 2] = d
            elif code < _NEXT:
                c = ring[(ring_head - code) & 15]
            else:
                c, at, n_used, far, ring_head = _decode_vertex(code, extras, at, n_used, far, ring, ring_head)
        else:
            # three corners coded; a new one is predicted from the corner or the vertex before
            pair = np.int64(extras[at])
            a, at, n_used, far, ring_head = _decode_vertex(code, extras, at + 1, n_used, far, ring, ring_head)
            middle = n_used
            b, at, n_used, far, ring_head = _decode_vertex(pair >> 4, extras, at, n_used, far, ring, ring_head)
            last = n_used
            c, at, n_used, far, ring_head = _decode_vertex(pair & 15, extras, at, n_used, far, ring, ring_head)
            if n_used > n_vertices:
                return -1
            if middle > before:
                predictors[before, :] = max(before - 1, 0)
            if last > middle:
                predictors[middle, :] = a
            if n_used > last:
                predictors[last, :] = b
            first[edge_head & 15] = b
            second[edge_head & 15] = a
            across[edge_head & 15] = c
            edge_head += 1
        if min(a, b, c) < 0 or max(a, b, c) >= n_used or at > n_extras:
            return -1
        triangles[t, 0] = a
        triangles[t, 1] = b
        triangles[t, 2] = c
        first[edge_head & 15] = c
        second[edge_head & 15] = b
        across[edge_head & 15] = a
        first[(edge_head + 1) & 15] = a
        second[(edge_head + 1) & 15] = c
        across[(edge_head + 1) & 15] = b
        edge_head += 2
    return n_used if at == n_extras else -1
