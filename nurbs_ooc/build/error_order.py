"""Parents never promise less than their children: geometric errors from the tiles' ledgers, bottom-up.

A node without a tile counts with its budget, 2**level mm. So does the budget of a built node not:
its ledger is usually smaller, and larger only where a file's own gaps exceed it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.tile import tile_ledger
from nurbs_cache.typed_store import TypedStore


def own_error(store: TypedStore, node: np.void) -> float:
    """Error of a node by itself, mm: its tile's ledger, or its budget while it has none."""
    if node["tile_hash"]:
        return tile_ledger(store.get_tile(bytes(node["tile_hash"]))).total
    return float(np.ldexp(1.0, node["level"]))


def raised(nodes: npt.NDArray[np.void], own: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(n,) the largest error in each node's subtree; children have larger rows than their parents."""
    errors, parents = own.tolist(), nodes["parent"].tolist()
    for row in range(len(errors) - 1, -1, -1):
        parent = parents[row]
        if parent >= 0 and errors[parent] < errors[row]:
            errors[parent] = errors[row]
    return np.array(errors)


def order_errors(store: TypedStore, nodes: npt.NDArray[np.void], known: npt.NDArray[np.bool_]) -> None:
    """Set and store ``geometric_error`` of all nodes.

    Args:
        store: written to.
        nodes: the node table, changed in place.
        known: (n,) rows whose ``geometric_error`` is their own already; others are looked up.
    """
    own = nodes["geometric_error"].copy()
    for row in np.flatnonzero(~known).tolist():
        own[row] = own_error(store, nodes[row])
    errors = raised(nodes, own)
    changed = np.flatnonzero(errors != store.get_nodes()["geometric_error"])
    nodes["geometric_error"] = errors
    if len(changed):
        store.update_nodes(changed, nodes[changed])


def raise_ancestors(store: TypedStore, row: int, error: float) -> None:
    """Store ``error`` as that of node ``row``, and what follows for its ancestors.

    Args:
        row: a node that has just been built; its stored ``geometric_error`` may be its budget.
        error: its own error; its children's are taken into account.
    """
    while row >= 0:
        node = store.get_nodes(row, 1)
        children = store.get_nodes(int(node["first_child"][0]), int(node["n_children"][0]))["geometric_error"]
        highest = max(error, float(children.max(initial=0.0)))
        if highest != node["geometric_error"][0]:
            node["geometric_error"] = highest
            store.update_nodes(row, node)
        row = int(node["parent"][0])
        if row >= 0:
            error = own_error(store, store.get_nodes(row, 1)[0])
