"""Lines and points that stand for triangles and lines which quantisation made degenerate.

What a dropped primitive covered must stay covered, or the ledger's quantisation term bounds one direction
only. A triangle that became a segment leaves a line unless something kept has that edge; one that became a
point leaves a point unless something kept lies there. Edges and points are compared by their places on the
grid, not by vertex numbers: faces share no vertices.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel

Indices = npt.NDArray[np.uint32]
_NOTHING = -1


def uncovered(
    steps: npt.NDArray[np.int32],
    triangles: Indices,
    lines: Indices,
    points: Indices,
    flat_triangles: Indices,
    flat_lines: Indices,
) -> tuple[Indices, Indices]:
    """Lines (., 2) and points to add.

    Args:
        steps: (n, 3) places of the vertices, 0 to 2**21 - 1.
        triangles, lines, points: what is kept.
        flat_triangles, flat_lines: what is dropped.
    """
    corners = np.concatenate([flat_triangles.reshape(-1), flat_lines.reshape(-1)])
    places = np.empty(len(steps), np.int32)  # of a vertex, among those of the dropped corners
    n_places = _number_places(steps, corners, _table(len(corners)), places)
    used = np.zeros(n_places, np.bool_)
    n_edges = _use(places, triangles, lines, points, used, _table(0)[:0])
    edges = _table(n_edges + 3 * len(flat_triangles))
    _use(places, triangles, lines, points, used, edges)
    new_lines = np.empty((3 * len(flat_triangles), 2), np.uint32)
    new_points = np.empty(len(corners), np.uint32)
    n_lines, n_points = _add(places, flat_triangles, corners, used, edges, new_lines, new_points)
    return new_lines[:n_lines], new_points[:n_points]


def _table(n: int) -> npt.NDArray[np.int64]:
    """An empty hash table for n entries, at most half full."""
    return np.full(1 << (2 * n + 1).bit_length(), _NOTHING, np.int64)


@helper
def _find(table, name):  # type: ignore[no-untyped-def]
    """Slot of a name, or the free slot where it belongs."""
    mask = table.shape[0] - 1
    folded = (name ^ name >> 19 ^ name >> 37) & 0x7FFFFFFF
    at = folded * 0x9E3779B1 >> 16 & mask  # below 2**63: nothing wraps
    while table[at] != _NOTHING and table[at] != name:
        at = (at + 1) & mask
    return at


@helper
def _place(steps, vertex):  # type: ignore[no-untyped-def]
    return np.int64(steps[vertex, 0]) << 42 | np.int64(steps[vertex, 1]) << 21 | np.int64(steps[vertex, 2])


@helper
def _pair(a, b):  # type: ignore[no-untyped-def]
    return np.int64(min(a, b)) << 32 | np.int64(max(a, b))


@kernel
def _number_places(steps, corners, table, places):  # type: ignore[no-untyped-def]
    """Number the places of the corners; -1 for vertices elsewhere. Returns the number of places."""
    numbers = np.empty(table.shape[0], np.int32)
    n_places = 0
    for corner in corners:
        at = _find(table, _place(steps, corner))
        if table[at] == _NOTHING:
            table[at] = _place(steps, corner)
            numbers[at] = n_places
            n_places += 1
    for vertex in range(steps.shape[0]):
        at = _find(table, _place(steps, vertex))
        places[vertex] = numbers[at] if table[at] != _NOTHING else _NOTHING
    return n_places


@kernel
def _use(places, triangles, lines, points, used, edges):  # type: ignore[no-untyped-def]
    """Mark the places of what is kept and enter its edges between them; without a table only count these."""
    n_edges = 0
    for t in range(triangles.shape[0]):
        for k in range(3):
            a = places[triangles[t, k]]
            b = places[triangles[t, (k + 1) % 3]]
            if a >= 0:
                used[a] = True
                if b >= 0:
                    n_edges += 1
                    if edges.shape[0] > 0:
                        edges[_find(edges, _pair(a, b))] = _pair(a, b)
    for i in range(lines.shape[0]):
        a = places[lines[i, 0]]
        b = places[lines[i, 1]]
        if a >= 0:
            used[a] = True
        if b >= 0:
            used[b] = True
        if a >= 0 and b >= 0:
            n_edges += 1
            if edges.shape[0] > 0:
                edges[_find(edges, _pair(a, b))] = _pair(a, b)
    for point in points:
        if places[point] >= 0:
            used[places[point]] = True
    return n_edges


@kernel
def _add(places, flat_triangles, corners, used, edges, new_lines, new_points):  # type: ignore[no-untyped-def]
    """Number of lines and points added."""
    n_lines, n_points = 0, 0
    for t in range(flat_triangles.shape[0]):
        for k in range(3):
            start = flat_triangles[t, k]
            end = flat_triangles[t, (k + 1) % 3]
            a = places[start]
            b = places[end]
            if a != b:
                at = _find(edges, _pair(a, b))
                if edges[at] == _NOTHING:
                    edges[at] = _pair(a, b)
                    new_lines[n_lines, 0] = start
                    new_lines[n_lines, 1] = end
                    n_lines += 1
                    used[a] = True
                    used[b] = True
    for corner in corners:
        if not used[places[corner]]:
            used[places[corner]] = True
            new_points[n_points] = corner
            n_points += 1
    return n_lines, n_points
