"""In which order tiles are loaded: what shows first, then what a small movement would need.

The priority of a tile says how far the viewer is from needing it (Guthe 2004, 4.2)::

    p = eps_desired / eps_node      for a node itself, when it is finer than what is drawn
    p = eps_node / eps_desired      for the children of a node

p > 1: the picture is too coarse by that factor. p < 1: it would be if the viewer came nearer by it.
What does not show now has p < 1 and comes after all that does. Priorities fall into discrete bins, half
octaves, so that the order is a counting sort and small changes do not shuffle the queue.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_client.residency import ResidencyTable, TileKey
from nurbs_client.scene import Floats, Ints, NodeArrays, Scene
from nurbs_client.screen_error import View, allowed_error, box_distance
from nurbs_client.selection import Selection

BINS_PER_OCTAVE = 2
MAX_BIN = 24  # p above 2**12: everything is missing
MIN_BIN = -6  # p below 1/8: the viewer would have to come eight times nearer
PREFETCH_PRIORITY = 0.25  # children of nodes that would be refined at a quarter of the distance


class Request(NamedTuple):
    """A tile to be loaded. Higher bins first."""

    bin: int
    key: TileKey


def priority_bins(priorities: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Discrete bins of priorities > 0: half octaves, clamped."""
    bins = np.floor(BINS_PER_OCTAVE * np.log2(np.maximum(priorities, 1e-30)))
    return np.asarray(np.clip(bins, MIN_BIN, MAX_BIN), np.int64)


def wanted_keys(scene: Scene, chosen: Selection, levels: npt.NDArray[np.int32]) -> list[TileKey]:
    """Keys of the tiles that a selection lacks: nodes, then LODs at ``levels`` (see ``Selection.wanted_levels``)."""
    surfaces = scene.item_arrays.surface[chosen.wanted_items].tolist()
    lods = [TileKey.of_lod(surface, level) for surface, level in zip(surfaces, levels.tolist(), strict=True)]
    return [TileKey.of_node(row) for row in chosen.wanted_nodes.tolist()] + lods


def visible_requests(
    scene: Scene, chosen: Selection, table: ResidencyTable, levels: npt.NDArray[np.int32]
) -> list[Request]:
    """What the frame itself lacks, most urgent bin first; within a bin, in the tree's order."""
    bins = priority_bins(np.concatenate([chosen.wanted_node_priority, chosen.wanted_item_priority]))
    keys = wanted_keys(scene, chosen, levels)
    return _ordered([Request(number, key) for number, key in zip(bins.tolist(), keys, strict=True)], table)


def prefetch_requests(
    scene: Scene, view: View, target_px: float, table: ResidencyTable, built: npt.NDArray[np.bool_], limit: int
) -> list[Request]:
    """At most ``limit`` nodes that a small movement or turn would need; visibility is not asked.

    Only tiles that exist (``built``, one flag per node) are asked for: nothing is tessellated on a guess.

    Source: Guthe, Balazs, Klein 2004, section 4.2.
    """
    n = len(scene.nodes)
    rows, priorities, queue = np.empty(n, np.int32), np.empty(n), np.empty(n, np.int32)
    count = _surroundings(scene.node_arrays, scene.roots, view, target_px, table.node, queue, rows, priorities)
    rows, priorities = rows[:count][built[rows[:count]]], priorities[:count][built[rows[:count]]]
    bins = priority_bins(priorities)
    first = np.argsort(-bins, kind="stable")[:limit]
    pairs = zip(bins[first].tolist(), rows[first].tolist(), strict=True)
    return _ordered([Request(min(number, -1), TileKey.of_node(row)) for number, row in pairs], table)


def _ordered(requests: list[Request], table: ResidencyTable) -> list[Request]:
    """Drop what is there or broken, name each tile once, sort by bin."""
    seen: set[TileKey] = set()
    result = []
    for request in sorted(requests, key=lambda r: -r.bin):
        if request.key not in seen and table.want(request.key):
            seen.add(request.key)
            result.append(request)
    return result


@helper
def _urgency(nodes: NodeArrays, view: View, target_px: float, row: int) -> float:
    """eps_node / eps_desired by distance alone."""
    distance = max(box_distance(view, nodes.aabb_min[row], nodes.aabb_max[row]), view.near)
    return float(max(nodes.error[row], 1e-300)) / allowed_error(distance / view.focal_px, target_px, view.focal_px)


@kernel
def _surroundings(
    nodes: NodeArrays, roots: Ints, view: View, target_px: float, resident: npt.NDArray[np.uint8],
    queue: Ints, rows: Ints, priorities: Floats,
) -> int:  # fmt: skip
    """Nodes that are not resident although p of their parents is above the limit, by distance alone."""
    tail = 0
    for root in roots:
        queue[tail] = root
        tail += 1
    head = 0
    count = 0
    while head < tail:
        row = queue[head]
        head += 1
        urgency = _urgency(nodes, view, target_px, row)
        if resident[row] == 0:
            # It is in the cut while its parent's error is too large and its own is not: how far from that?
            above = _urgency(nodes, view, target_px, nodes.parent[row]) if nodes.parent[row] >= 0 else 1.0
            rows[count] = row
            priorities[count] = min(1.0, 1.0 / urgency, above)
            count += 1
        if urgency < PREFETCH_PRIORITY:
            continue
        for child in range(nodes.first_child[row], nodes.first_child[row] + nodes.n_children[row]):
            queue[tail] = child
            tail += 1
    return count
