"""Triangles and vertices of a tile in one pass: a vertex is predicted the moment its triangle is read.

The codes of ``connectivity`` say for each new vertex which three it is predicted from; positions and normals
follow at once from the differences in ``planes``, while those three are still in the first-level cache.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.connectivity import EXTRA_BYTES, FAR, NEW, NEXT, NO_EDGE, RING, read_number
from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel, leaf
from nurbs_cache.planes import Bytes, join_planes, to_unit_normals

_NOBODY = 0x7FFFFFFF
_BAD_INDEX, _BAD_POSITION = -1, -2


class DecodedMesh(NamedTuple):
    """What a graphics card takes: (t, 3) uint32, (n, 3) float32 mm from the grid's origin, (n, 3) float32 unit."""

    triangles: npt.NDArray[np.uint32]
    positions: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]


def decode_mesh(
    codes: Bytes,
    extras: Bytes,
    position_bytes: tuple[Bytes, Bytes],
    normal_bytes: tuple[Bytes, Bytes],
    n_vertices: int,
    extent: tuple[int, int, int],
    step: float,
    normal_bits: int,
) -> DecodedMesh:
    """Decode the streams of ``connectivity`` and ``planes``.

    Args:
        codes, extras: of the triangles.
        position_bytes, normal_bytes: the lowest bytes (3 n or 2 n), and those of up to three planes above.
        n_vertices: n.
        extent, step: of the grid.

    Raises:
        CorruptRecordError: a code refers to what is not there, or a position lies outside the grid.
    """
    n = n_vertices
    triangles = np.empty((len(codes), 3), np.uint32)
    positions, normals = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    fault = _decode(
        codes, extras, *position_bytes, *normal_bytes, extent, step, normal_bits, triangles, positions, normals
    )
    if fault == _BAD_INDEX:
        raise CorruptRecordError("tile: its triangles refer to vertices that are not there")
    if fault == _BAD_POSITION:
        raise CorruptRecordError("tile: a position lies outside its box")
    return DecodedMesh(triangles, positions, normals)


@kernel
def _decode(  # type: ignore[no-untyped-def]
    codes, extras, position_low, position_high, normal_low, normal_high, extents, step, bits, triangles, positions,
    normals,
):  # fmt: skip
    """0, or what is wrong."""
    predictors = np.empty((positions.shape[0] + 3, 3), np.uint32)
    n_used = _walk(codes, extras, positions.shape[0], triangles, predictors)
    if n_used < 0:
        return _BAD_INDEX
    # vertices of lines and points only
    for i in range(max(n_used, 1), positions.shape[0]):
        predictors[i, :] = i - 1
    return _place(
        predictors, position_low, position_high, normal_low, normal_high, extents, step, bits, positions, normals
    )


@helper
def _walk(codes, extras, n_vertices, triangles, predictors):  # type: ignore[no-untyped-def]
    """Number of vertices that the triangles use, or -1.

    Up to three rows beyond the last vertex are written to ``predictors``, so that which corner is new needs no
    branch, which would be guessed wrongly every third time. Every corner is below the number of vertices seen so far;
    so is then all that a later vertex is predicted from.
    """
    a: Any
    b: Any
    c: Any
    at: Any
    far: Any
    n_used: Any
    ring_head: Any
    padded = np.zeros(extras.shape[0] + EXTRA_BYTES, np.uint8)
    padded[: extras.shape[0]] = extras
    first = np.full(RING, np.int64(_NOBODY))
    second = np.full(RING, np.int64(_NOBODY))
    across = np.zeros(RING, np.int64)
    ring = np.full(RING, np.int64(_NOBODY))
    edge_head, ring_head, at = np.int64(0), np.int64(0), np.int64(0)
    n_used = np.int64(0)
    far = np.int64(-1)
    wrong = np.int64(0)  # its sign bit is set once a corner is not there
    for t in range(codes.shape[0]):
        slot = np.int64(codes[t]) >> 4
        code = np.int64(codes[t]) & 15
        if slot < NO_EDGE:
            # two corners from an edge, the third coded
            edge = (edge_head - 1 - slot) & 15
            a, b = first[edge], second[edge]
            predictors[n_used, 0] = a
            predictors[n_used, 1] = b
            predictors[n_used, 2] = across[edge]
            if code < NEXT:
                is_new = np.int64(code == NEW)
                recent, oldest = ring[(ring_head - code) & 15], ring[ring_head & 15]
                c = recent + (n_used - recent) * is_new
                ring[ring_head & 15] = oldest + (c - oldest) * is_new
                ring_head += is_new
                n_used += is_new
            else:
                c, at, n_used, far, ring_head = _decode_vertex(code, padded, at, n_used, far, ring, ring_head)
        else:
            # three corners coded; a new one is predicted from the corner or the vertex before
            pair = np.int64(padded[at])
            predictors[n_used, :] = max(n_used - 1, 0)
            a, at, n_used, far, ring_head = _decode_vertex(code, padded, at + 1, n_used, far, ring, ring_head)
            wrong |= n_used - 1 - a
            predictors[n_used, :] = a
            b, at, n_used, far, ring_head = _decode_vertex(pair >> 4, padded, at, n_used, far, ring, ring_head)
            wrong |= n_used - 1 - b
            predictors[n_used, :] = b
            c, at, n_used, far, ring_head = _decode_vertex(pair & 15, padded, at, n_used, far, ring, ring_head)
            first[edge_head & 15] = b
            second[edge_head & 15] = a
            across[edge_head & 15] = c
            edge_head += 1
        wrong |= a | b | c | (n_used - 1 - a) | (n_used - 1 - b) | (n_used - 1 - c)
        if n_used > n_vertices or at > extras.shape[0]:
            return np.int64(-1)
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
    return np.int64(-1) if wrong < 0 or at != extras.shape[0] else n_used


@leaf
def _decode_vertex(  # type: ignore[no-untyped-def]
    code, extras, at, n_used, far, ring, ring_head
) -> tuple[int, int, int, int, int]:
    """(vertex, where to go on, vertices used, last far vertex, ring head); a vertex >= n_used is not there."""
    if code == NEW:
        vertex = n_used
        n_used += 1
    elif code < NEXT:
        return int(ring[(ring_head - code) & 15]), at, n_used, far, ring_head
    else:
        difference: Any = np.int64(1)
        if code == FAR:
            difference, at = read_number(extras, at)
        vertex = far + difference
        far = vertex
    ring[ring_head & 15] = vertex
    return vertex, at, n_used, far, ring_head + 1


@helper
def _place(  # type: ignore[no-untyped-def]
    predictors, position_low, position_high, normal_low, normal_high, extents, step, bits, positions, normals
):
    """Values of all vertices from those they are predicted from; 0, or what is wrong."""
    n = positions.shape[0]
    dp, do = np.empty((3, n), np.int32), np.empty((2, n), np.int32)  # differences
    for k in range(3):
        join_planes(position_low, position_high, k, 3, dp[k])
    for k in range(2):
        join_planes(normal_low, normal_high, k, 2, do[k])
    p, o = np.empty((n, 3), np.int32), np.empty((2, n), np.int32)  # values
    scale = np.float32(step)
    mask = np.int32((1 << bits) - 1)
    outside = np.int32(0)  # its sign bit is set once a position is below 0 or above the extent
    for i in range(n):
        a, b, d = np.uint64(predictors[i, 0]), np.uint64(predictors[i, 1]), np.uint64(predictors[i, 2])
        for k in range(3):
            guess = p[a, k] + p[b, k] - p[d, k] if i > 0 else np.int32(0)
            value = np.int32(min(max(guess, np.int32(0)), np.int32(extents[k])) + dp[k, i])
            outside |= value | (np.int32(extents[k]) - value)
            p[i, k] = value
            positions[i, k] = np.float32(value) * scale
        for k in range(2):
            guess = o[k, a] + o[k, b] - o[k, d] if i > 0 else np.int32(0)
            o[k, i] = np.int32(guess + do[k, i]) & mask
    to_unit_normals(o, bits, normals)
    return 0 if outside >= 0 else _BAD_POSITION
