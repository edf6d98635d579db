"""The scene's small tables, held ready: products, materials, nodes, items, occurrences.

They are read once, when the server starts. Nodes change when a tile is built on demand; their digest
is rolled forward by every change, so a client's copy is known to be old without hashing the table.
"""

from __future__ import annotations

import hashlib
import threading

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import MissingRecordError, UsageError
from nurbs_cache.typed_store import TypedStore

Table = npt.NDArray[np.void]


class SceneIndex:
    """What ``/api/scene`` and the table pages answer from; safe to use from several threads.

    Attributes:
        products, materials, units: as the store gives them.
        n_surfaces: of all parts, each once.
        nodes, items, occurrences: tables of the layouts in ``nurbs_cache``.
        roots: rows of the roots, ascending; the nodes of one root are consecutive.
    """

    def __init__(self, store: TypedStore) -> None:
        self.products = store.get_products()
        self.materials = store.get_materials()
        self.units = store.get_units()
        self.nodes = store.get_nodes()
        self.items = store.get_items()
        self.occurrences = store.get_occurrences()
        self.n_surfaces = sum(info.n_surfaces for info in store.part_infos())
        self.roots = np.flatnonzero(self.nodes["parent"] < 0)
        self._digests = {name: _digest(table.tobytes()) for name, table in self._tables().items()}
        self._lock = threading.Lock()

    def _tables(self) -> dict[str, Table]:
        return {"nodes": self.nodes, "items": self.items, "occurrences": self.occurrences}

    def digest(self, table: str) -> str:
        """Hex digest that changes whenever the table does."""
        return self._digests[table]

    def page(self, table: str, first: int, stop: int) -> tuple[bytes, str]:
        """The rows ``first:stop`` as bytes, and the digest of the table at that moment."""
        with self._lock:
            return self._tables()[table][first:stop].tobytes(), self._digests[table]

    def rows_of_root(self, root: int) -> tuple[int, int]:
        """First and past-the-end row of the nodes below (and with) a root.

        Raises:
            UsageError: the row is no root.
        """
        place = int(np.searchsorted(self.roots, root))
        if place == len(self.roots) or self.roots[place] != root:
            raise UsageError(f"node {root} is no root; /api/scene lists the {len(self.roots)} roots")
        ends = [*self.roots[1:].tolist(), len(self.nodes)]
        return root, ends[place]

    def node(self, row: int) -> np.void:
        """A copy of one node.

        Raises:
            MissingRecordError: there is no such row.
        """
        if not 0 <= row < len(self.nodes):
            raise MissingRecordError(f"node {row}: the tree has {len(self.nodes)} nodes")
        with self._lock:
            record: np.void = self.nodes[row].copy()
            return record

    def replace_node(self, row: int, record: np.void) -> None:
        """Take over a node's new record."""
        with self._lock:
            if self.nodes[row] == record:
                return
            self.nodes[row] = record
            self._digests["nodes"] = _digest(self._digests["nodes"].encode(), b"%d" % row, record.tobytes())


def _digest(*parts: bytes) -> str:
    state = hashlib.blake2b(digest_size=16)
    for part in parts:
        state.update(part)
    return state.hexdigest()
