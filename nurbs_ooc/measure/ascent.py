"""Climb from the worst samples to worse ones: a pattern search that stays inside the face.

Source: R. Hooke and T. A. Jeeves, "Direct search" solution of numerical and statistical problems,
JACM 8(2), 1961; here with all eight neighbours at once, for every start of every face together.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.trim_region import TrimRegion

DIRECTIONS = np.array([[i, j] for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0) if (i, j) != (0.0, 0.0)])
ROUNDS = 16  # a start moves or halves its step in each: 16 halvings end far below what matters

Floats = npt.NDArray[np.float64]
Distance = Callable[[npt.NDArray[np.int64], Floats], Floats]  # (start index, points) -> distances


def worst_of_each(face: npt.NDArray[np.int64], distance: Floats, n: int) -> npt.NDArray[np.int64]:
    """Rows of the ``n`` largest distances of every face; ``face`` is ascending."""
    order = np.lexsort((-distance, face))
    ordered = face[order]
    return order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < n]


def climb(
    region: TrimRegion, face: npt.NDArray[np.int64], uv: Floats, value: Floats, step: Floats, distance: Distance
) -> tuple[Floats, Floats]:
    """Local maxima of ``distance`` over the faces, begun at ``uv``.

    Args:
        region: the faces; no step leaves them.
        face: (n,) index of each start's face.
        uv: (n, 2) starts.
        value: (n,) what ``distance`` gives there.
        step: (n, 2) first step in each direction.
        distance: measures (start index, point) pairs.

    Returns:
        (n, 2) parameters and (n,) values, none lower than at the start.
    """
    uv, value, step = uv.copy(), value.copy(), step.copy()
    start = np.repeat(np.arange(len(face)), len(DIRECTIONS))
    for _ in range(ROUNDS):
        tried = uv[start] + step[start] * np.tile(DIRECTIONS, (len(face), 1))
        rows = np.flatnonzero(region.contains(face[start], tried))
        found = np.full(len(start), -np.inf)
        found[rows] = distance(start[rows], region.placed.points(face[start[rows]], tried[rows]))
        around = found.reshape(-1, len(DIRECTIONS))
        best = np.argmax(around, axis=1)
        top = around[np.arange(len(face)), best]
        up = top > value
        uv[up], value[up] = tried.reshape(-1, len(DIRECTIONS), 2)[up, best[up]], top[up]
        step[~up] *= 0.5
    return uv, value
