"""Products and materials as bytes: counts, then columns of numbers, then the names (see FORMAT.md)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.scene_record import Material, Product


def encode_products(products: Sequence[Product]) -> bytes:
    """u32 n, n x i4 parents, n x 12 float64 transforms, names."""
    for product in products:
        if len(product.transform) != 12:
            raise UsageError(f"product {product.name!r}: a transform of {len(product.transform)} numbers, want 12")
    transforms = np.array([product.transform for product in products], "<f8")
    parents = np.array([product.parent for product in products], "<i4")
    return _join(len(products), [parents, transforms], [product.name for product in products])


def decode_products(data: bytes) -> list[Product]:
    """Inverse of ``encode_products``."""
    (parents, transforms), names = _split(data, [("<i4", 1), ("<f8", 12)], "products")
    rows = zip(names, parents.tolist(), transforms.reshape(-1, 12).tolist(), strict=True)
    return [Product(name, parent, tuple(transform)) for name, parent, transform in rows]


def encode_materials(materials: Sequence[Material]) -> bytes:
    """u32 n, n x 4 float64 linear colours, names."""
    colours = np.array([material.rgba for material in materials], "<f8")
    return _join(len(materials), [colours], [material.name for material in materials])


def decode_materials(data: bytes) -> list[Material]:
    """Inverse of ``encode_materials``."""
    (colours,), names = _split(data, [("<f8", 4)], "materials")
    return [
        Material(name, (r, g, b, a)) for name, (r, g, b, a) in zip(names, colours.reshape(-1, 4).tolist(), strict=True)
    ]


def _join(n: int, columns: list[npt.NDArray[np.generic]], names: list[str]) -> bytes:
    texts = [name.encode() for name in names]
    lengths = np.array([len(text) for text in texts], "<u4")
    return b"".join([struct.pack("<I", n), *(column.tobytes() for column in columns), lengths.tobytes(), *texts])


def _split(data: bytes, columns: list[tuple[str, int]], what: str) -> tuple[list[npt.NDArray[np.generic]], list[str]]:
    """Columns of (type, numbers per row) and names."""
    try:
        (n,) = struct.unpack_from("<I", data)
        start = 4
        arrays: list[npt.NDArray[np.generic]] = []
        for code, width in [*columns, ("<u4", 1)]:
            arrays.append(np.frombuffer(data, code, n * width, start))
            start += arrays[-1].nbytes
        ends = start + np.cumsum(arrays.pop(), dtype=np.int64)
        if (int(ends[-1]) if n else start) != len(data):
            raise ValueError(f"{len(data)} bytes, the lengths say {int(ends[-1]) if n else start}")
        starts = [start, *ends[:-1].tolist()]
        names = [data[a:b].decode() for a, b in zip(starts, ends.tolist(), strict=False)]
    except (ValueError, struct.error) as error:
        raise CorruptRecordError(f"{what}: {error}") from error
    return arrays, names
