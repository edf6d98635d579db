"""Tiles: the geometry of a node or of a surface's level of detail as one short, checked byte string.

Layout, little-endian (see FORMAT.md for the streams)::

      0  4  magic "NTIL"             28  4  length of the whole tile, bytes
      4  2  version                  32 24  origin, 3 float64, mm: a multiple of the step
      6  1  bits a position          56 12  extent in steps, 3 u32: the box of the positions
      7  1  bits a normal            68  4  zero
      8  2  step = 2**(this i16) mm  72 48  ledger, 6 float64, mm
     10  1  number of streams       120  .  12 bytes per stream: id u8, coder u8, planes u8, zero,
     11  1  zero                            length u32, stored length u32
     12 16  vertices, triangles,      .  .  the streams' stored bytes in the same order
            lines, points: 4 u32      .  4  crc32 of everything before
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.entropy import NO_BYTES, Bytes, decode_stream, encode_stream
from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.ledger import Ledger
from nurbs_cache.mesh_decoder import decode_mesh
from nurbs_cache.planes import decode_numbers, encode_numbers, encode_vertices
from nurbs_cache.primitives import Indices, drop_degenerate, order_vertices
from nurbs_cache.quantise import (
    MAX_NORMAL_BITS,
    MAX_POSITION_BITS,
    MIN_EXPONENT,
    MIN_NORMAL_BITS,
    MIN_POSITION_BITS,
    Grid,
    box_of,
    choose_grid,
    quantise_normals,
    quantise_positions,
)

MAGIC = b"NTIL"
VERSION = 1
_HEAD = struct.Struct("<4sHBBhBBIIIII3d3II48s")
_ENTRY = struct.Struct("<BBBBII")
_CRC = struct.Struct("<I")
_MIN_BYTES = _HEAD.size + _CRC.size

CODES, EXTRAS, LINES, POINTS = 1, 2, 3, 4
POSITIONS, POSITIONS_HIGH, NORMALS, NORMALS_HIGH = 8, 9, 10, 11
FIRST_ATTRIBUTE = 32  # streams from here on are attributes of the vertices
N_ATTRIBUTES = 64
_MAX_VERTICES = 1 << 28
_FAR = 2.0**80  # mm; beyond every coordinate that is taken


@dataclass(frozen=True, eq=False)
class TileContent:
    """What a tile is made of, in the tile's space: assembly mm of nodes, surface mm of levels of detail.

    Attributes:
        positions: (n, 3) float64, mm.
        normals: (n, 3) float32, unit.
        triangles: (t, 3) uint32 rows in ``positions``, counter-clockwise from outside.
        lines: (l, 2) uint32; points: (p,) uint32, likewise.
        ledger: the error terms; ``quantisation`` and ``float32`` are filled in by ``encode_tile``.
        attributes: further numbers of every vertex, (n,) uint32 each, by an id from 0 to 63.
    """

    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.uint32]
    lines: npt.NDArray[np.uint32]
    points: npt.NDArray[np.uint32]
    ledger: Ledger = field(default_factory=Ledger)
    attributes: Mapping[int, npt.NDArray[np.uint32]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class DecodedTile:
    """A tile as a graphics card takes it: contiguous arrays, vertices in the order of their first use.

    Attributes:
        origin: (3,) float64, mm; add it to ``positions`` in float64.
        positions: (n, 3) float32, mm from the origin, exact multiples of ``step``.
        normals: (n, 3) float32, unit.
        triangles: (t, 3) uint32; lines: (l, 2) uint32; points: (p,) uint32.
        ledger: all six terms, mm.
        step: distance of grid points, mm, a power of two.
        aabb_min, aabb_max: (3,) float64, mm: the box of the positions.
        attributes: (n,) uint32 each, by id.
    """

    origin: npt.NDArray[np.float64]
    positions: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.uint32]
    lines: npt.NDArray[np.uint32]
    points: npt.NDArray[np.uint32]
    ledger: Ledger
    step: float
    aabb_min: npt.NDArray[np.float64]
    aabb_max: npt.NDArray[np.float64]
    attributes: dict[int, npt.NDArray[np.uint32]]


class _Head(NamedTuple):
    normal_bits: int
    n_vertices: int
    n_triangles: int
    n_lines: int
    n_points: int
    grid: Grid
    ledger: Ledger


class _Stream(NamedTuple):
    codec: int
    planes: int
    length: int
    stored: memoryview

    def decode(self) -> Bytes:
        return decode_stream(self.stored, self.codec, self.length) if self.length else NO_BYTES


_ABSENT = _Stream(0, 0, 0, memoryview(b""))


def encode_tile(
    content: TileContent,
    *,
    position_bits: int = 16,
    normal_bits: int = 10,
    codec: str = "zstd",
    reorder: bool = True,
    min_step_exponent: int = MIN_EXPONENT,
) -> bytes:
    """The bytes of a tile; equal content gives equal bytes.

    Vertices that nothing uses are left out. Triangles and lines that quantisation makes degenerate are
    dropped; where nothing else covers them, a line or a point stays. The ledger's ``quantisation`` is the
    measured largest displacement, rounded up; ``float32`` is 0, since grid positions are exact in float32.

    Args:
        position_bits: at most so many bits a coordinate, 8 to 21.
        normal_bits: bits of each of the two octahedral coordinates, 8 to 12.
        codec: entropy coder of the streams, "zstd", "huffman" or "plain" (none).
        reorder: let each triangle continue from a recent one: 5.2 instead of 7.4 bytes a triangle on trimmed
            CAD faces and a faster decoding, for 40 ns a triangle; what is in strips already gains nothing.
        min_step_exponent: the grid's step is at least 2**min_step_exponent mm. Tiles of equal step share
            one grid: equal positions in them stay equal.

    Raises:
        UsageError: arrays do not fit one another, a number is not finite, or an option is out of range.
    """
    positions, normals, triangles, lines, points = _checked(content)
    box = box_of(positions) if len(positions) else np.zeros((2, 3))
    grid = choose_grid(box[0], box[1], position_bits, min_step_exponent)
    steps, moved = quantise_positions(positions, grid)
    octahedral = quantise_normals(normals, normal_bits)
    triangles, lines, points = drop_degenerate(steps, triangles, lines, points)
    kept = order_vertices(len(positions), triangles, lines, points, walk=reorder)
    position_planes, normal_planes = encode_vertices(
        steps, octahedral, kept.order, kept.predictors, grid.extent, normal_bits
    )
    streams = [
        (CODES, 1, kept.codes),
        (EXTRAS, 1, kept.extras),
        (LINES, 1, encode_numbers(kept.lines.reshape(-1), 0)),
        (POINTS, 1, encode_numbers(kept.points, 1)),
        (POSITIONS, 1, position_planes[0]),
        (POSITIONS_HIGH, len(position_planes) - 1, position_planes[1:]),
        (NORMALS, 1, normal_planes[0]),
        (NORMALS_HIGH, len(normal_planes) - 1, normal_planes[1:]),
    ]
    for number in sorted(content.attributes):
        values = np.ascontiguousarray(content.attributes[number], np.uint32)[kept.order]
        streams.append((FIRST_ATTRIBUTE + number, 1, encode_numbers(values, 0)))
    terms = content.ledger
    ledger = Ledger(terms.surface, terms.trim, terms.pcurve, terms.cluster, moved, 0.0)
    head = _Head(normal_bits, len(kept.order), len(kept.codes), len(kept.lines), len(kept.points), grid, ledger)
    return _assemble(head, position_bits, streams, codec)


def decode_tile(data: bytes | memoryview) -> DecodedTile:
    """Inverse of ``encode_tile``; every count, length and index is checked.

    Raises:
        CorruptRecordError: truncated, damaged, foreign or of a newer version.
    """
    head, streams = _parse(data)
    n = head.n_vertices
    position_bytes = _vertex_bytes(streams, POSITIONS, 3, n)
    normal_bytes = _vertex_bytes(streams, NORMALS, 2, n)
    codes, extras = (streams.get(number, _ABSENT).decode() for number in (CODES, EXTRAS))
    if len(codes) != head.n_triangles:
        raise CorruptRecordError(f"tile: {len(codes)} triangle codes, its header says {head.n_triangles}")
    grid = head.grid
    mesh = decode_mesh(codes, extras, position_bytes, normal_bytes, n, grid.extent, grid.step, head.normal_bits)
    lines = _numbers(streams.get(LINES, _ABSENT), 2 * head.n_lines, 0, n, "lines")
    points = _numbers(streams.get(POINTS, _ABSENT), head.n_points, 1, n, "points")
    origin = np.array(grid.origin)
    return DecodedTile(
        origin=origin,
        positions=mesh.positions,
        normals=mesh.normals,
        triangles=mesh.triangles,
        lines=lines.reshape(-1, 2),
        points=points,
        ledger=head.ledger,
        step=grid.step,
        aabb_min=origin,
        aabb_max=origin + np.array(grid.extent) * grid.step,
        attributes={
            number - FIRST_ATTRIBUTE: decode_numbers(stream.decode(), n, 0, 1 << 32, "attributes")
            for number, stream in streams.items()
            if number >= FIRST_ATTRIBUTE
        },
    )


def tile_hash(data: bytes | memoryview) -> str:
    """The name of a tile: 32 hex characters, blake2b-128 of its bytes."""
    return hashlib.blake2b(data, digest_size=16).hexdigest()


def check_tile(data: bytes | memoryview, what: str = "tile") -> None:
    """Magic, version, length and checksum of a tile, without decoding it.

    Raises:
        CorruptRecordError: one line that starts with ``what``.
    """
    if len(data) < _MIN_BYTES:
        raise CorruptRecordError(f"{what}: {len(data)} bytes, a tile has at least {_MIN_BYTES}")
    magic, version = struct.unpack_from("<4sH", data)
    if magic != MAGIC:
        raise CorruptRecordError(f"{what}: starts with {magic!r}, not with {MAGIC!r}")
    if version != VERSION:
        raise CorruptRecordError(f"{what}: tile version {version}, this program reads {VERSION}")
    (length,) = struct.unpack_from("<I", data, 28)
    if length != len(data):
        raise CorruptRecordError(f"{what}: {len(data)} bytes, its header says {length}")
    if zlib.crc32(memoryview(data)[:-4]) != _CRC.unpack_from(data, length - 4)[0]:
        raise CorruptRecordError(f"{what}: checksum does not match")


def tile_ledger(data: bytes | memoryview) -> Ledger:
    """The ledger of a checked tile, without decoding its geometry."""
    return Ledger.from_bytes(memoryview(data)[72 : 72 + Ledger.SIZE])


def tile_counts(data: bytes | memoryview) -> tuple[int, int, int, int]:
    """Vertices, triangles, lines and points of a checked tile, without decoding its geometry."""
    vertices, triangles, lines, points = struct.unpack_from("<4I", data, 12)
    return vertices, triangles, lines, points


def _checked(
    content: TileContent,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32], Indices, Indices, Indices]:
    """The arrays of ``content``, contiguous and in their types."""
    positions = np.ascontiguousarray(content.positions, np.float64)
    normals = np.ascontiguousarray(content.normals, np.float32)
    triangles, lines, points = (
        np.ascontiguousarray(a, np.uint32) for a in (content.triangles, content.lines, content.points)
    )
    n = len(positions)
    shapes = positions.shape, normals.shape, triangles.shape[1:], lines.shape[1:], points.shape[1:]
    if shapes != ((n, 3), (n, 3), (3,), (2,), ()):
        raise UsageError(f"tile: arrays of shapes {shapes}, want (n, 3), (n, 3), (t, 3), (l, 2), (p,)")
    if n > _MAX_VERTICES:
        raise UsageError(f"tile: {n} vertices, at most {_MAX_VERTICES}")
    for number, values in content.attributes.items():
        if not 0 <= number < N_ATTRIBUTES or np.shape(values) != (n,):
            raise UsageError(f"tile: attribute {number} of shape {np.shape(values)}, want id 0 to 63 and ({n},)")
    return positions, normals, triangles, lines, points


def _assemble(head: _Head, position_bits: int, streams: list[tuple[int, int, Bytes]], codec: str) -> bytes:
    """Header, entries, coded streams and checksum; empty streams are left out."""
    entries, bodies = [], []
    for number, planes, stream in streams:
        if stream.size:
            coder, body = encode_stream(stream.reshape(-1), codec)
            entries.append(_ENTRY.pack(number, coder, planes, 0, stream.size, len(body)))
            bodies.append(body)
    length = _MIN_BYTES + _ENTRY.size * len(entries) + sum(map(len, bodies))
    packed = _HEAD.pack(
        MAGIC, VERSION, position_bits, head.normal_bits, head.grid.exponent, len(entries), 0,
        head.n_vertices, head.n_triangles, head.n_lines, head.n_points, length,
        *head.grid.origin, *head.grid.extent, 0, head.ledger.to_bytes(),
    )  # fmt: skip
    data = b"".join((packed, *entries, *bodies))
    return data + _CRC.pack(zlib.crc32(data))


def _parse(data: bytes | memoryview) -> tuple[_Head, dict[int, _Stream]]:
    """Header and streams, checked as far as that goes without decoding the streams."""
    check_tile(data)
    view = memoryview(data)
    (_, _, position_bits, normal_bits, exponent, n_streams, zero, *numbers) = _HEAD.unpack_from(view)
    counts, origin, extent = numbers[:4], numbers[5:8], numbers[8:11]
    step = 2.0**exponent if -1022 <= exponent <= 1000 else 0.0
    if (
        not MIN_POSITION_BITS <= position_bits <= MAX_POSITION_BITS
        or not MIN_NORMAL_BITS <= normal_bits <= MAX_NORMAL_BITS
        or not (abs(origin[0]) < _FAR and abs(origin[1]) < _FAR and abs(origin[2]) < _FAR)
        or max(extent) >= 1 << position_bits
        or not MIN_EXPONENT <= exponent <= 64
        or zero
        or numbers[11]
    ):
        raise CorruptRecordError("tile: its header is out of range")
    base = (origin[0] / step, origin[1] / step, origin[2] / step)
    grid = Grid(exponent, base, (extent[0], extent[1], extent[2]))
    head = _Head(normal_bits, counts[0], counts[1], counts[2], counts[3], grid, Ledger.from_bytes(numbers[12]))
    return head, _streams(view, n_streams)


def _streams(view: memoryview, n_streams: int) -> dict[int, _Stream]:
    """The streams of a tile by id."""
    start = _HEAD.size + n_streams * _ENTRY.size
    end = len(view) - _CRC.size
    streams: dict[int, _Stream] = {}
    for i in range(n_streams):
        if start > end:
            break
        number, coder, planes, _, length, stored = _ENTRY.unpack_from(view, _HEAD.size + i * _ENTRY.size)
        streams[number] = _Stream(coder, planes, length, view[start : start + stored])
        start += stored
    if start != end or len(streams) != n_streams:
        raise CorruptRecordError("tile: its streams do not fill it")
    return streams


def _numbers(stream: _Stream, count: int, expected_step: int, limit: int, what: str) -> Indices:
    """The numbers of a stream; most tiles have neither lines nor points."""
    if stream is _ABSENT and not count:
        return np.empty(0, np.uint32)
    return decode_numbers(stream.decode(), count, expected_step, limit, what)


def _vertex_bytes(streams: dict[int, _Stream], number: int, width: int, n: int) -> tuple[Bytes, Bytes]:
    """The stream of lowest bytes and that of the planes above it."""
    low, high = streams.get(number, _ABSENT), streams.get(number + 1, _ABSENT)
    if low.length != width * n or high.length != high.planes * width * n or high.planes > 3:
        raise CorruptRecordError(f"tile: {low.length} and {high.length} bytes of vertex data for {n} vertices")
    return low.decode(), high.decode()
