"""Which vertices are one point, and which edges have one triangle only."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Ids = npt.NDArray[np.int64]


def weld(positions: npt.NDArray[np.float32]) -> Ids:
    """Number the distinct positions.

    Args:
        positions: (n, 3) float32; equal means equal bits, except that -0 equals 0.

    Returns:
        (n,) ids, equal exactly where the positions are equal, from 0 on without gaps.
    """
    if len(positions) == 0:
        return np.zeros(0, dtype=np.int64)
    bits = np.ascontiguousarray(positions + np.float32(0.0)).view(np.uint32).astype(np.uint64)
    xy = bits[:, 0] | (bits[:, 1] << np.uint64(32))
    order = np.lexsort((xy, bits[:, 2]))
    is_new = np.ones(len(order), dtype=bool)
    is_new[1:] = (np.diff(xy[order]) != 0) | (np.diff(bits[order, 2]) != 0)
    ids = np.empty(len(order), dtype=np.int64)
    ids[order] = np.cumsum(is_new) - 1
    return ids


def edge_counts(corners: Ids) -> tuple[int, int]:
    """Count the edges that are not shared by exactly two triangles.

    Args:
        corners: (t, 3) welded ids, the three of a triangle distinct.

    Returns:
        Number of edges with one triangle (boundary), and with more than two (non-manifold).
    """
    if len(corners) == 0:
        return 0, 0
    ends = corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = np.sort(ends.min(axis=1) << 32 | ends.max(axis=1))
    starts = np.flatnonzero(np.concatenate([[True], np.diff(keys) != 0]))
    counts = np.diff(np.append(starts, len(keys)))
    return int((counts == 1).sum()), int((counts > 2).sum())
