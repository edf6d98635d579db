"""What the tables of a cache promise by themselves: order of errors, nested boxes, every surface in one place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import PartInfo
from nurbs_ooc.measure.violation import Violation

BOX_SLACK = 1e-9  # of a box's size and place: what rounding may leave outside
NAMED = 100  # lost surfaces that get a violation of their own

Rows = npt.NDArray[np.void]


def node_name(nodes: Rows, row: int) -> str:
    """What violations call a node."""
    return f"node {row} {bytes(nodes['key'][row]).decode()}"


def check_tree(nodes: Rows, items: Rows, occurrences: Rows, infos: list[PartInfo]) -> list[Violation]:
    """All that the tables break: ``below a child``, ``out of its parent``, ``lost``, ``twice``."""
    return [*_check_nodes(nodes), *_check_items(nodes, items), *_check_surfaces(items, occurrences, infos)]


def _check_nodes(nodes: Rows) -> list[Violation]:
    """Errors and boxes of nodes against their parents'."""
    out = []
    child = np.flatnonzero(nodes["parent"] >= 0)
    parent = nodes["parent"][child]
    for i in np.flatnonzero(nodes["geometric_error"][child] > nodes["geometric_error"][parent]):
        row = int(child[i])
        own, above = (float(nodes["geometric_error"][r]) for r in (row, parent[i]))
        out.append(Violation(node_name(nodes, row), row, "below a child", own, above))
    low, high = nodes["aabb_min"], nodes["aabb_max"]
    slack = BOX_SLACK * np.maximum(np.abs(low), np.abs(high)).max(initial=0.0)
    outside = np.maximum(low[parent] - low[child], high[child] - high[parent]).max(1) - slack
    for i in np.flatnonzero(~(outside <= 0.0)):
        row = int(child[i])
        out.append(Violation(node_name(nodes, row), row, "out of its parent", float(outside[i]), 0.0))
    return out


def _check_items(nodes: Rows, items: Rows) -> list[Violation]:
    """Every item is a direct surface of exactly one node, and the node that it names."""
    holds = np.zeros(len(items), np.int64)
    wrong = np.zeros(len(items), np.bool_)
    for row in np.flatnonzero(nodes["n_direct"] > 0).tolist():
        own = slice(int(nodes["first_item"][row]), int(nodes["first_item"][row] + nodes["n_direct"][row]))
        holds[own] += 1
        wrong[own] |= items["node"][own] != row
    kinds = [("lost", holds == 0), ("twice", holds > 1), ("in another node", (holds == 1) & wrong)]
    return [Violation(f"item {i}", int(i), kind) for kind, rows in kinds for i in np.flatnonzero(rows)[:NAMED]]


def _check_surfaces(items: Rows, occurrences: Rows, infos: list[PartInfo]) -> list[Violation]:
    """Every surface of every placed part is an item."""
    first = np.array([info.first_surface for info in infos], np.int64)
    count = np.array([info.n_surfaces for info in infos], np.int64)
    here = np.bincount(items["occurrence"], minlength=len(occurrences))
    out: list[Violation] = []
    for occurrence in np.flatnonzero(here != count[occurrences["part"]]).tolist():
        part = int(occurrences["part"][occurrence])
        own = items["surface"][items["occurrence"] == occurrence].astype(np.int64) - first[part]
        times = np.bincount(own[(own >= 0) & (own < count[part])], minlength=int(count[part]))
        name = f"occurrence {occurrence}, part {part} face"
        for kind, rows in (("lost", times == 0), ("twice", times > 1)):
            named = np.flatnonzero(rows)[: NAMED - len(out)].tolist()
            out.extend(Violation(f"{name} {row}", int(first[part] + row), kind) for row in named)
    return out
