"""The tiles that edits have dropped, built again: those and no others.

A tile is stored as soon as it is there. The nodes' errors, each at least its children's, follow when all are; until
then a rebuilt node keeps the larger of its own error and of what it had while it was stale: its budget or its
children's errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.codec_choice import codec_of
from nurbs_ooc.build.error_order import own_error
from nurbs_ooc.build.face_report import add_to_report, worst_rows
from nurbs_ooc.build.forest import Forest, Rows
from nurbs_ooc.build.mesh_demand import SURFACE_MASK, Keys
from nurbs_ooc.build.node_tiles import build_nodes
from nurbs_ooc.build.open_forest import changing, open_forest
from nurbs_ooc.build.surface_meshes import mesh_surfaces
from nurbs_ooc.hlod.mesh_pool import MeshPool


@dataclass(frozen=True)
class Rebuilt:
    """What a rebuild did.

    Attributes:
        n_tiles: nodes that were built.
        n_meshes: surfaces that were tessellated, each once for every level of every job that shows it.
    """

    n_tiles: int
    n_meshes: int


def rebuild_stale(store: TypedStore, workers: int = 1) -> Rebuilt:
    """Build the tiles of all stale nodes; their bytes are those of a build of the edited model.

    Edits meanwhile are taken into account. After a kill the next call goes on.

    Args:
        store: open for writing.
        workers: threads; the tiles do not depend on it.
    """
    n_tiles = n_meshes = 0
    while True:
        edits = store.edit_count()
        forest, stale = open_forest(store), store.stale_nodes()
        for cut in forest.jobs(stale):
            built = _rebuild(store, forest, cut, edits, workers)
            if built is None:
                break
            n_tiles, n_meshes = n_tiles + len(cut), n_meshes + built
        with changing(store, edits) as current:
            if current:
                _order(store)
                return Rebuilt(n_tiles, n_meshes)


def _rebuild(store: TypedStore, forest: Forest, rows: Rows, edits: int, workers: int) -> int | None:
    """Build and store the tiles of nodes of one level; number of meshes, or None if an edit came between."""
    reports: list[npt.NDArray[np.void]] = []

    def meshes(keys: Keys) -> MeshPool:
        pool = mesh_surfaces(store, keys, forest.surface_demand, workers)
        slots = pool.slots
        errors = slots["errors"].sum(axis=1)
        reports.append(worst_rows(slots["key"] & SURFACE_MASK, slots["status"], slots["reason"], errors))
        return pool

    built = build_nodes(forest.needs(rows), forest.placements, codec_of(store), meshes)
    with changing(store, edits) as current:
        if not current:
            return None
        add_to_report(store, reports)
        store.put_tiles(built.tiles)
        records = built.records.copy()
        before = np.concatenate([store.get_nodes(row, 1) for row in rows.tolist()])
        records["geometric_error"] = np.maximum(records["geometric_error"], before["geometric_error"])
        store.update_nodes(rows, records)
    return sum(map(len, reports))


def _order(store: TypedStore) -> None:
    """Give the rebuilt nodes their errors and forget that they were stale.

    All their ancestors are among them, so nobody else's error changes.
    """
    rows = store.edited_nodes()
    if not len(rows):
        return
    records = np.concatenate([store.get_nodes(row, 1) for row in rows.tolist()])
    errors: dict[int, float] = {}
    for row, record in reversed(list(zip(rows.tolist(), records, strict=True))):
        first, count = int(record["first_child"]), int(record["n_children"])
        stored = store.get_nodes(first, count)["geometric_error"].tolist()
        below = [errors.get(first + i, error) for i, error in enumerate(stored)]
        errors[row] = max([own_error(store, record), *below])
        record["geometric_error"] = errors[row]
    store.put_rebuilt(rows, records)
