"""Replacing a surface of a store: everything that says what the surface is, in one transaction.

A node whose subtree holds the surface loses its tile in the same transaction, and its row is noted under the key
``edits`` of table ``meta``, beside the number of edits so far. So a node is stale exactly if it is noted there and has
no tile: a tile that is built for it, by whomever, ends that, and a kill at any moment loses no mark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import MissingRecordError, UsageError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.keys import number_key, surface_key
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.part_tables import PartTables, pack_geometry
from nurbs_cache.raw_store import Writing
from nurbs_cache.row_pages import Rows, clean_rows, update_rows
from nurbs_cache.scene_tables import pack_json
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.tile_tables import TileTables, merge_face_rows
from nurbs_cache.tree_tables import EDITS_KEY, TreeTables


@dataclass(frozen=True, eq=False)
class SurfaceEdit:
    """What changes when a surface is replaced.

    Attributes:
        surface: its id.
        part: of which it is a surface.
        geometry: the whole part as it is now.
        item_rows, items: (m,) its rows in the item table and their ``ITEM_DTYPE`` records.
        node_rows, nodes: (n,) all nodes that hold it, and their ``NODE_DTYPE`` records without tiles.
        face: one ``FACE_REPORT_DTYPE`` row.
    """

    surface: int
    part: int
    geometry: GeometryBatch
    item_rows: npt.NDArray[np.int64]
    items: Rows
    node_rows: npt.NDArray[np.int64]
    nodes: Rows
    face: Rows


class EditTables(PartTables, TreeTables, TileTables):
    """Changes that several tables must see together."""

    def put_edit(self, edit: SurfaceEdit) -> None:
        """Store an edit in one transaction; the surface's levels of detail are dropped.

        Tiles that nothing names any more stay stored: a client may be about to fetch one.

        Raises:
            MissingRecordError: there is no such part.
            UsageError: a node of the edit still names a tile.
        """
        items, nodes = clean_rows(edit.items, ITEM_DTYPE), clean_rows(edit.nodes, NODE_DTYPE)
        if (nodes["tile_hash"] != b"").any():
            raise UsageError(f"{self.name}: an edit of surface {edit.surface} leaves a tile that shows it")
        face = clean_rows(edit.face, FACE_REPORT_DTYPE)
        geometry = pack_geometry(edit.geometry)
        had_tile = [row for row in edit.node_rows.tolist() if self.get_nodes(row, 1)["tile_hash"][0]]
        stale = sorted({*self.edited_nodes().tolist(), *had_tile})
        noted = {"count": self.edit_count() + 1, "stale": stale}

        def change(writing: Writing) -> None:
            if writing.find("parts", number_key(edit.part)) is None:
                raise MissingRecordError(f"{self.name}: there is no part {edit.part}")
            writing.put("parts", number_key(edit.part), geometry)
            update_rows(writing, "items", edit.item_rows, items)
            update_rows(writing, "nodes", edit.node_rows, nodes)
            merge_face_rows(writing, face)
            writing.delete("lods", surface_key(edit.surface))
            writing.put("meta", EDITS_KEY, pack_json(noted))

        self.transact(change)

    def put_rebuilt(self, rows: npt.NDArray[np.int64], nodes: Rows) -> None:
        """Store the final records of all nodes that were stale, and that none is any more, in one transaction."""
        cleaned = clean_rows(nodes, NODE_DTYPE)
        noted = {"count": self.edit_count(), "stale": []}

        def change(writing: Writing) -> None:
            update_rows(writing, "nodes", rows, cleaned)
            writing.put("meta", EDITS_KEY, pack_json(noted))

        self.transact(change)

    def edit_count(self) -> int:
        """How often surfaces of this store were replaced; what was read before the last time may be out of date."""
        return int(self.read_json("meta", EDITS_KEY).get("count", 0))

    def edited_nodes(self) -> npt.NDArray[np.int64]:
        """Ascending rows of the nodes whose tiles edits have dropped, until ``put_rebuilt``."""
        return np.array(self.read_json("meta", EDITS_KEY).get("stale", []), np.int64)

    def stale_nodes(self) -> npt.NDArray[np.int64]:
        """Those of ``edited_nodes`` that have no new tile yet."""
        rows = self.edited_nodes()
        return rows[[not self.get_nodes(row, 1)["tile_hash"][0] for row in rows.tolist()]]
