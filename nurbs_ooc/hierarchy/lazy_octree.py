"""The lazy octree: every placed surface in exactly one node, boxes that overlap instead of copies.

A node holds items. Its box is the union of their boxes, halved in the middle along each axis into
eight octants (bit 0: x, bit 1: y, bit 2: z; set: the upper half)::

        +-------+-------+      item with an edge longer than half the node's  -> direct surface of the node
        |  2    |   3   |      any other item                                 -> octant of its box centre
        |    [==|=]     |      octant with a single item                      -> direct surface of this node
        +-------+-------+      octant with none                               -> no node
        |  0    |   1   |
        +-------+-------+

The two orders of the tables do not get in each other's way: *nodes* are numbered breadth first inside
their root, so the children of one node are neighbours; *items* lie depth first, a node's direct ones
before those of its first child, so every subtree is one range of items. Partitioning the range of a
node in place gives the second while a queue gives the first.

One addition to the paper: an axis along which the node is shorter than its error (longest edge / r)
makes no direct surfaces. Flat faces side by side in one plane have boxes as thick as their certified
error, each of them as thick as the node; by the letter all of them would be direct surfaces.

Progress: after the direct items are gone, the items that touch the two ends of the longest axis have
their centres on different sides of the middle, so at least two octants are filled or at least one
item is direct. Only where the middle rounds to an end, or where all boxes are one and the
same point, nothing moves: such a node keeps all its items as direct surfaces, and so does one at
``MAX_DEPTH``.

Source: M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", 3.1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_ooc.hierarchy.runs import run_rows

MAX_DEPTH = 32  # octant digits that fit a node key; halving a kilometre 32 times leaves a quarter of a micrometre
MIN_LEVEL = -40  # 2**-40 mm: the level of a node whose box is a single point
N_BINS = 9  # direct surfaces, then the eight octants


@helper
def _bounds_of(boxes: npt.NDArray[np.float64], members: npt.NDArray[np.int64], box: npt.NDArray[np.float64]) -> None:
    """Write the union of the members' boxes: three minima, three maxima."""
    for axis in range(3):
        box[axis] = np.inf
        box[3 + axis] = -np.inf
    for item in members:
        for axis in range(3):
            box[axis] = min(box[axis], boxes[item, axis])
            box[3 + axis] = max(box[3 + axis], boxes[item, 3 + axis])


@helper
def _bin_of(boxes: npt.NDArray[np.float64], item: int, box: npt.NDArray[np.float64], flat: float) -> int:
    """0 for a direct surface, else 1 + octant of the item's centre; ``flat``: edges below it do not count."""
    octant = 0
    for axis in range(3):
        low, high, edge = boxes[item, axis], boxes[item, 3 + axis], box[3 + axis] - box[axis]
        if edge >= flat and high - low > 0.5 * edge:
            return 0
        if 0.5 * low + 0.5 * high >= 0.5 * box[axis] + 0.5 * box[3 + axis]:
            octant |= 1 << axis
    return 1 + octant


@kernel
def _split_root(
    boxes: npt.NDArray[np.float64],
    order: npt.NDArray[np.int64],
    links: npt.NDArray[np.int64],
    node_boxes: npt.NDArray[np.float64],
    edge_over_error: float,
) -> int:
    """Partition ``order`` in place and fill the nodes of one root; returns their number.

    ``links`` rows: parent, first child, children, first item, items, direct, octant, depth.
    """
    bins = np.empty(len(order), np.uint8)
    moved = np.empty(len(order), np.int64)
    links[0] = np.array([-1, 0, 0, 0, len(order), 0, 0, 0])
    n_nodes = 1
    node = 0
    while node < n_nodes:
        first, n_items, depth = links[node, 3], links[node, 4], links[node, 7]
        members = order[first : first + n_items]
        box = node_boxes[node]
        _bounds_of(boxes, members, box)
        flat = (box[3:] - box[:3]).max() / edge_over_error
        # Sort every item into its bin.
        count = np.zeros(N_BINS, np.int64)
        for i in range(n_items):
            bins[i] = _bin_of(boxes, members[i], box, flat) if depth < MAX_DEPTH else 0
            count[bins[i]] += 1
        # A node that would hand all its items to one child would do so for ever.
        stuck = count.max() == n_items
        for i in range(n_items):
            if bins[i] > 0 and (count[bins[i]] == 1 or stuck):
                bins[i] = 0
        start = np.zeros(N_BINS + 1, np.int64)
        for i in range(n_items):
            start[bins[i] + 1] += 1
        start = np.cumsum(start)
        # Append the children, then move the items, keeping their order within a bin.
        links[node, 1] = n_nodes
        links[node, 5] = start[1]
        for b in range(1, N_BINS):
            if start[b + 1] > start[b]:
                links[n_nodes] = np.array([node, 0, 0, first + start[b], start[b + 1] - start[b], 0, b - 1, depth + 1])
                n_nodes += 1
        links[node, 2] = n_nodes - links[node, 1]
        for i in range(n_items):
            moved[start[bins[i]]] = members[i]
            start[bins[i]] += 1
        members[:] = moved[:n_items]
        node += 1
    return n_nodes


def level_of_edge(edge: npt.ArrayLike, edge_over_error: float) -> npt.NDArray[np.int32]:
    """Largest ladder level L with ``2**L <= edge / edge_over_error``, at least ``MIN_LEVEL``.

    Args:
        edge: longest edges of node boxes, mm, >= 0.
        edge_over_error: the paper's r; see ``build.tunables``.
    """
    error = np.asarray(edge, np.float64) / edge_over_error
    exponent = np.frexp(error)[1] - 1
    return np.where(error > 2.0**MIN_LEVEL, exponent, MIN_LEVEL).astype(np.int32)


def _key_texts(links: npt.NDArray[np.int64], material: int) -> list[bytes]:
    """Canonical texts of the node keys: the material, then one octant digit per level."""
    texts = [str(material).encode()]
    for parent, octant, depth in links[1:, [0, 6, 7]].tolist():
        texts.append(texts[parent] + (b"-" if depth == 1 else b"") + b"%d" % octant)
    return texts


def _node_table(
    links: npt.NDArray[np.int64], boxes: npt.NDArray[np.float64], material: int, edge_over_error: float
) -> npt.NDArray[np.void]:
    """The nodes of one root with rows counted from that root."""
    nodes = np.zeros(len(links), NODE_DTYPE)
    for column, name in enumerate(("parent", "first_child", "n_children", "first_item", "n_items", "n_direct")):
        nodes[name] = links[:, column]
    nodes["key"] = _key_texts(links, material)
    nodes["material"] = material
    nodes["aabb_min"], nodes["aabb_max"] = boxes[:, :3], boxes[:, 3:]
    nodes["level"] = level_of_edge((boxes[:, 3:] - boxes[:, :3]).max(axis=1), edge_over_error)
    nodes["geometric_error"] = np.ldexp(1.0, nodes["level"])
    return nodes


def build_lazy_octree(
    items: npt.NDArray[np.void], materials: npt.NDArray[np.integer], edge_over_error: float
) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
    """One lazy octree per material.

    Args:
        items: (n,) ``ITEM_DTYPE`` with finite boxes; their order decides the order within a node.
        materials: (n,) material of each item, >= 0; roots come in rising order of it.
        edge_over_error: r: a node's error budget is its longest edge over r, rounded down to a power of two.

    Returns:
        The node table (tiles still missing, ``geometric_error`` the budget) and the items in the
        order that ``node_record`` asks for, their ``node`` set.

    Raises:
        ValueError: a box is not finite or turned inside out.
    """
    corners = np.concatenate([items["aabb_min"], items["aabb_max"]], axis=1).reshape(-1, 6)
    if not np.isfinite(corners).all() or (corners[:, :3] > corners[:, 3:]).any():
        raise ValueError("lazy octree: an item's box is not finite or has its minimum above its maximum")
    tables, orders, first_row, first_item = [np.zeros(0, NODE_DTYPE)], [np.zeros(0, np.int64)], 0, 0
    for material in np.unique(materials):
        order = np.flatnonzero(materials == material)
        links = np.empty((2 * len(order) + 1, 8), np.int64)
        boxes = np.empty((len(links), 6))
        n_nodes = _split_root(corners, order, links, boxes, edge_over_error)
        nodes = _node_table(links[:n_nodes], boxes[:n_nodes], int(material), edge_over_error)
        nodes["parent"][1:] += first_row
        nodes["first_child"] += first_row
        nodes["first_item"] += first_item
        tables.append(nodes)
        orders.append(order)
        first_row, first_item = first_row + n_nodes, first_item + len(order)
    nodes = np.concatenate(tables)
    placed = items[np.concatenate(orders)].astype(ITEM_DTYPE, copy=False)
    placed["node"][run_rows(nodes["first_item"], nodes["n_direct"])] = np.repeat(
        np.arange(len(nodes)), nodes["n_direct"]
    )
    return nodes, placed
