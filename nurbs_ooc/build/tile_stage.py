"""Stage 4: the tiles of nodes, from coarse levels to fine ones.

Nodes of one level are built in batches: first every mesh that any of them needs, each (surface, level)
once, then the nodes on all threads. A batch is stored before the next begins, so a killed build loses
one batch at most, and memory holds the meshes of one batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.tile import TileContent, encode_tile, tile_counts, tile_hash, tile_ledger
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.codec_choice import DEFAULT_CODEC, codec_of
from nurbs_ooc.build.face_report import FaceReport
from nurbs_ooc.build.surface_meshes import SURFACE_MASK, mesh_keys, mesh_surfaces
from nurbs_ooc.build.workers import run_in_order
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hierarchy.runs import run_rows
from nurbs_ooc.hlod.budget import NodeBudget
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.hlod.node import NO_SLOT, node_content, shown_as_point


@dataclass(frozen=True, eq=False)
class Forest:
    """The tables that tiles are made from, held in memory while a build runs.

    Attributes:
        nodes, items: as stored.
        placements: one row per occurrence.
        codec: entropy coder of the tiles.
    """

    nodes: npt.NDArray[np.void]
    items: npt.NDArray[np.void]
    placements: Placements
    codec: str = DEFAULT_CODEC

    @classmethod
    def load(cls, store: TypedStore) -> Forest:
        """Read the tables of a store whose trees are built."""
        placements = Placements.of_transforms(store.get_occurrences()["transform"])
        return cls(store.get_nodes(), store.get_items(), placements, codec_of(store))

    def items_of(self, row: int) -> npt.NDArray[np.void]:
        """All items of a node's subtree."""
        first = int(self.nodes["first_item"][row])
        return self.items[first : first + int(self.nodes["n_items"][row])]


@dataclass(frozen=True, eq=False)
class BuiltBatch:
    """Tiles of some nodes, and how their surfaces came through.

    Attributes:
        rows: (n,) node rows.
        tiles: hash and bytes of each.
        records: (n,) ``NODE_DTYPE``, ``geometric_error`` the tile's own.
        surfaces, meshes: surface id and mesh of every slot that was tessellated.
    """

    rows: npt.NDArray[np.int64]
    tiles: list[tuple[str, bytes]]
    records: npt.NDArray[np.void]
    surfaces: npt.NDArray[np.uint64]
    meshes: MeshPool


def batches(forest: Forest, rows: npt.NDArray[np.int64]) -> Iterator[npt.NDArray[np.int64]]:
    """Cut ``rows`` into batches of one level each, coarse levels first, that need a bounded number of meshes."""
    levels = forest.nodes["level"][rows]
    taken = np.zeros(int(forest.items["surface"].max(initial=0)) + 1, np.bool_)  # surfaces with a mesh in the batch
    for level in np.unique(levels)[::-1].tolist():
        budget = NodeBudget.of_level(level, tunables.SHARES)
        batch: list[int] = []
        taken[:], n_taken, n_items = False, 0, 0
        for row in np.sort(rows[levels == level]).tolist():
            items = forest.items_of(row)
            wanted = np.unique(items["surface"][~shown_as_point(items, budget)])
            n_new = int((~taken[wanted]).sum())
            full = n_taken + n_new > tunables.SURFACES_PER_BATCH or n_items + len(items) > tunables.ITEMS_PER_BATCH
            if batch and full:
                yield np.array(batch, np.int64)
                batch, n_new = [], len(wanted)
                taken[:], n_taken, n_items = False, 0, 0
            batch.append(row)
            taken[wanted] = True
            n_taken, n_items = n_taken + n_new, n_items + len(items)
        yield np.array(batch, np.int64)


def build_batch(store: TypedStore, forest: Forest, rows: npt.NDArray[np.int64], workers: int) -> BuiltBatch:
    """Build the tiles of nodes of one level; stores nothing."""
    nodes = forest.nodes[rows]
    budget = NodeBudget.of_level(int(nodes["level"][0]), tunables.SHARES)
    items = forest.items[run_rows(nodes["first_item"], nodes["n_items"])]
    levels = budget.surface_levels(forest.placements.stretch[items["occurrence"]])
    keys = mesh_keys(items["surface"], levels)
    meshed = ~shown_as_point(items, budget)
    needed = np.unique(keys[meshed])
    pool = mesh_surfaces(store, needed, workers)
    slots = np.where(meshed, np.searchsorted(needed, keys), NO_SLOT)
    ends = np.cumsum(nodes["n_items"].astype(np.int64))
    jobs = (
        partial(_build_node, node, items[end - node["n_items"] : end], slots[end - node["n_items"] : end], pool,
                forest.placements, budget, forest.codec)
        for node, end in zip(nodes, ends.tolist(), strict=True)
    )  # fmt: skip
    tiles, records = [], nodes.copy()
    for i, data in enumerate(run_in_order(jobs, workers)):
        name, (_, *counts) = tile_hash(data), tile_counts(data)
        tiles.append((name, data))
        records[i]["tile_hash"], records[i]["tile_bytes"] = name.encode(), len(data)
        records[i]["n_triangles"], records[i]["n_lines"], records[i]["n_points"] = counts
        records[i]["geometric_error"] = tile_ledger(data).total
    return BuiltBatch(rows, tiles, records, needed & SURFACE_MASK, pool)


def _build_node(
    node: np.void,
    items: npt.NDArray[np.void],
    slots: npt.NDArray[np.int64],
    pool: MeshPool,
    placements: Placements,
    budget: NodeBudget,
    codec: str,
) -> bytes:
    """Bytes of a node's tile."""
    return encoded(node_content(items, slots, pool, placements, node["aabb_min"], budget), int(node["level"]), codec)


def encoded(content: TileContent, level: int, codec: str) -> bytes:
    """A tile on the position grid that all tiles of its ladder level share."""
    return encode_tile(
        content,
        position_bits=tunables.POSITION_BITS,
        normal_bits=tunables.NORMAL_BITS,
        codec=codec,
        min_step_exponent=level - tunables.STEP_LEVELS,
    )


def build_tiles(
    store: TypedStore, forest: Forest, rows: npt.NDArray[np.int64], workers: int, advance: Callable[[int], None]
) -> None:
    """Build, store and note in ``forest.nodes`` the tiles of ``rows``.

    Args:
        store: written to.
        forest: its ``nodes`` are updated; ``geometric_error`` becomes the tile's own.
        rows: nodes without tiles.
        workers: threads; the tiles do not depend on it.
        advance: told how many nodes were stored.
    """
    report = FaceReport(store)
    for batch in batches(forest, rows):
        built = build_batch(store, forest, batch, workers)
        store.put_tiles(built.tiles)
        report.add(built.surfaces, built.meshes)
        store.update_nodes(built.rows, built.records)
        forest.nodes[built.rows] = built.records
        advance(len(batch))
