"""Small made-up contents for the tests of the cache."""

from __future__ import annotations

import numpy as np

from nurbs_cache.ledger import Ledger
from nurbs_cache.node_record import NODE_DTYPE
from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    GeometryBatch,
)
from nurbs_cache.tile import TileContent, encode_tile, tile_hash


def geometry(n_surfaces: int, *, seed: int = 0) -> GeometryBatch:
    """A batch with numbers in every table."""
    random = np.random.default_rng(seed)
    surfaces = np.zeros(n_surfaces, SURFACE_DTYPE)
    surfaces["degree_u"] = 3
    surfaces["points"] = 48 * np.arange(n_surfaces)
    curves = np.zeros(2 * n_surfaces, CURVE_DTYPE)
    curves["t1"] = random.random(2 * n_surfaces)
    return GeometryBatch(
        surfaces=surfaces,
        loops=np.zeros(n_surfaces, LOOP_DTYPE),
        coedges=np.zeros(4 * n_surfaces, COEDGE_DTYPE),
        edges=np.zeros(4 * n_surfaces, EDGE_DTYPE),
        curves=curves,
        vertices=random.random((n_surfaces, 3)),
        values=random.random(48 * n_surfaces),
        sources=[f"#{seed}{i} FLÄCHE" for i in range(n_surfaces)],
    )


def node_rows(n: int) -> np.ndarray:
    """Nodes with distinct numbers."""
    nodes = np.zeros(n, NODE_DTYPE)
    nodes["key"] = [f"0-{i:o}".encode() for i in range(n)]
    nodes["parent"] = np.arange(n) - 1
    nodes["aabb_max"] = np.arange(3 * n).reshape(n, 3)
    nodes["geometric_error"] = np.arange(n) / 3
    return nodes


def wavy_grid(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, unit normals and triangles of a wavy sheet, some 100 mm wide."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, columns), indexing="ij")
    positions = np.stack([100.0 * u, 80.0 * v, 10.0 * np.sin(5.0 * u) * np.cos(4.0 * v)], axis=-1).reshape(-1, 3)
    slope_u = 0.5 * np.cos(5.0 * u) * np.cos(4.0 * v)
    slope_v = -0.5 * np.sin(5.0 * u) * np.sin(4.0 * v)
    normals = np.stack([-slope_u, -slope_v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    corner = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return positions, normals.astype(np.float32), triangles


def content(rows: int = 4, columns: int = 5) -> TileContent:
    """A sheet with a line, a point and a ledger."""
    positions, normals, triangles = wavy_grid(rows, columns)
    lines = np.array([[0, 1], [1, 2]], np.uint32)
    return TileContent(positions, normals, triangles, lines, np.array([3], np.uint32), Ledger(0.1, 0.02, 0.003))


def small_tile() -> tuple[str, bytes]:
    """Name and bytes of a small tile."""
    data = encode_tile(content())
    return tile_hash(data), data
