"""What quantisation leaves of a tile's primitives, and the order in which its vertices are stored.

A triangle or line of which two corners fall on one grid point is not drawn; ``coverage`` finds what has to
stand for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.connectivity import encode_triangles
from nurbs_cache.coverage import uncovered
from nurbs_cache.errors import UsageError
from nurbs_cache.jit import helper, kernel
from nurbs_cache.triangle_walk import walk_triangles

Indices = npt.NDArray[np.uint32]
Steps = npt.NDArray[np.int32]


def drop_degenerate(
    steps: Steps, triangles: Indices, lines: Indices, points: Indices
) -> tuple[Indices, Indices, Indices]:
    """Triangles (t, 3), lines (l, 2) and points (p,) that remain on the grid, covering what was covered.

    Raises:
        UsageError: an index is not below the number of vertices.
    """
    flat_triangles = np.empty(len(triangles), np.bool_)
    flat_lines = np.empty(len(lines), np.bool_)
    n_flat = _find_degenerate(steps, triangles, lines, points, flat_triangles, flat_lines)
    if n_flat < 0:
        raise UsageError(f"tile: an index is not below its {len(steps)} vertices")
    if n_flat == 0:
        return triangles, lines, points
    kept_triangles, kept_lines = triangles[~flat_triangles], lines[~flat_lines]
    new_lines, new_points = uncovered(
        steps, kept_triangles, kept_lines, points, triangles[flat_triangles], lines[flat_lines]
    )
    return kept_triangles, np.concatenate([kept_lines, new_lines]), np.concatenate([points, new_points])


class Ordered(NamedTuple):
    """Primitives in new vertex numbers.

    Attributes:
        codes, extras: the triangles, see ``connectivity``.
        lines: (l, 2); points: (p,).
        order: (n,) int32: old number of every new one.
        predictors: (n, 3) int32: old numbers a, b, d of the guess a + b - d.
    """

    codes: npt.NDArray[np.uint8]
    extras: npt.NDArray[np.uint8]
    lines: Indices
    points: Indices
    order: npt.NDArray[np.int32]
    predictors: npt.NDArray[np.int32]


def order_vertices(n_vertices: int, triangles: Indices, lines: Indices, points: Indices, *, walk: bool) -> Ordered:
    """Number vertices by first use in triangles, lines, points; unused ones are left out.

    Args:
        walk: put the triangles into an order in which each continues from a recent one.
    """
    labels = np.full(n_vertices, -1, np.int32)
    order = np.empty(n_vertices, np.int32)
    predictors = np.empty((n_vertices, 3), np.int32)
    code = walk_triangles if walk else encode_triangles
    codes, extras, n_predicted = code(triangles, labels, order, predictors)
    n_used, new_lines, new_points = n_predicted, lines, points
    if lines.size or points.size:
        new_lines, new_points = np.empty_like(lines), np.empty_like(points)
        n_used = _number_rest(lines, points, labels, order, predictors, n_predicted, new_lines, new_points)
    return Ordered(codes, extras, new_lines, new_points, order[:n_used], predictors[:n_used])


@helper
def _largest(indices):  # type: ignore[no-untyped-def]
    largest = np.uint32(0)
    for i in range(indices.shape[0]):
        largest = max(largest, indices[i])
    return largest


@kernel
def _find_degenerate(steps, triangles, lines, points, flat_triangles, flat_lines):  # type: ignore[no-untyped-def]
    """Number of degenerate primitives, or -1 if an index is out of range."""
    n_indices = triangles.size + lines.size + points.size
    largest = max(_largest(triangles.reshape(-1)), _largest(lines.reshape(-1)), _largest(points))
    if n_indices > 0 and largest >= steps.shape[0]:
        return -1
    # a grid point as one number: coordinates have 21 bits at most
    place = np.empty(steps.shape[0], np.int64)
    for i in range(steps.shape[0]):
        place[i] = np.int64(steps[i, 0]) | np.int64(steps[i, 1]) << 21 | np.int64(steps[i, 2]) << 42
    n_flat = 0
    for t in range(triangles.shape[0]):
        a, b, c = place[triangles[t, 0]], place[triangles[t, 1]], place[triangles[t, 2]]
        flat = (a == b) | (b == c) | (c == a)
        flat_triangles[t] = flat
        n_flat += flat
    for i in range(lines.shape[0]):
        flat_lines[i] = place[lines[i, 0]] == place[lines[i, 1]]
        n_flat += flat_lines[i]
    return n_flat


@helper
def _relabel(old, labels, order, n_used, new):  # type: ignore[no-untyped-def]
    """New numbers of indices; a vertex without one gets the next. Number of vertices that have one."""
    for i in range(old.shape[0]):
        vertex = old[i]
        if labels[vertex] < 0:
            labels[vertex] = n_used
            order[n_used] = vertex
            n_used += 1
        new[i] = labels[vertex]
    return n_used


@kernel
def _number_rest(  # type: ignore[no-untyped-def]
    lines, points, labels, order, predictors, first, new_lines, new_points
):
    """Lines and points in new numbers; from vertex ``first`` on, each is predicted from the one before."""
    n_used = _relabel(lines.reshape(-1), labels, order, first, new_lines.reshape(-1))
    n_used = _relabel(points, labels, order, n_used, new_points)
    for i in range(first, n_used):
        predictors[i, :] = order[max(i - 1, 0)]
    return n_used
