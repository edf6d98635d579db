"""Vertex data as differences from a prediction, in planes of bytes that an entropy coder likes.

A difference is folded to an unsigned number (zigzag: 0, -1, 1, -2 … become 0, 1, 2, 3 …) and cut into
bytes. All lowest bytes come first, coordinate after coordinate, then all second bytes, and so on::

    vertex   0   1   2  …
    x      [lo][lo][lo] …  y [lo][lo][lo] …  z …  |  x [hi][hi][hi] …  y …  z …

Positions are predicted by the parallelogram a + b - d of ``connectivity``, clamped to the grid; normals
by the same sum, in the arithmetic modulo 2**bits that the octahedron's coordinates are given in.
Decoding writes float32 as a graphics card takes it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel

Bytes = npt.NDArray[np.uint8]


def encode_positions(
    steps: npt.NDArray[np.int32],
    order: npt.NDArray[np.int32],
    predictors: npt.NDArray[np.uint32],
    extent: tuple[int, int, int],
) -> Bytes:
    """(n_planes, 3, n) bytes of positions; vertex i is row ``order[i]`` of the (., 3) int32 ``steps``."""
    folded = np.empty((3, len(order)), np.uint32)
    widest = _fold_positions(steps, order, predictors, extent[0], extent[1], extent[2], folded)
    return _split(folded, int(widest))


def decode_positions(
    planes: Bytes, predictors: npt.NDArray[np.uint32], extent: tuple[int, int, int], step: float
) -> npt.NDArray[np.float32]:
    """Inverse of ``encode_positions``: (n, 3) float32 mm from the grid's origin, exact.

    Raises:
        CorruptRecordError: a position lies outside the grid.
    """
    positions = np.empty((planes.shape[2], 3), np.float32)
    if len(positions) and not _unfold_positions(planes, predictors, extent[0], extent[1], extent[2], step, positions):
        raise CorruptRecordError("tile: a position lies outside its box")
    return positions


def encode_normals(
    octahedral: npt.NDArray[np.int32], order: npt.NDArray[np.int32], predictors: npt.NDArray[np.uint32], bits: int
) -> Bytes:
    """(n_planes, 2, n) bytes of octahedral coordinates of ``bits`` bits."""
    folded = np.empty((2, len(order)), np.uint32)
    widest = _fold_octahedral(octahedral, order, predictors, bits, folded)
    return _split(folded, int(widest))


def decode_normals(planes: Bytes, predictors: npt.NDArray[np.uint32], bits: int) -> npt.NDArray[np.float32]:
    """Inverse of ``encode_normals``: (n, 3) float32 unit vectors, never NaN."""
    normals = np.empty((planes.shape[2], 3), np.float32)
    if len(normals):
        _unfold_octahedral(planes, predictors, bits, np.empty((2, planes.shape[2]), np.int32), normals)
    return normals


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


def _split(folded: npt.NDArray[np.uint32], widest: int) -> Bytes:
    """Cut (k, n) numbers into as many planes as the widest needs, at least one."""
    n_planes = max(1, (widest.bit_length() + 7) // 8)
    planes = np.empty((n_planes, *folded.shape), np.uint8)
    _cut(folded, planes)
    return planes


@helper
def _zigzag(value):  # type: ignore[no-untyped-def]
    return np.uint32((value << 1) ^ (value >> 31))


@helper
def _join(planes, k, folded):  # type: ignore[no-untyped-def]
    """The signed numbers whose folded bytes lie in the planes of coordinate k."""
    for i in range(folded.shape[0]):
        folded[i] = planes[0, k, i]
    for p in range(1, planes.shape[0]):
        for i in range(folded.shape[0]):
            folded[i] |= np.int32(planes[p, k, i]) << np.int32(8 * p)
    for i in range(folded.shape[0]):
        folded[i] = (folded[i] >> 1) ^ -(folded[i] & 1)


@kernel
def _cut(folded, planes):  # type: ignore[no-untyped-def]
    for p in range(planes.shape[0]):
        for k in range(folded.shape[0]):
            for i in range(folded.shape[1]):
                planes[p, k, i] = np.uint8(folded[k, i] >> np.uint32(8 * p))


@kernel
def _fold_positions(steps, order, predictors, extent_x, extent_y, extent_z, folded):  # type: ignore[no-untyped-def]
    """Bits that occur in any folded difference."""
    widest = np.uint32(0)
    for i in range(order.shape[0]):
        a = order[predictors[i, 0]]
        b = order[predictors[i, 1]]
        d = order[predictors[i, 2]]
        for k in range(3):
            extent = extent_x if k == 0 else (extent_y if k == 1 else extent_z)
            guess = np.int32(0)
            if i > 0:
                guess = np.int32(min(max(steps[a, k] + steps[b, k] - steps[d, k], 0), extent))
            number = _zigzag(np.int32(steps[order[i], k] - guess))
            folded[k, i] = number
            widest |= number
    return widest


@kernel
def _unfold_positions(planes, predictors, extent_x, extent_y, extent_z, step, positions):  # type: ignore[no-untyped-def]
    """False if a position lies outside the extent. Exact: fewer than 24 bits times a power of two."""
    n = positions.shape[0]
    current = np.empty((3, n), np.int32)
    for k in range(3):
        _join(planes, k, current[k])
    outside = np.int32(0)  # its sign bit is set once a position is below 0 or above the extent
    for k in range(3):
        extent = np.int32(extent_x if k == 0 else (extent_y if k == 1 else extent_z))
        line = current[k]
        outside |= line[0] | (extent - line[0])
        for i in range(1, n):
            guess = line[predictors[i, 0]] + line[predictors[i, 1]] - line[predictors[i, 2]]
            value = np.int32(min(max(guess, 0), extent) + line[i])
            outside |= value | (extent - value)
            line[i] = value
    for i in range(n):
        for k in range(3):
            positions[i, k] = np.float32(current[k, i] * step)
    return outside >= 0


@kernel
def _fold_octahedral(octahedral, order, predictors, bits, folded):  # type: ignore[no-untyped-def]
    widest = np.uint32(0)
    shift = np.int32(32 - bits)
    for i in range(order.shape[0]):
        a = order[predictors[i, 0]]
        b = order[predictors[i, 1]]
        d = order[predictors[i, 2]]
        for k in range(2):
            guess = np.int32(0)
            if i > 0:
                guess = np.int32(octahedral[a, k] + octahedral[b, k] - octahedral[d, k])
            difference = np.int32(octahedral[order[i], k] - guess)
            number = _zigzag(np.int32(np.int32(difference << shift) >> shift))
            folded[k, i] = number
            widest |= number
    return widest


@kernel
def _unfold_octahedral(planes, predictors, bits, current, normals):  # type: ignore[no-untyped-def]
    mask = np.int32((1 << bits) - 1)
    half = np.int32((1 << (bits - 1)) - 1)
    scale = np.float32(1.0) / np.float32(half)
    one = np.float32(1.0)
    n = normals.shape[0]
    for k in range(2):
        line = current[k]
        _join(planes, k, line)
        line[0] &= mask
        for i in range(1, n):
            guess = line[predictors[i, 0]] + line[predictors[i, 1]] - line[predictors[i, 2]]
            line[i] = np.int32(guess + line[i]) & mask
    for i in range(n):
        x = np.float32(current[0, i] - half) * scale
        y = np.float32(current[1, i] - half) * scale
        z = one - abs(x) - abs(y)
        under = max(-z, np.float32(0.0))
        x -= np.copysign(under, x)
        y -= np.copysign(under, y)
        length = one / np.sqrt(x * x + y * y + z * z)
        normals[i, 0] = x * length
        normals[i, 1] = y * length
        normals[i, 2] = z * length


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
