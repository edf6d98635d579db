"""A forest of bounding-box trees: one tree per group of boxes, halved at the median centre along its longest side.

Source: C. Ericson, Real-Time Collision Detection, 2005, 6.2 (top-down, object median).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf

LEAF = 4  # boxes a leaf: measuring four triangles costs about as much as two more boxes
STACK = 128  # twice the depth of a halving tree over 2**60 boxes


class BoxForest(NamedTuple):
    """The trees, as kernels take them.

    Attributes:
        order: (n,) the boxes, those of a leaf side by side.
        box: (m, 6) of each node, low corner and high corner.
        first, length: (m,) range of a node in ``order``.
        child: (m,) the first of two neighbouring children, -1 for a leaf.
        roots: (g,) root of each group, -1 where it is empty.
    """

    order: npt.NDArray[np.int64]
    box: npt.NDArray[np.float64]
    first: npt.NDArray[np.int64]
    length: npt.NDArray[np.int64]
    child: npt.NDArray[np.int64]
    roots: npt.NDArray[np.int64]


@leaf
def box_distance2(p, box) -> float:  # type: ignore[no-untyped-def]
    """Squared distance of a point to a box."""
    d2 = 0.0
    for k in range(3):
        d = max(box[k] - p[k], 0.0, p[k] - box[3 + k])
        d2 += d * d
    return d2


@leaf
def _select(centre, order, first, last, middle) -> None:  # type: ignore[no-untyped-def]
    """Move the smallest centres of ``order[first:last]`` before ``middle`` (Hoare's quickselect)."""
    low, high = first, last - 1
    while low < high:
        pivot = centre[order[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while centre[order[i]] < pivot:
                i += 1
            while centre[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def _build(boxes, group_start, order, box, first, length, child, roots):  # type: ignore[no-untyped-def]
    n_nodes = 0
    centre = np.empty(len(order))
    for group in range(len(roots)):
        roots[group] = -1
        if group_start[group] == group_start[group + 1]:
            continue
        roots[group] = n_nodes
        first[n_nodes], length[n_nodes] = group_start[group], group_start[group + 1] - group_start[group]
        pending = n_nodes
        n_nodes += 1
        while pending < n_nodes:
            start, n = first[pending], length[pending]
            own = box[pending]
            own[:3], own[3:] = np.inf, -np.inf
            for i in range(start, start + n):
                for k in range(3):
                    own[k] = min(own[k], boxes[order[i], k])
                    own[3 + k] = max(own[3 + k], boxes[order[i], 3 + k])
            child[pending] = -1
            if n > LEAF:
                axis = np.argmax(own[3:] - own[:3])
                for i in range(start, start + n):
                    centre[order[i]] = boxes[order[i], axis] + boxes[order[i], 3 + axis]
                half = n // 2
                _select(centre, order, start, start + n, start + half)
                child[pending] = n_nodes
                first[n_nodes], length[n_nodes] = start, half
                first[n_nodes + 1], length[n_nodes + 1] = start + half, n - half
                n_nodes += 2
            pending += 1


def box_forest(
    boxes: npt.NDArray[np.float64], groups: npt.NDArray[np.int64] | None = None, n_groups: int = 1
) -> BoxForest:
    """Trees over (n, 6) boxes, finite, low corner and high corner.

    Args:
        boxes: their corners.
        groups: (n,) group of each box, ascending; left out: all are group 0.
        n_groups: number of groups; needed when the last ones may be empty.
    """
    n = len(boxes)
    of = np.zeros(n, np.int64) if groups is None else np.asarray(groups, np.int64)
    start = np.searchsorted(of, np.arange(n_groups + 1))
    size = 2 * max(n, 1)
    forest = BoxForest(
        np.arange(n),
        np.empty((size, 6)),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(n_groups, np.int64),
    )
    _build(np.ascontiguousarray(boxes, float), start, *forest)
    return forest
