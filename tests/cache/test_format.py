"""FORMAT.md against the program: a reader written from the document alone, and its tables of fields."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import lmdb
import numpy as np
import pytest
import zstandard

from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.node_record import ITEM_DTYPE, LOD_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_cache.store import Store
from nurbs_cache.surface_record import COEDGE_DTYPE, CURVE_DTYPE, EDGE_DTYPE, LOOP_DTYPE, SURFACE_DTYPE
from nurbs_cache.tile import TileContent, decode_tile, encode_tile, tile_hash
from tests.cache.makers import content, geometry, node_rows, small_tile

ROWS = {
    "surface": SURFACE_DTYPE,
    "loop": LOOP_DTYPE,
    "coedge": COEDGE_DTYPE,
    "edge": EDGE_DTYPE,
    "curve": CURVE_DTYPE,
    "occurrence": OCCURRENCE_DTYPE,
    "node": NODE_DTYPE,
    "item": ITEM_DTYPE,
    "lod": LOD_DTYPE,
    "face": FACE_REPORT_DTYPE,
}


# the reader


def read_huffman(data: bytes, n: int) -> bytes:
    last = data[0]
    at = 1 + last // 2 + 1
    lengths = [(data[1 + s // 2] >> (4 if s % 2 else 0)) & 15 for s in range(last + 1)]
    at += -at % 4
    words_of = struct.unpack_from("<4I", data, at)
    at += 16
    codes: dict[tuple[int, int], int] = {}
    code = 0
    for length in range(1, 13):
        for symbol in range(last + 1):
            if lengths[symbol] == length:
                codes[length, code] = symbol
                code += 1
        code *= 2
    out = bytearray(n)
    for k in range(4):
        bits = [w >> j & 1 for w in struct.unpack_from(f"<{words_of[k]}I", data, at) for j in range(32)]
        at += 4 * words_of[k]
        here = 0
        for i in range(k, n, 4):
            length, code = 0, 0
            while (length, code) not in codes:
                code = 2 * code + bits[here]
                here += 1
                length += 1
            out[i] = codes[length, code]
    return bytes(out)


class Extras:
    """Variable-length numbers one after the other."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def number(self) -> int:
        value, shift = 0, 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value // 2 if value % 2 == 0 else -(value + 1) // 2


def read_list(data: bytes, n: int, step: int) -> list[int]:
    source, values, previous = Extras(data), [], -1
    for _ in range(n):
        previous += source.number() + step
        values.append(previous)
    assert source.at == len(data)
    return values


def read_triangles(codes: bytes, extra: bytes, n: int) -> tuple[list[list[int]], list[tuple[int, int, int]]]:
    source = Extras(extra)
    used, far = 0, -1
    ring: list[int] = []
    edges: list[tuple[int, int, int]] = []
    predictors = [(i - 1, i - 1, i - 1) for i in range(n)]
    triangles = []

    def vertex(code: int) -> int:
        nonlocal used, far
        if 1 <= code <= 13:
            return ring[code - 1]
        if code == 0:
            v = used
            used += 1
        else:
            v = far = far + 1 if code == 14 else far + source.number()
        ring.insert(0, v)
        return v

    for byte in codes:
        h, c = byte >> 4, byte & 15
        before = used
        if h < 15:
            a, b, opposite = edges[h]
            v = vertex(c)
            if v >= before:
                predictors[v] = (a, b, opposite)
        else:
            pair = source.byte()
            a = vertex(c)
            b = vertex(pair >> 4)
            v = vertex(pair & 15)
            if b >= before and b != a:
                predictors[b] = (a, a, a)
            if v >= before and v not in (a, b):
                predictors[v] = (b, b, b)
            edges.insert(0, (b, a, v))
        edges.insert(0, (v, b, a))
        edges.insert(0, (a, v, b))
        triangles.append([a, b, v])
    assert source.at == len(extra)
    return triangles, predictors


def read_tile(data: bytes) -> dict[str, Any]:
    magic, version, _, nb, exponent, n_streams, zero = struct.unpack_from("<4sHBBhBB", data)
    n, t, n_lines, p, length = struct.unpack_from("<5I", data, 12)
    origin = struct.unpack_from("<3d", data, 32)
    extent = struct.unpack_from("<3I", data, 56)
    assert (magic, version, zero, length) == (b"NTIL", 1, 0, len(data))
    assert struct.unpack_from("<I", data, length - 4)[0] == zlib.crc32(data[:-4])
    streams: dict[int, bytes] = {}
    planes: dict[int, int] = {}
    at = 120 + 12 * n_streams
    for i in range(n_streams):
        number, coder, planes_, _, decoded, stored = struct.unpack_from("<4BII", data, 120 + 12 * i)
        raw = data[at : at + stored]
        at += stored
        if coder == 1:
            raw = zstandard.ZstdDecompressor().decompress(raw)
        elif coder == 2:
            raw = read_huffman(raw, decoded)
        assert len(raw) == decoded
        streams[number], planes[number] = raw, planes_
    assert at == length - 4
    triangles, predictors = read_triangles(streams.get(1, b""), streams.get(2, b""), n)
    assert len(triangles) == t

    def folded(low: int, width: int) -> list[list[int]]:
        raw = streams.get(low, b"") + streams.get(low + 1, b"")
        n_planes = 1 + planes.get(low + 1, 0)
        assert len(raw) == n_planes * width * n
        numbers = []
        for i in range(n):
            folds = [sum(raw[(q * width + k) * n + i] << (8 * q) for q in range(n_planes)) for k in range(width)]
            numbers.append([f // 2 if f % 2 == 0 else -(f + 1) // 2 for f in folds])
        return numbers

    places: list[list[int]] = []
    octahedral: list[list[int]] = []
    for i, (number, turned) in enumerate(zip(folded(8, 3), folded(10, 2), strict=True)):
        a, b, d = predictors[i]
        guess = [min(max(places[a][k] + places[b][k] - places[d][k], 0), extent[k]) if i else 0 for k in range(3)]
        places.append([guess[k] + number[k] for k in range(3)])
        guess = [octahedral[a][k] + octahedral[b][k] - octahedral[d][k] if i else 0 for k in range(2)]
        octahedral.append([(guess[k] + turned[k]) % 2**nb for k in range(2)])
    half = 2 ** (nb - 1) - 1
    normals = []
    for u, v in octahedral:
        x, y = u / half - 1.0, v / half - 1.0
        z = 1.0 - abs(x) - abs(y)
        if z < 0.0:
            x -= -z if x >= 0.0 else z
            y -= -z if y >= 0.0 else z
        normals.append(np.array([x, y, z]) / np.linalg.norm([x, y, z]))
    lines = read_list(streams.get(3, b""), 2 * n_lines, 0)
    return {
        "positions": np.array(origin) + np.array(places, float).reshape(-1, 3) * 2.0**exponent,
        "normals": np.array(normals).reshape(-1, 3),
        "triangles": triangles,
        "lines": [list(pair) for pair in zip(lines[::2], lines[1::2], strict=True)],
        "points": read_list(streams.get(4, b""), p, 1),
        "ledger": struct.unpack_from("<6d", data, 72),
        "attributes": {number - 32: read_list(raw, n, 0) for number, raw in streams.items() if number >= 32},
    }


def read_record(data: bytes) -> tuple[bytes, bytes]:
    """Payload and identity."""
    magic, version, body, zero, length = struct.unpack_from("<4sBBHQ", data)
    assert (magic, version, zero) == (b"NREC", 1, 0)
    assert struct.unpack_from("<I", data, 32)[0] == zlib.crc32(data[:32] + data[36:])
    payload = zstandard.ZstdDecompressor().decompress(data[36:]) if body else data[36:]
    assert len(payload) == length
    assert hashlib.blake2b(payload, digest_size=16).digest() == data[16:32]
    return payload, data[16:32]


# the tests


def scattered() -> TileContent:
    """Triangles in no order, with lines, points and attributes."""
    random = np.random.default_rng(5)
    positions = random.random((60, 3)) * 1000.0
    normals = random.normal(size=(60, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    triangles = np.array([random.permutation(50)[:3] for _ in range(120)], np.uint32)
    lines = random.integers(0, 30, (15, 2)) + np.array([0, 30])
    points = random.integers(0, 60, 20)
    attributes = {0: random.integers(0, 2**32, 60), 9: np.arange(60)}
    return TileContent(
        positions,
        normals,
        triangles,
        lines.astype(np.uint32),
        points.astype(np.uint32),
        attributes={k: v.astype(np.uint32) for k, v in attributes.items()},
    )


@pytest.mark.kernel
@pytest.mark.parametrize("codec", ["zstd", "huffman", "plain"])
@pytest.mark.parametrize("bits", [(8, 8), (16, 10), (21, 12)])
@pytest.mark.parametrize("make", [lambda: content(12, 9), scattered], ids=["sheet", "scattered"])
def test_reader_from_the_document(codec: str, bits: tuple[int, int], make: Any) -> None:
    data = encode_tile(make(), codec=codec, position_bits=bits[0], normal_bits=bits[1])
    ours, theirs = decode_tile(data), read_tile(data)
    assert (ours.origin + ours.positions.astype(float) == theirs["positions"]).all()
    assert np.abs(ours.normals - theirs["normals"]).max() < 1e-6
    assert ours.triangles.tolist() == theirs["triangles"]
    assert ours.lines.tolist() == theirs["lines"]
    assert ours.points.tolist() == theirs["points"]
    assert ours.ledger.terms == theirs["ledger"]
    assert {k: v.tolist() for k, v in ours.attributes.items()} == theirs["attributes"]


def test_cache_from_the_document(cache_path: Path) -> None:
    name, tile = small_tile()
    batch = geometry(3)
    products = [Product("Ä", -1, tuple(map(float, range(12)))), Product("b", 0, (0.5,) * 12)]
    with Store.create(cache_path, provenance={"tool": "test"}) as store:
        store.put_parts([(0, PartInfo("Teil", 3, 0), batch)])
        store.put_scene(products, [Material("m", (0.1, 0.2, 0.3, 1.0))], np.zeros(2, OCCURRENCE_DTYPE), {"file": "mm"})
        nodes = node_rows(300)
        nodes["tile_hash"][7] = name.encode()
        store.put_tree(nodes, np.zeros(3, ITEM_DTYPE), {"r": 2})
        store.put_tiles([(name, tile)])
        store.put_face_report(np.ones(1, FACE_REPORT_DTYPE))
        content_hash = store.content_hash()
    assert sorted(p.name for p in cache_path.iterdir()) == ["data.mdb", "lock.mdb", "writer.lock"]
    with lmdb.open(str(cache_path), max_dbs=16, readonly=True) as env:
        tables: dict[str, dict[bytes, bytes]] = {}
        with env.begin() as transaction:
            for table in [bytes(key).decode() for key, _ in transaction.cursor()]:
                tables[table] = dict(transaction.cursor(env.open_db(table.encode(), txn=transaction, create=False)))
    assert tables["meta"][b"magic"] == b"nurbs-ooc cache"
    assert tables["meta"][b"schema"] == b"1"
    assert json.loads(read_record(tables["meta"][b"provenance"])[0]) == {"tool": "test"}
    assert tables["tiles"] == {hashlib.blake2b(tile, digest_size=16).digest(): tile}
    assert read_record(tables["part_infos"][bytes(4)])[0] == struct.pack("<QI", 0, 3) + b"Teil"
    payload = read_record(tables["parts"][bytes(4)])[0]
    lengths = struct.unpack_from("<8Q", payload, 8)
    at = 72 + sum(n + -n % 8 for n in lengths[:6])
    assert np.frombuffer(payload, "<f8", lengths[6] // 8, at).tolist() == batch.values.tolist()
    payload = read_record(tables["scene"][b"products"])[0]
    assert struct.unpack_from("<I2i24d2I", payload) == (2, -1, 0, *map(float, range(12)), *[0.5] * 12, 2, 1)
    assert payload.endswith("Äb".encode())
    pages = [read_record(tables["nodes"][struct.pack(">I", page)])[0] for page in range(2)]
    assert [len(page) for page in pages] == [256 * 176, 44 * 176]
    assert b"".join(pages) == nodes.tobytes()
    assert json.loads(read_record(tables["tree"][b"head"])[0]) == {"n_nodes": 300, "n_items": 3, "params": {"r": 2}}
    # the content hash
    digest = hashlib.blake2b(b"nurbs-ooc cache" + struct.pack("<I", 1), digest_size=16)
    digest.update(read_record(tables["meta"][b"units"])[1])
    for table in ("part_infos", "parts", "scene", "tree", "nodes", "items", "faces"):
        digest.update(table.encode() + b"\0")
        for key, value in sorted(tables[table].items()):
            digest.update(struct.pack("<I", len(key)) + key + read_record(value)[1])
        digest.update(b"\xff" * 4)
    assert digest.hexdigest() == content_hash


def test_tables_of_fields(repository: Path) -> None:
    text = (repository / "cache" / "FORMAT.md").read_text()
    found = re.split(r"\n### Row `", text)[1:]
    assert [section.split("`")[0] for section in found] == list(ROWS)
    for section in found:
        name, n_bytes = re.match(r"(\w+)`: (\d+) bytes", section).groups()  # type: ignore[union-attr]
        fields = re.findall(r"^\| (\d+) \| (\w+)(?: × (\d+))? \| `(\w+)` \|", section, re.MULTILINE)
        dtype = ROWS[name]
        assert int(n_bytes) == dtype.itemsize
        assert [field[3] for field in fields] == list(dtype.names or ())
        for offset, code, count, field in fields:
            kind, start = (dtype.fields or {})[field][:2]
            assert int(offset) == start
            assert np.dtype(code) == kind.base
            assert int(count or 1) == int(np.prod(kind.shape, dtype=int))


def test_hash_of_a_tile_covers_every_byte() -> None:
    data = encode_tile(dataclasses.replace(content(), attributes={1: np.arange(20, dtype=np.uint32)}))
    assert tile_hash(data) == hashlib.blake2b(data, digest_size=16).hexdigest()
