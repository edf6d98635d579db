"""Tiles: round trips within the ledger, degenerate primitives, damaged bytes."""

from __future__ import annotations

import dataclasses
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.ledger import Ledger
from nurbs_cache.mesh_decoder import decode_mesh
from nurbs_cache.quantise import normal_error_deg
from nurbs_cache.tile import DecodedTile, TileContent, check_tile, decode_tile, encode_tile, tile_hash, tile_ledger
from nurbs_cache.triangle_walk import walk_triangles
from tests.cache.makers import content, wavy_grid

CODECS = ["zstd", "huffman", "plain"]


@st.composite
def contents(draw: st.DrawFn) -> TileContent:
    """Any mesh at all, with repeated positions, at any scale."""
    n = draw(st.integers(0, 30))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    scale, far = 10.0 ** draw(st.integers(-6, 6)), 10.0 ** draw(st.integers(-3, 7))
    places = random.normal(size=(max(n // 2, 1), 3)) * scale + far
    positions = places[random.integers(0, len(places), n)] + draw(st.sampled_from([0.0, 1e-7])) * random.random((n, 3))
    normals = random.normal(size=(n, 3)).astype(np.float32)
    counts = [draw(st.integers(0, 40)) if n else 0 for _ in range(3)]
    triangles, lines, points = (
        random.integers(0, max(n, 1), (count, width)).astype(np.uint32)
        for count, width in zip(counts, (3, 2, 1), strict=True)
    )
    attributes = {5: random.integers(0, 2**32, n).astype(np.uint32)} if draw(st.booleans()) else {}
    return TileContent(positions, normals, triangles, lines, points.reshape(-1), Ledger(surface=0.25), attributes)


def placed(tile: DecodedTile) -> np.ndarray:
    """Positions in the tile's space, float64."""
    return tile.origin + tile.positions.astype(np.float64)


def match(tile: DecodedTile, original: TileContent) -> None:
    """Every original primitive has a decoded one, in order, within the quantisation term."""
    bound = tile.ledger.quantisation
    where = placed(tile)
    for new, old in ((tile.triangles, original.triangles), (tile.lines, original.lines)):
        assert len(new) == len(old)
        for a, b in zip(new, old, strict=True):
            turns = [np.roll(b, -k) for k in range(len(b) if len(b) == 3 else 1)]
            distance = [np.linalg.norm(where[a] - original.positions[turn], axis=1).max() for turn in turns]
            assert min(distance) <= bound * (1 + 1e-9)
    old_points = original.positions[original.points]
    if len(old_points):
        assert np.linalg.norm(where[tile.points] - old_points, axis=1).max() <= bound * (1 + 1e-9)


@pytest.mark.kernel
@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize(("rows", "columns"), [(2, 2), (2, 50), (17, 23)])
def test_round_trip(rows: int, columns: int, codec: str) -> None:
    original = content(rows, columns)
    data = encode_tile(original, codec=codec, reorder=False)
    tile = decode_tile(data)
    match(tile, original)
    assert len(tile.positions) == rows * columns
    assert tile.ledger == dataclasses.replace(original.ledger, quantisation=tile.ledger.quantisation)
    assert tile_ledger(data) == tile.ledger
    assert 0.0 < tile.ledger.quantisation < 0.01
    assert (placed(tile) >= tile.aabb_min).all() and (placed(tile) <= tile.aabb_max).all()
    assert [a.dtype for a in (tile.positions, tile.normals, tile.triangles)] == [np.float32, np.float32, np.uint32]


@settings(deadline=None, max_examples=150)
@given(contents(), st.integers(8, 21), st.integers(8, 12), st.sampled_from(CODECS), st.booleans())
def test_any_content(original: TileContent, position_bits: int, normal_bits: int, codec: str, reorder: bool) -> None:
    options: dict[str, Any] = {"position_bits": position_bits, "normal_bits": normal_bits, "codec": codec}
    options["reorder"] = reorder
    data = encode_tile(original, **options)
    assert data == encode_tile(original, **options)
    tile = decode_tile(data)
    assert tile.ledger.surface == 0.25
    where = placed(tile)
    assert (tile.positions == np.rint(tile.positions / tile.step) * tile.step).all()
    used = np.concatenate([tile.triangles.reshape(-1), tile.lines.reshape(-1), tile.points])
    assert (np.unique(used) == np.arange(len(tile.positions))).all()
    if len(tile.triangles):
        corners = where[tile.triangles]
        assert (corners != np.roll(corners, 1, axis=1)).any(axis=2).all()
    assert np.isfinite(tile.normals).all()
    if len(where):
        assert np.abs(np.linalg.norm(tile.normals, axis=1) - 1.0).max() < 1e-6
    # what was covered stays covered: every corner used has a vertex within the quantisation term
    corners = [original.triangles.reshape(-1), original.lines.reshape(-1), original.points]
    for vertex in np.unique(np.concatenate(corners)):
        nearest = np.linalg.norm(where - original.positions[vertex], axis=1).min()
        assert nearest <= tile.ledger.quantisation * (1 + 1e-9)


def test_equal_positions_stay_equal() -> None:
    positions, normals, triangles = wavy_grid(5, 5)
    doubled = TileContent(
        np.concatenate([positions, positions]),
        np.concatenate([normals, -normals]),
        np.concatenate([triangles, triangles[:, ::-1] + 25]).astype(np.uint32),
        np.zeros((0, 2), np.uint32),
        np.zeros(0, np.uint32),
    )
    where = decode_tile(encode_tile(doubled)).positions
    assert len(np.unique(where, axis=0)) == 25
    assert len(where) == 50


def test_normals_and_attributes_follow_their_vertices() -> None:
    original = dataclasses.replace(
        content(9, 9), attributes={0: np.arange(81, dtype=np.uint32), 63: np.full(81, 2**32 - 1)}
    )
    shuffled = dataclasses.replace(original, triangles=original.triangles[::-1].copy())
    tile = decode_tile(encode_tile(shuffled))
    old = tile.attributes[0].astype(int)
    assert sorted(old) == list(range(81))
    assert (tile.attributes[63] == 2**32 - 1).all()
    assert np.abs(placed(tile) - original.positions[old]).max() <= tile.ledger.quantisation
    cosine = (tile.normals * original.normals[old]).sum(axis=1)
    assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() <= normal_error_deg(10) + 0.05


@pytest.mark.kernel
def test_order_of_triangles_is_free_but_they_stay_the_same() -> None:
    random = np.random.default_rng(3)
    for triangles in (
        random.permutation(content(9, 9).triangles),
        random.integers(0, 81, (200, 3)).astype(np.uint32),  # not manifold, with doubles
        content(9, 9).triangles[:0],
    ):
        first, again = _walked(triangles), _walked(triangles)
        assert _turned(first) == _turned(triangles)
        assert (first == again).all()


def _walked(triangles: np.ndarray) -> np.ndarray:
    """Coded by the walk, decoded, in old numbers."""
    labels, order = np.full(81, -1, np.int32), np.empty(81, np.int32)
    codes, extras, n_used = walk_triangles(triangles, labels, order, np.empty((81, 3), np.int32))
    assert (np.sort(order[:n_used]) == np.unique(triangles)).all()
    flat, none = np.zeros(3 * n_used, np.uint8), np.zeros(0, np.uint8)
    mesh = decode_mesh(codes, extras, (flat, none), (flat[: 2 * n_used], none), n_used, (0, 0, 0), 1.0, 10)
    return order[mesh.triangles]


def _turned(triangles: np.ndarray) -> list[list[int]]:
    """In a fixed order, the smallest corner first."""
    rows = [list(map(int, row)) for row in triangles]
    return sorted(row[k:] + row[:k] for row in rows for k in [row.index(min(row))])


def test_walking_order_takes_fewer_bytes() -> None:
    sheet = content(30, 30)
    mixed = dataclasses.replace(sheet, triangles=np.random.default_rng(4).permutation(sheet.triangles))
    assert len(encode_tile(mixed)) < 1.2 * len(encode_tile(sheet))
    assert len(encode_tile(mixed)) < 0.5 * len(encode_tile(mixed, reorder=False))


def test_orientation_is_kept() -> None:
    positions, normals, triangles = wavy_grid(6, 6)
    tile = decode_tile(encode_tile(dataclasses.replace(content(6, 6), triangles=triangles)))
    a, b, c = (placed(tile)[tile.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert len(positions) == len(normals)


# empty and degenerate


EMPTY = TileContent(
    np.zeros((0, 3)),
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.uint32),
    np.zeros((0, 2), np.uint32),
    np.zeros(0, np.uint32),
)


def test_empty() -> None:
    tile = decode_tile(encode_tile(EMPTY))
    assert [len(a) for a in (tile.positions, tile.normals, tile.triangles, tile.lines, tile.points)] == [0] * 5
    assert tile.ledger == Ledger()


def test_points_only() -> None:
    random = np.random.default_rng(1)
    positions = random.random((500, 3)) * 70.0
    points = np.arange(500, dtype=np.uint32)
    original = dataclasses.replace(EMPTY, positions=positions, normals=np.ones((500, 3), np.float32), points=points)
    tile = decode_tile(encode_tile(original))
    match(tile, original)
    assert (tile.points == points).all()


def test_unused_vertices_are_left_out() -> None:
    original = dataclasses.replace(content(4, 4), triangles=np.array([[5, 6, 10]], np.uint32))
    assert len(decode_tile(encode_tile(original)).positions) == 3 + 4


def flat_content(positions: list[list[float]], triangles: list[list[int]]) -> TileContent:
    """Triangles of a 1000 mm tile whose grid at 8 bits has steps of 4 mm."""
    corners = [[0.0, 0.0, 0.0], [1000.0, 1000.0, 1000.0], [1000.0, 0.0, 0.0]]
    n = len(positions)
    return dataclasses.replace(
        EMPTY,
        positions=np.array(positions + corners),
        normals=np.ones((n + 3, 3), np.float32),
        triangles=np.array([*triangles, [n, n + 1, n + 2]], np.uint32),
    )


@pytest.mark.kernel
def test_triangle_that_becomes_a_segment_leaves_a_line() -> None:
    tile = decode_tile(
        encode_tile(flat_content([[500, 500, 500], [500.1, 500, 500], [600, 500, 500]], [[0, 1, 2]]), position_bits=8)
    )
    assert len(tile.triangles) == 1
    assert placed(tile)[tile.lines].tolist() == [[[500, 500, 500], [600, 500, 500]]]


def test_triangle_that_becomes_a_point_leaves_a_point() -> None:
    original = flat_content([[500, 500, 500], [500.1, 500, 500], [500, 500.1, 500]], [[0, 1, 2], [1, 2, 0]])
    tile = decode_tile(encode_tile(original, position_bits=8))
    assert (len(tile.triangles), len(tile.lines)) == (1, 0)
    assert placed(tile)[tile.points].tolist() == [[500, 500, 500]]


def test_sliver_beside_a_kept_triangle_leaves_nothing() -> None:
    positions = [[500, 500, 500], [500.1, 500, 500], [600, 500, 500], [500, 600, 500]]
    tile = decode_tile(encode_tile(flat_content(positions, [[0, 1, 2], [0, 2, 3]]), position_bits=8))
    assert (len(tile.triangles), len(tile.lines), len(tile.points)) == (2, 0, 0)


def test_maximal_far_vertex_numbers() -> None:
    n = 70_000
    random = np.random.default_rng(2)
    triangles = np.stack([random.permutation(n) for _ in range(3)], axis=1).astype(np.uint32)
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    positions = np.arange(3.0 * n).reshape(n, 3)
    original = dataclasses.replace(EMPTY, positions=positions, normals=np.ones((n, 3), np.float32), triangles=triangles)
    tile = decode_tile(encode_tile(original, position_bits=21))
    assert len(tile.triangles) == len(triangles)
    centres = np.sort(placed(tile)[tile.triangles].mean(axis=1), axis=0)
    assert np.abs(centres - np.sort(positions[triangles].mean(axis=1), axis=0)).max() <= 1.01 * tile.ledger.quantisation


# refused content


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"triangles": np.array([[0, 1, 20]], np.uint32)}, "not below its 20 vertices"),
        ({"lines": np.array([[0, 2**32 - 1]], np.uint32)}, "not below"),
        ({"points": np.array([20], np.uint32)}, "not below"),
        ({"normals": np.zeros((3, 3), np.float32)}, "shapes"),
        ({"positions": np.full((20, 3), np.nan)}, "vertex 0: position .* not finite"),
        ({"normals": np.full((20, 3), np.inf, np.float32)}, "vertex 0: normal .* not finite"),
        ({"attributes": {64: np.zeros(20, np.uint32)}}, "attribute 64"),
        ({"attributes": {1: np.zeros(19, np.uint32)}}, "attribute 1"),
    ],
)
def test_refused_content(change: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        encode_tile(dataclasses.replace(content(4, 5), **change))  # type: ignore[arg-type]


def test_refused_options() -> None:
    with pytest.raises(UsageError, match="codec 'lzma'"):
        encode_tile(content(), codec="lzma")
    with pytest.raises(UsageError, match="bits a position"):
        encode_tile(content(), position_bits=7)


# damaged bytes


@pytest.mark.parametrize("codec", CODECS)
def test_truncated_at_every_length(codec: str) -> None:
    data = encode_tile(content(3, 3), codec=codec)
    for length in range(len(data)):
        for use in (decode_tile, check_tile):
            with pytest.raises(CorruptRecordError):
                use(data[:length])
    with pytest.raises(CorruptRecordError, match=f"{len(data) + 1} bytes, its header says {len(data)}"):
        decode_tile(data + b"\0")


def test_every_flipped_bit_is_refused() -> None:
    data = encode_tile(content(3, 3))
    for i in range(len(data)):
        for bit in range(8):
            damaged = bytearray(data)
            damaged[i] ^= 1 << bit
            with pytest.raises(CorruptRecordError):
                decode_tile(bytes(damaged))


def sealed(data: bytes | bytearray) -> bytes:
    """With a right checksum and length again."""
    changed = bytearray(data)
    struct.pack_into("<I", changed, 28, len(changed))
    return bytes(changed[:-4]) + struct.pack("<I", zlib.crc32(memoryview(changed)[:-4]))


@pytest.mark.parametrize("codec", CODECS)
def test_damage_behind_a_right_checksum_is_never_dangerous(codec: str) -> None:
    """A made-up tile with a right checksum is refused, or decodes to indices in range and finite numbers."""
    data = encode_tile(dataclasses.replace(content(6, 7), attributes={3: np.arange(42, dtype=np.uint32)}), codec=codec)
    random = np.random.default_rng(7)
    n_decoded = 0
    for _ in range(3000):
        damaged = bytearray(data)
        for _ in range(random.integers(1, 4)):
            damaged[random.integers(6, len(data))] = random.integers(0, 256)
        try:
            tile = decode_tile(sealed(damaged))
        except CorruptRecordError:
            continue
        n_decoded += 1
        for indices in (tile.triangles, tile.lines, tile.points):
            assert indices.size == 0 or indices.max() < len(tile.positions)
        assert np.isfinite(tile.positions).all() and np.isfinite(tile.normals).all()
    assert n_decoded > 0


def test_foreign_and_newer() -> None:
    data = encode_tile(content())
    with pytest.raises(CorruptRecordError, match="starts with b'glTF'"):
        decode_tile(b"glTF" + data[4:])
    with pytest.raises(CorruptRecordError, match="tile version 2, this program reads 1"):
        decode_tile(sealed(data[:4] + b"\2\0" + data[6:]))
    with pytest.raises(CorruptRecordError, match="0 bytes"):
        decode_tile(b"")


def test_huge_counts_are_refused_before_memory_is_taken() -> None:
    data = bytearray(encode_tile(content()))
    for offset in (12, 16, 20, 24):
        damaged = bytearray(data)
        struct.pack_into("<I", damaged, offset, 2**32 - 1)
        with pytest.raises(CorruptRecordError):
            decode_tile(sealed(damaged))


def test_hash_names_the_bytes() -> None:
    data = encode_tile(content())
    assert tile_hash(data) == tile_hash(memoryview(data))
    assert len(tile_hash(data)) == 32
    assert tile_hash(data) != tile_hash(encode_tile(content(), codec="plain"))
