"""Which boxes are near which points, by a tree of the boxes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.measure.box_forest import STACK, BoxForest, box_distance2, box_forest


@kernel
def _pairs(boxes, forest, p, reach2, start, pairs):  # type: ignore[no-untyped-def]
    """List the boxes near every point as far as ``pairs`` is long; returns how many there are."""
    order, box, first, length, child, roots = forest
    stack = np.empty(STACK, np.int64)
    n = 0
    for i in range(len(p)):
        start[i] = n
        stack[0], top = roots[0], 0 if roots[0] < 0 else 1
        while top > 0:
            top -= 1
            node = stack[top]
            if box_distance2(p[i], box[node]) > reach2:
                continue
            if child[node] >= 0:
                stack[top], stack[top + 1] = child[node] + 1, child[node]
                top += 2
                continue
            for j in order[first[node] : first[node] + length[node]]:
                if box_distance2(p[i], boxes[j]) <= reach2:
                    if n < len(pairs):
                        pairs[n] = j
                    n += 1
    start[len(p)] = n
    return n


class NearBoxes:
    """Finds boxes near points.

    Args:
        boxes: (m, 6) low and high corner.
    """

    def __init__(self, boxes: npt.NDArray[np.float64]) -> None:
        self._boxes = np.ascontiguousarray(boxes, float)
        self._forest: BoxForest = box_forest(self._boxes)

    def find(self, p: npt.NDArray[np.float64], reach: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Boxes within ``reach`` of each of (n, 3) points: offsets (n + 1,) and indices."""
        start = np.zeros(len(p) + 1, np.int64)
        points = np.ascontiguousarray(p, float)
        pairs = np.empty(8 * len(p) + 64, np.int64)
        n = _pairs(self._boxes, self._forest, points, reach * reach, start, pairs)
        if n > len(pairs):
            pairs = np.empty(n, np.int64)
            _pairs(self._boxes, self._forest, points, reach * reach, start, pairs)
        return start, pairs[:n]
