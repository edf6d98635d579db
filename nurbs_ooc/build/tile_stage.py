"""Stage 5: the tiles of nodes, from coarse levels to fine ones, out of the files of meshes.

What is done is stored some MiB at a time, so a killed build loses little.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.crew import Crew
from nurbs_ooc.build.forest import Forest, NodeNeeds, Rows
from nurbs_ooc.build.node_tiles import BuiltNodes, build_nodes
from nurbs_ooc.build.workshop import Bench, Workshop


def build_job(bench: Bench, needs: NodeNeeds) -> BuiltNodes:
    """Build the tiles of a job's nodes."""
    return build_nodes(needs, bench.placements, bench.shop.codec, bench.shelf.pool)


def build_tiles(
    store: TypedStore, forest: Forest, rows: Rows, crew: Crew, shop: Workshop, advance: Callable[[int], None]
) -> None:
    """Build, store and note in ``forest.nodes`` the tiles of ``rows``.

    Args:
        store: written to.
        forest: its ``nodes`` are updated; ``geometric_error`` becomes the tile's own.
        rows: nodes without tiles, whose meshes are on the shelf.
        crew: does the work.
        shop: where the files are.
        advance: told how many nodes were built.
    """
    cuts = list(forest.jobs(rows))
    jobs = (forest.needs(cut) for cut in cuts)
    waiting: list[tuple[Rows, BuiltNodes]] = []
    n_bytes = 0
    for cut, built in zip(cuts, crew.run(build_job, shop, jobs), strict=True):
        waiting.append((cut, built))
        n_bytes += int(built.records["tile_bytes"].sum(dtype=np.int64))
        if n_bytes >= tunables.STORED_AT_ONCE:
            _keep(store, forest, waiting)
            waiting, n_bytes = [], 0
        advance(len(cut))
    _keep(store, forest, waiting)


def _keep(store: TypedStore, forest: Forest, built: list[tuple[Rows, BuiltNodes]]) -> None:
    """Store tiles, then the nodes that name them."""
    if not built:
        return
    store.put_tiles([tile for _, part in built for tile in part.tiles])
    rows, records = np.concatenate([cut for cut, _ in built]), np.concatenate([part.records for _, part in built])
    store.update_nodes(rows, records)
    forest.nodes[rows] = records
    store.release_pages()
