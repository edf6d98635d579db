"""Vertex data as differences from a prediction, in planes of bytes that an entropy coder likes.

A difference is folded to an unsigned number (zigzag: 0, -1, 1, -2 … become 0, 1, 2, 3 …) and cut into
bytes. All lowest bytes come first, coordinate after coordinate, then all second bytes, and so on::

    vertex   0   1   2  …
    x      [lo][lo][lo] …  y [lo][lo][lo] …  z …  |  x [hi][hi][hi] …  y …  z …

Positions are predicted by the parallelogram a + b - d of ``connectivity``, clamped to the grid; normals
by the same sum, in the arithmetic modulo 2**bits that the octahedron's coordinates are given in.
``mesh_decoder`` turns them back into float32 as a graphics card takes it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel

Bytes = npt.NDArray[np.uint8]

MAX_PLANES = 4  # of 32-bit numbers


def encode_vertices(
    steps: npt.NDArray[np.int32],
    octahedral: npt.NDArray[np.int32],
    order: npt.NDArray[np.int32],
    predictors: npt.NDArray[np.int32],
    extent: tuple[int, int, int],
    bits: int,
) -> tuple[Bytes, Bytes]:
    """(planes, 3, n) bytes of positions and (planes, 2, n) of normals, as few planes as their numbers need.

    Args:
        steps: (m, 3) int32, places on the grid.
        octahedral: (m, 2) int32 coordinates of the normals, of ``bits`` bits.
        order: (n,) row in both of each vertex.
        predictors: (n, 3) rows in both of what it is predicted from.
        extent: of the grid.
        bits: of a normal's coordinate.
    """
    n = len(order)
    positions, normals = np.empty((MAX_PLANES, 3 * n), np.uint8), np.empty((MAX_PLANES, 2 * n), np.uint8)
    n_positions, n_normals = _fold_vertices(steps, octahedral, order, predictors, extent, bits, positions, normals)
    return positions[:n_positions].reshape(n_positions, 3, n), normals[:n_normals].reshape(n_normals, 2, n)


def encode_numbers(numbers: npt.NDArray[np.uint32], expected_step: int) -> Bytes:
    """A list of numbers as variable-length bytes of their zigzag differences less ``expected_step``."""
    stream = np.empty(5 * len(numbers), np.uint8)
    if not len(numbers):
        return stream
    return stream[: _write_numbers(numbers, expected_step, stream)]


def decode_numbers(stream: Bytes, count: int, expected_step: int, limit: int, what: str) -> npt.NDArray[np.uint32]:
    """Inverse of ``encode_numbers``; all must be below ``limit``.

    Raises:
        CorruptRecordError: too short, too long, or a number is out of range.
    """
    numbers = np.empty(count if count <= len(stream) else 0, np.uint32)
    if len(numbers) != count or not _read_numbers(stream, expected_step, limit, numbers):
        raise CorruptRecordError(f"tile: the numbers of its {what} are damaged or not below {limit}")
    return numbers


@helper
def join_planes(low, high, k, width, values):  # type: ignore[no-untyped-def]
    """The signed numbers (n,) of coordinate k of ``width`` from the lowest bytes and the planes above them."""
    n = values.shape[0]
    first = low[k * n : (k + 1) * n]
    stride = width * n
    n_high = high.shape[0] // max(stride, 1)
    # one loop a number of planes: each runs in vector registers
    if n_high == 0:
        for i in range(n):
            folded = np.int32(first[i])
            values[i] = (folded >> 1) ^ -(folded & 1)
        return
    second = high[k * n : (k + 1) * n]
    if n_high == 1:
        for i in range(n):
            folded = np.int32(first[i]) | np.int32(second[i]) << np.int32(8)
            values[i] = (folded >> 1) ^ -(folded & 1)
        return
    third = high[stride + k * n : stride + (k + 1) * n]
    for i in range(n):
        values[i] = np.int32(first[i]) | np.int32(second[i]) << np.int32(8) | np.int32(third[i]) << np.int32(16)
    if n_high == 3:
        fourth = high[2 * stride + k * n : 2 * stride + (k + 1) * n]
        for i in range(n):
            values[i] |= np.int32(fourth[i]) << np.int32(24)
    for i in range(n):
        values[i] = (values[i] >> 1) ^ -(values[i] & 1)


@helper
def _planes_of(differences, bits, planes):  # type: ignore[no-untyped-def]
    """Cut (k, n) differences modulo 2**bits, zigzagged, into (4, k n) bytes; number of planes needed, at least one."""
    n = differences.size
    flat = differences.reshape(-1)
    folded = np.empty(n, np.uint32)
    shift = np.int32(32 - bits)
    widest = np.uint32(0)
    for i in range(n):
        value = np.int32(flat[i] << shift) >> shift
        number = np.uint32(np.int32(value << np.int32(1)) ^ (value >> np.int32(31)))
        folded[i] = number
        widest |= number
    n_planes = 1
    while n_planes < MAX_PLANES and widest >> np.uint32(8 * n_planes) > 0:
        n_planes += 1
    for p in range(n_planes):
        plane = planes[p]
        for i in range(n):
            plane[i] = np.uint8(folded[i] >> np.uint32(8 * p))
    return n_planes


@kernel
def _fold_vertices(  # type: ignore[no-untyped-def]
    steps, octahedral, order, predictors, extents, bits, position_planes, normal_planes
):
    """Number of planes of the positions and of the normals."""
    n = order.shape[0]
    moved, turned = np.empty((3, n), np.int32), np.empty((2, n), np.int32)
    for i in range(n):
        own, a = np.uint32(order[i]), np.uint32(predictors[i, 0])
        b, d = np.uint32(predictors[i, 1]), np.uint32(predictors[i, 2])
        known = np.int32(i > 0)  # nothing comes before vertex 0: its guess is 0
        for k in range(3):
            guess = np.int32(steps[a, k] + steps[b, k] - steps[d, k]) * known
            moved[k, i] = steps[own, k] - min(max(guess, np.int32(0)), np.int32(extents[k]))
        for k in range(2):
            guess = np.int32(octahedral[a, k] + octahedral[b, k] - octahedral[d, k]) * known
            turned[k, i] = octahedral[own, k] - guess
    return _planes_of(moved, 32, position_planes), _planes_of(turned, bits, normal_planes)


@helper
def to_unit_normals(octahedral, bits, normals):  # type: ignore[no-untyped-def]
    """(n, 3) float32 unit vectors of (2, n) coordinates, never NaN."""
    half = np.int32((1 << (bits - 1)) - 1)
    scale = np.float32(1.0) / np.float32(half)
    one = np.float32(1.0)
    n = normals.shape[0]
    xyz = np.empty((3, n), np.float32)  # first coordinate by coordinate: in vector registers
    for i in range(n):
        x = np.float32(octahedral[0, i] - half) * scale
        y = np.float32(octahedral[1, i] - half) * scale
        z = one - abs(x) - abs(y)
        under = max(-z, np.float32(0.0))
        x -= np.copysign(under, x)
        y -= np.copysign(under, y)
        length = one / np.sqrt(x * x + y * y + z * z)
        xyz[0, i] = x * length
        xyz[1, i] = y * length
        xyz[2, i] = z * length
    for i in range(n):
        normals[i, 0] = xyz[0, i]
        normals[i, 1] = xyz[1, i]
        normals[i, 2] = xyz[2, i]


@kernel
def _write_numbers(numbers, expected_step, stream):  # type: ignore[no-untyped-def]
    at = 0
    previous = np.int64(-1)
    for number in numbers:
        difference = np.int64(number) - previous - expected_step
        rest = (difference << 1) ^ (difference >> 63)
        while rest > 127:
            stream[at] = np.uint8(rest & 127 | 128)
            rest >>= 7
            at += 1
        stream[at] = np.uint8(rest)
        at += 1
        previous = np.int64(number)
    return at


@kernel
def _read_numbers(stream, expected_step, limit, numbers):  # type: ignore[no-untyped-def]
    """False unless the stream holds exactly these numbers, all in range."""
    at = 0
    previous = np.int64(-1)
    for i in range(numbers.shape[0]):
        rest = np.int64(0)
        for k in range(5):
            if at >= stream.shape[0]:
                return False
            byte = np.int64(stream[at])
            at += 1
            rest |= (byte & 127) << (7 * k)
            if byte < 128:
                break
        previous += expected_step + ((rest >> 1) ^ -(rest & 1))
        if previous < 0 or previous >= limit:
            return False
        numbers[i] = previous
    return at == stream.shape[0]
