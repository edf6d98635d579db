"""The lazy octree of a store: nodes and items in pages, and the parameters it was made with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.raw_store import Writing
from nurbs_cache.row_pages import Rows, clean_rows, read_rows, replace_rows, update_rows
from nurbs_cache.scene_tables import SceneTables, pack_json

EDITS_KEY = b"edits"  # in table ``meta``; see ``edit_tables``


class TreeTables(SceneTables):
    """Tables ``tree``, ``nodes`` and ``items``."""

    def put_tree(self, nodes: Rows, items: Rows, params: Mapping[str, Any] | None = None) -> None:
        """Replace the whole tree in one transaction; ``params`` as JSON, part of the content hash."""
        node_rows, item_rows = clean_rows(nodes, NODE_DTYPE), clean_rows(items, ITEM_DTYPE)
        edits = int(self.read_json("meta", EDITS_KEY).get("count", 0))
        head = {"n_nodes": len(node_rows), "n_items": len(item_rows), "params": dict(params or {})}

        def change(writing: Writing) -> None:
            replace_rows(writing, "nodes", node_rows)
            replace_rows(writing, "items", item_rows)
            writing.put("tree", b"head", pack_json(head))
            if writing.find("meta", EDITS_KEY) is not None:  # of nodes that are gone
                writing.put("meta", EDITS_KEY, pack_json({"count": edits + 1, "stale": []}))

        self.transact(change)

    def n_nodes(self) -> int:
        """Number of nodes; 0 before ``put_tree``."""
        return int(self.read_json("tree", b"head").get("n_nodes", 0))

    def n_items(self) -> int:
        """Number of items; 0 before ``put_tree``."""
        return int(self.read_json("tree", b"head").get("n_items", 0))

    def tree_params(self) -> dict[str, Any]:
        """What ``put_tree`` was given."""
        params: dict[str, Any] = self.read_json("tree", b"head").get("params", {})
        return params

    def get_nodes(self, first: int = 0, count: int | None = None) -> Rows:
        """(count,) ``NODE_DTYPE`` from row ``first`` on, by default all; cut off at the end."""
        return read_rows(self, "nodes", NODE_DTYPE, *_clip(first, count, self.n_nodes()))

    def get_items(self, first: int = 0, count: int | None = None) -> Rows:
        """(count,) ``ITEM_DTYPE`` from row ``first`` on, by default all; cut off at the end."""
        return read_rows(self, "items", ITEM_DTYPE, *_clip(first, count, self.n_items()))

    def update_nodes(self, rows: npt.ArrayLike, records: Rows) -> None:
        """Replace the nodes in ``rows`` (one, or an array) by ``records`` in one transaction.

        Raises:
            UsageError: a row does not exist, or there are not as many records as rows.
        """
        numbers = np.atleast_1d(np.asarray(rows, np.int64))
        cleaned = clean_rows(records, NODE_DTYPE)
        n_nodes = self.n_nodes()
        if len(numbers) != len(cleaned):
            raise UsageError(f"{len(cleaned)} node records for {len(numbers)} rows")
        if len(numbers) and (numbers.min() < 0 or numbers.max() >= n_nodes):
            raise UsageError(f"node rows {numbers.min()} to {numbers.max()}, the tree has {n_nodes}")
        self.transact(lambda writing: update_rows(writing, "nodes", numbers, cleaned))


def _clip(first: int, count: int | None, n: int) -> tuple[int, int]:
    """A range of rows that exists."""
    if first < 0 or (count is not None and count < 0):
        raise UsageError(f"rows from {first}, count {count}: neither may be negative")
    start = min(first, n)
    return start, n - start if count is None else min(count, n - start)
