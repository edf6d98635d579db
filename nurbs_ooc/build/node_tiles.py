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
from nurbs_ooc.hlod.node import diagonals, node_content


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
    tiles, records = [], nodes.copy()
    for row, record in enumerate(records):
        own, points = needs.rows_of(row), needs.points_of(row)
        origin = nodes["aabb_min"][row]
        content = node_content(
            items[own], slots[own], points, pool, placements, origin, budget, tunables.PRIMITIVES_PER_NODE
        )
        data = encoded(content, int(record["level"]), codec)
        name, (_, *counts) = tile_hash(data), tile_counts(data)
        tiles.append((name, data))
        record["tile_hash"], record["tile_bytes"] = name.encode(), len(data)
        record["n_triangles"], record["n_lines"], record["n_points"] = counts
        record["geometric_error"] = tile_ledger(data).total
    return BuiltNodes(tiles, records)


def encoded(content: TileContent, level: int, codec: str) -> bytes:
    """A tile on the position grid that all tiles of its ladder level share."""
    return encode_tile(
        content,
        position_bits=tunables.POSITION_BITS,
        normal_bits=tunables.NORMAL_BITS,
        codec=codec,
        min_step_exponent=level - tunables.STEP_LEVELS,
    )
