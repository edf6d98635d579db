"""Which boxes are near which points: every pair, by the plain test of all of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.measure.box_forest import box_distance2


@kernel
def _pairs(boxes, p, reach2, start, pairs):  # type: ignore[no-untyped-def]
    """Count (first call, no ``pairs``) or list the boxes near every point."""
    n = 0
    for i in range(len(p)):
        start[i] = n
        for j in range(len(boxes)):
            if box_distance2(p[i], boxes[j]) <= reach2:
                if n < len(pairs):
                    pairs[n] = j
                n += 1
    start[len(p)] = n
    return n


def near_boxes(
    boxes: npt.NDArray[np.float64], p: npt.NDArray[np.float64], reach: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Boxes within ``reach`` of each of (n, 3) points: offsets (n + 1,) and indices of (m, 6) boxes."""
    start = np.zeros(len(p) + 1, np.int64)
    lists = (np.ascontiguousarray(boxes, float), np.ascontiguousarray(p, float), reach * reach)
    pairs = np.empty(0, np.int64)
    pairs = np.empty(_pairs(*lists, start, pairs), np.int64)
    _pairs(*lists, start, pairs)
    return start, pairs
