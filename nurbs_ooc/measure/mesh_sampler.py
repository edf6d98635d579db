"""Points of a mesh: corners, middles of edges, centroids and random points of its triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

CORNERS = np.eye(3)
MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
CENTROID = np.full((1, 3), 1.0 / 3.0)


def sample_triangles(
    areas: npt.NDArray[np.float64], start: npt.NDArray[np.int64], per_group: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Random points of groups of triangles, about ``per_group`` each, fewer where a group is small.

    Args:
        areas: (t,) of all triangles.
        start: (g + 1,) offsets of the groups among them.
        per_group: points a group, half of them spread by area.
        rng: where chance comes from.

    Returns:
        group (n,), triangle (n,) and barycentric coordinates (n, 3).
    """
    counts = np.diff(start)
    fixed = np.concatenate([CORNERS, MIDDLES, CENTROID])
    few = np.flatnonzero((counts > 0) & (counts * len(fixed) <= per_group))
    many = np.flatnonzero(counts * len(fixed) > per_group)
    # Small groups: every corner, middle and centroid. Large ones: random ones, half of them by area.
    group, triangle = _all_of(few, start)
    parts = [(np.repeat(group, len(fixed)), np.repeat(triangle, len(fixed)), np.tile(fixed, (len(group), 1)))]
    by_number = np.repeat(many, per_group // 2)
    picked = start[by_number] + (rng.random(len(by_number)) * counts[by_number]).astype(np.int64)
    parts.append((by_number, picked, fixed[rng.integers(0, len(fixed), len(picked))]))
    some = np.flatnonzero(counts)
    by_area = np.repeat(some, max(1, per_group // 2))
    total = np.concatenate([[0.0], np.cumsum(areas + 1e-300)])
    goal = total[start[by_area]] + rng.random(len(by_area)) * (total[start[by_area + 1]] - total[start[by_area]])
    picked = np.clip(np.searchsorted(total, goal, "right") - 1, start[by_area], start[by_area + 1] - 1)
    parts.append((by_area, picked, rng.dirichlet((1.0, 1.0, 1.0), len(picked)).reshape(-1, 3)))
    g, t, b = (np.concatenate(x) for x in zip(*parts, strict=True))
    order = np.argsort(g, kind="stable")
    return g[order], t[order], b[order]


def _all_of(
    groups: npt.NDArray[np.int64], start: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    counts = start[groups + 1] - start[groups]
    group = np.repeat(groups, counts)
    first = np.repeat(start[groups] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    return group, first + np.arange(len(group))
