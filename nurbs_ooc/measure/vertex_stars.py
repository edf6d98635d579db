"""The triangles around triangles: those that share a vertex with them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Indices = npt.NDArray[np.int64]


class VertexStars:
    """Looks up neighbours in a mesh.

    Args:
        triangles: (t, 3) vertices.
    """

    def __init__(self, triangles: Indices) -> None:
        self._triangles = triangles
        order = np.argsort(triangles.ravel(), kind="stable")
        self._of_vertex = order // 3
        n = int(triangles.max(initial=-1)) + 1
        self._start = np.searchsorted(triangles.ravel()[order], np.arange(n + 1))

    def around(self, rows: Indices) -> Indices:
        """Ascending rows of all triangles that share a vertex with one of ``rows``, those included."""
        vertices = np.unique(self._triangles[rows])
        first, count = self._start[vertices], self._start[vertices + 1] - self._start[vertices]
        at = np.arange(count.sum()) + np.repeat(first - (np.cumsum(count) - count), count)
        return np.unique(self._of_vertex[at])
