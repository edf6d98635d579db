"""Bytes of a mesh as a cache stores it, and what fewer bits a coordinate cost in millimetres."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nurbs_cache.quantise import MAX_POSITION_BITS, MIN_POSITION_BITS, box_of, choose_grid, quantise_positions
from nurbs_cache.tile import TileContent, encode_tile
from nurbs_ooc.tessellation.mesh import MeshBatch

QUANTISATION_SHARE = 0.25  # of the mesh's error that its grid may add


def _content(mesh: MeshBatch) -> TileContent:
    none = np.empty((0, 2), np.uint32)
    return TileContent(
        mesh.positions, mesh.normals.astype(np.float32), mesh.triangles.astype(np.uint32), none, none[:, 0].copy()
    )


def bits_for(mesh: MeshBatch, error: float) -> int:
    """Bits a coordinate with which the grid adds no more than its share of ``error`` mm, as far as bits go."""
    extent = float(np.ptp(mesh.positions, axis=0).max()) if len(mesh.positions) else 0.0
    if extent == 0.0 or error <= 0.0:
        return MAX_POSITION_BITS
    # Steps are powers of two, and a point moves by half a step along each axis.
    step = 2.0 ** math.floor(math.log2(QUANTISATION_SHARE * error * 2.0 / math.sqrt(3.0)))
    return min(max(math.ceil(math.log2(extent / step + 2.0)), MIN_POSITION_BITS), MAX_POSITION_BITS)


def encoded_bytes(mesh: MeshBatch, error: float) -> int:
    """Bytes of the mesh as one tile whose grid suits an error of ``error`` mm."""
    return len(encode_tile(_content(mesh), position_bits=bits_for(mesh, error))) if len(mesh.triangles) else 0


@dataclass(frozen=True)
class QuantisationPoint:
    """All parts of one mesh at some bits a coordinate: largest displacement (mm), bytes, bytes a triangle."""

    bits: int
    moved_mm: float
    bytes: int
    bytes_per_triangle: float

    def as_json(self) -> dict[str, Any]:
        """By name."""
        return asdict(self)


def quantisation_curve(meshes: list[MeshBatch]) -> list[QuantisationPoint]:
    """The same meshes at 8 to 21 bits a coordinate."""
    full = [m for m in meshes if len(m.triangles)]
    triangles = sum(len(m.triangles) for m in full)
    out = []
    for bits in range(MIN_POSITION_BITS, MAX_POSITION_BITS + 1):
        moved, size = 0.0, 0
        for mesh in full:
            box = box_of(mesh.positions)
            moved = max(moved, quantise_positions(mesh.positions, choose_grid(box[0], box[1], bits))[1])
            size += len(encode_tile(_content(mesh), position_bits=bits))
        out.append(QuantisationPoint(bits, moved, size, size / max(triangles, 1)))
    return out
