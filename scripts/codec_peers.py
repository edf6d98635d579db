"""meshoptimizer and Draco on the contents of tiles, for ``bench_codec.py --peers``.

Both get vertices at the same precision as our tiles: positions of 16 bits, normals of 10 + 10. For
meshoptimizer they are handed over already quantised (8 + 4 bytes a vertex) and come back quantised: only its
reordering and coding are timed, not the arithmetic that ours includes. Draco quantises and gives floats back.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import zstandard

from nurbs_cache.quantise import box_of, choose_grid, quantise_normals, quantise_positions
from nurbs_cache.tile import TileContent


@dataclass(frozen=True)
class Peer:
    """A codec: how a tile is prepared (not timed), encoded and decoded, and how large the code is."""

    prepare: Callable[[TileContent], Any]
    encode: Callable[[Any], Any]
    decode: Callable[[Any], object]
    size: Callable[[Any], int]


def peers() -> dict[str, Peer]:
    """Those that are installed (``pip install nurbs-ooc[bench]``)."""
    found: dict[str, Peer] = {}
    for make in (_meshoptimizer, _draco):
        with suppress(ImportError):
            found |= make()
    return found


def _quantised(content: TileContent) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint32]]:
    """(n, 6) u16 of x, y, z, 0 and two octahedral coordinates, and the flat indices."""
    box = box_of(content.positions)
    steps, _ = quantise_positions(content.positions, choose_grid(box[0], box[1], 16))
    vertices = np.zeros((len(steps), 6), np.uint16)
    vertices[:, :3] = steps
    vertices[:, 4:] = quantise_normals(content.normals, 10)
    return vertices, np.ascontiguousarray(content.triangles.reshape(-1))


def _meshoptimizer() -> dict[str, Peer]:
    import meshoptimizer as m

    def encode(given: tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint32]]) -> tuple[bytes, bytes, int, int]:
        vertices, indices = given
        ordered = np.empty_like(indices)
        m.optimize_vertex_cache(ordered, indices, len(indices), len(vertices))
        fetched = np.empty_like(vertices)
        # The wrapper rewrites the indices it is given in place, as the library does.
        n = m.optimize_vertex_fetch(fetched, ordered, vertices, len(indices), len(vertices), 12)
        index_bytes = m.encode_index_buffer(ordered, len(ordered), n)
        return m.encode_vertex_buffer(fetched[:n], n, 12), index_bytes, n, len(ordered)

    def decode(coded: tuple[bytes, bytes, int, int]) -> object:
        vertices, indices, n, n_indices = coded
        return m.decode_vertex_buffer(n, 12, vertices), m.decode_index_buffer(n_indices, 4, indices)

    packer, unpacker = zstandard.ZstdCompressor(level=1), zstandard.ZstdDecompressor()

    def encode_packed(given: Any) -> tuple[bytes, bytes, int, int]:
        vertices, indices, *counts = encode(given)
        return packer.compress(vertices), packer.compress(indices), counts[0], counts[1]

    def decode_packed(coded: tuple[bytes, bytes, int, int]) -> object:
        return decode((unpacker.decompress(coded[0]), unpacker.decompress(coded[1]), *coded[2:]))

    def size(coded: tuple[bytes, bytes, int, int]) -> int:
        return len(coded[0]) + len(coded[1])

    return {
        "meshoptimizer": Peer(_quantised, encode, decode, size),
        "meshoptimizer + zstd": Peer(_quantised, encode_packed, decode_packed, size),
    }


def _draco() -> dict[str, Peer]:
    import DracoPy

    def prepare(content: TileContent) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32], Any]:
        box = box_of(content.positions)
        return (content.positions - box[0]).astype(np.float32), content.triangles, content.normals.astype(np.float64)

    def encoder(level: int) -> Callable[[Any], bytes]:
        def encode(given: Any) -> bytes:
            coded: bytes = DracoPy.encode(
                given[0], given[1], quantization_bits=16, compression_level=level, normals=given[2],
                normal_quantization_bits=10,
            )  # fmt: skip
            return coded

        return encode

    return {f"draco, level {level}": Peer(prepare, encoder(level), DracoPy.decode, len) for level in (1, 7)}
