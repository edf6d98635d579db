"""Triangles and vertices of a tile in one pass: a vertex is predicted the moment its triangle is read.

The codes of ``connectivity`` say for each new vertex which three it is predicted from; positions and normals
follow at once from the differences in ``planes``, while those three are still in the first-level cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.connectivity import EXTRA_BYTES, FAR, NEW, NEXT, NO_EDGE, RING, read_number
from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel
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
    padded = np.zeros(len(extras) + EXTRA_BYTES, np.uint8)
    padded[: len(extras)] = extras
    fault = _decode(
        codes, padded, len(extras), *position_bytes, *normal_bytes, *extent, step, normal_bits,
        triangles, positions, normals,
    )  # fmt: skip
    if fault == _BAD_INDEX:
        raise CorruptRecordError("tile: its triangles refer to vertices that are not there")
    if fault == _BAD_POSITION:
        raise CorruptRecordError("tile: a position lies outside its box")
    return DecodedMesh(triangles, positions, normals)


@helper
def _place(row, first, second, third, dp, do, p, o, extents, mask):  # type: ignore[no-untyped-def]
    """Values of a vertex from those it is predicted from; the sign bit is set if it leaves the grid."""
    i, a, b, d = np.uint64(row), np.uint64(first), np.uint64(second), np.uint64(third)  # none is below 0
    outside = np.int32(0)
    for k in range(3):
        guess = p[a, k] + p[b, k] - p[d, k]
        value = np.int32(min(max(guess, np.int32(0)), extents[k]) + dp[k, i])
        outside |= value | (extents[k] - value)
        p[i, k] = value
    for k in range(2):
        o[k, i] = np.int32(o[k, a] + o[k, b] - o[k, d] + do[k, i]) & mask
    return outside


@helper
def _place_first(dp, do, p, o, extents, mask):  # type: ignore[no-untyped-def]
    """Vertex 0 has its differences as values."""
    outside = np.int32(0)
    for k in range(3):
        p[0, k] = dp[k, 0]
        outside |= p[0, k] | (extents[k] - p[0, k])
    for k in range(2):
        o[k, 0] = do[k, 0] & mask
    return outside


@helper
def _decode_vertex(code, extras, at, n_used, far, ring, ring_head):  # type: ignore[no-untyped-def]
    """(vertex, where to go on, vertices used, last far vertex, ring head); a vertex >= n_used is not there."""
    if code == NEW:
        vertex = n_used
        n_used += 1
    elif code < NEXT:
        return ring[(ring_head - code) & 15], at, n_used, far, ring_head
    else:
        difference = np.int64(1)
        if code == FAR:
            difference, at = read_number(extras, at)
        vertex = far + difference
        far = vertex
    ring[ring_head & 15] = vertex
    return vertex, at, n_used, far, ring_head + 1


@kernel
def _decode(  # type: ignore[no-untyped-def]
    codes, extras, n_extras, position_low, position_high, normal_low, normal_high,
    extent_x, extent_y, extent_z, step, bits, triangles, positions, normals,
):  # fmt: skip
    """0, or what is wrong."""
    n = positions.shape[0]
    dp, do = np.empty((3, n), np.int32), np.empty((2, n), np.int32)  # differences
    for k in range(3):
        join_planes(position_low, position_high, k, 3, dp[k])
    for k in range(2):
        join_planes(normal_low, normal_high, k, 2, do[k])
    p, o = np.empty((n, 3), np.int32), np.empty((2, n), np.int32)  # values
    extents = (np.int32(extent_x), np.int32(extent_y), np.int32(extent_z))
    mask = np.int32((1 << bits) - 1)
    first = np.full(RING, np.int64(_NOBODY))
    second = np.full(RING, np.int64(_NOBODY))
    across = np.zeros(RING, np.int64)
    ring = np.full(RING, np.int64(_NOBODY))
    edge_head, ring_head, at = 0, 0, 0
    n_used = np.int64(0)
    far = np.int64(-1)
    outside = np.int32(0)  # its sign bit is set once a position is below 0 or above the extent
    if n > 0:
        outside = _place_first(dp, do, p, o, extents, mask)
    for t in range(codes.shape[0]):
        slot = np.int64(codes[t]) >> 4
        code = np.int64(codes[t]) & 15
        if slot < NO_EDGE:
            # two corners from an edge, the third coded
            edge = (edge_head - 1 - slot) & 15
            a = first[edge]
            b = second[edge]
            if code == NEW:
                c = n_used
                if c >= n or a >= n_used:
                    return _BAD_INDEX
                outside |= _place(c, a, b, across[edge], dp, do, p, o, extents, mask)
                n_used += 1
                ring[ring_head & 15] = c
                ring_head += 1
            elif code < NEXT:
                c = ring[(ring_head - code) & 15]
            else:
                c, at, n_used, far, ring_head = _decode_vertex(code, extras, at, n_used, far, ring, ring_head)
        else:
            # three corners coded; a new one is predicted from the corner or the vertex before
            before = n_used
            pair = np.int64(extras[at])
            a, at, n_used, far, ring_head = _decode_vertex(code, extras, at + 1, n_used, far, ring, ring_head)
            middle = n_used
            b, at, n_used, far, ring_head = _decode_vertex(pair >> 4, extras, at, n_used, far, ring, ring_head)
            last = n_used
            c, at, n_used, far, ring_head = _decode_vertex(pair & 15, extras, at, n_used, far, ring, ring_head)
            if n_used > n or min(a, b) < 0 or max(a, b) >= n_used:
                return _BAD_INDEX
            if middle > before > 0:
                outside |= _place(before, before - 1, before - 1, before - 1, dp, do, p, o, extents, mask)
            if last > middle:
                outside |= _place(middle, a, a, a, dp, do, p, o, extents, mask)
            if n_used > last:
                outside |= _place(last, b, b, b, dp, do, p, o, extents, mask)
            first[edge_head & 15] = b
            second[edge_head & 15] = a
            across[edge_head & 15] = c
            edge_head += 1
        if min(a, b, c) < 0 or max(a, b, c) >= n_used or at > n_extras:
            return _BAD_INDEX
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
    if at != n_extras:
        return _BAD_INDEX
    # vertices of lines and points only
    rest = n_used if n_used > 0 else np.int64(1)
    while rest < n:
        outside |= _place(rest, rest - 1, rest - 1, rest - 1, dp, do, p, o, extents, mask)
        rest += 1
    scale = np.float32(step)
    for i in range(n):
        for k in range(3):
            positions[i, k] = np.float32(p[i, k]) * scale
    to_unit_normals(o, bits, normals)
    return 0 if outside >= 0 else _BAD_POSITION
