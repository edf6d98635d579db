"""Tiles of nodes of one level from the meshes of their surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.tile import TileContent, encode_tile, tile_counts, tile_hash, tile_ledger
from nurbs_ooc.build import tunables
from nurbs_ooc.build.forest import NodeNeeds
from nurbs_ooc.build.mesh_demand import Keys, mesh_keys
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hlod.budget import NodeBudget
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.hlod.node import PlacedMeshes, diagonals, node_content

TILE_FIELDS = ("tile_hash", "tile_bytes", "n_triangles", "n_lines", "n_points", "geometric_error")


@dataclass(frozen=True, eq=False)
class BuiltNodes:
    """Tiles of some nodes.

    Attributes:
        tiles: hash and bytes of each.
        records: (n,) ``NODE_DTYPE``, ``geometric_error`` the tile's own.
    """

    tiles: list[tuple[str, bytes]]
    records: npt.NDArray[np.void]


def build_nodes(
    needs: NodeNeeds,
    placements: Placements,
    codec: str,
    meshes: Callable[[Keys], MeshPool],
) -> BuiltNodes:
    """Build the tiles of nodes of one level; stores nothing.

    Args:
        needs: what the nodes show.
        placements: one row per occurrence.
        codec: entropy coder.
        meshes: gives the meshes of ascending keys, slot by slot.
    """
    nodes, items = needs.nodes, needs.items
    budget = NodeBudget.of_level(int(nodes["level"][0]), tunables.SHARES)
    levels = budget.surface_levels(diagonals(items), placements.stretch[items["occurrence"]])
    needed, slots = np.unique(mesh_keys(items["surface"], levels), return_inverse=True)
    pool = meshes(needed)
    placed = PlacedMeshes.of(items, pool.slots[slots], placements)
    tiles, rows = [], []
    for row, (level, origin) in enumerate(zip(nodes["level"].tolist(), nodes["aabb_min"], strict=True)):
        own, points = placed[needs.rows_of(row)], needs.points_of(row)
        content = node_content(own, points, pool, placements, origin, budget, tunables.PRIMITIVES_PER_NODE)
        data = encoded(content, level, codec)
        name = tile_hash(data)
        tiles.append((name, data))
        rows.append((name.encode(), len(data), *tile_counts(data)[1:], tile_ledger(data).total))
    return BuiltNodes(tiles, _records(nodes, rows))


def _records(nodes: npt.NDArray[np.void], rows: list[tuple[bytes, int, int, int, int, float]]) -> npt.NDArray[np.void]:
    """Node records with what is known of their tiles."""
    records = nodes.copy()
    for name, column in zip(TILE_FIELDS, zip(*rows, strict=True), strict=False):
        records[name] = column
    return records


def encoded(content: TileContent, level: int, codec: str) -> bytes:
    """A tile on the position grid that all tiles of its ladder level share."""
    return encode_tile(
        content,
        position_bits=tunables.POSITION_BITS,
        normal_bits=tunables.NORMAL_BITS,
        codec=codec,
        min_step_exponent=level - tunables.STEP_LEVELS,
    )
