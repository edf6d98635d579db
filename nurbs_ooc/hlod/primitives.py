"""What is drawn of a clustered node: triangles, lines where they are open, points where they are small.

Of each triangle of the soup, after its corners moved to their cells::

    three cells, large  -> triangle, once
    three cells, small  -> a point at each corner: at most 3 px large, and within reach of its corners
    two cells           -> their connection, covered by a triangle's side, else points, else a line
    one cell            -> a point

A boundary segment becomes a line where its two ends are not the side of two triangles: where the
neighbour is welded on there is no crack to fill. A point is dropped where a triangle or a line ends.

Error: a triangle or a line that becomes points is no further from them than its ``reach``, the radius at
which discs around its corners cover it. Reach and the corners' way to their cells are charged together.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_ooc.hlod.cluster import Clusters
from nurbs_ooc.hlod.hashing import EMPTY, find_slot, new_table, pair_key
from nurbs_ooc.hlod.soup import Soup

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int32]


@helper
def _square(a: Array, b: Array) -> float:
    """Squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@helper
def _area(p: Array, q: Array, r: Array) -> float:
    """Area of a triangle by Heron's formula, in Kahan's stable order."""
    x, y, z = np.sqrt(_square(p, q)), np.sqrt(_square(q, r)), np.sqrt(_square(r, p))
    a, c = max(x, y, z), min(x, y, z)
    b = max(min(x, y), min(max(x, y), z))
    return 0.25 * np.sqrt(max(0.0, (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))))


@helper
def _reach(p: Array, q: Array, r: Array, area: float) -> float:
    """Smallest radius at which discs around the corners cover the triangle.

    That is the circumradius if no angle is obtuse. Else the last point to be covered lies on the longest
    side, where the perpendicular bisector of one of the others crosses it.
    """
    a, b, c = _square(q, r), _square(r, p), _square(p, q)
    longest = max(a, b, c)
    rest = a + b + c - longest
    if longest < rest and area > 0.0:
        return np.sqrt(a * b * c) / (4.0 * area)
    other = min(max(a, b), max(b, c), max(a, c))  # the second longest
    # cos of the angle between the longest side and the second longest, by the law of cosines; the
    # bisector of the second longest crosses further out than that of the shortest.
    cosine = (longest + other - (rest - other)) / (2.0 * np.sqrt(longest * other)) if other > 0.0 else 1.0
    return 0.5 * np.sqrt(other) / cosine


@helper
def _is_new_triangle(table: npt.NDArray[np.uint64], kept: Rows, a: int, b: int, c: int, n: int) -> bool:
    """Insert the n-th kept triangle unless the same cells in the same sense are there already."""
    if b < a and b < c:
        a, b, c = b, c, a
    elif c < a and c < b:
        a, b, c = c, a, b
    mask = len(table) - 1
    mixed = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(b) * np.uint64(0xC2B2AE3D27D4EB4F)
    mixed = (mixed ^ np.uint64(c)) * np.uint64(0x165667B19E3779F9)
    slot = np.int64(mixed >> np.uint64(32)) & mask
    while table[slot] != EMPTY:
        other = kept[np.int64(table[slot])]
        if other[0] == a and other[1] == b and other[2] == c:
            return False
        slot = (slot + 1) & mask
    table[slot] = np.uint64(n)
    kept[n, 0], kept[n, 1], kept[n, 2] = a, b, c
    return True


@kernel
def _sort_triangles(
    triangles: Rows,
    cell: Rows,
    moved: Array,
    centres: Array,
    small_area: float,
    allowance: float,
    keep: npt.NDArray[np.bool_],
    wants_point: npt.NDArray[np.bool_],
    links: Rows,
    link_moved: Array,
) -> tuple[int, float]:
    """Mark the triangles to keep and the cells that want a point; collect those that became a connection.

    Returns the number of connections (rows of ``links`` and their corners' way) and the largest charge.
    """
    table = new_table(len(triangles))
    kept = np.empty((len(triangles), 3), np.int32)
    n_kept, n_links, charge = 0, 0, 0.0
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        a, b, c = cell[i], cell[j], cell[k]
        way = max(moved[i], moved[j], moved[k])
        if a == b and b == c:
            wants_point[a] = True
        elif a == b or b == c or c == a:
            links[n_links, 0], links[n_links, 1] = a, (c if a == b else b)
            link_moved[n_links] = way
            n_links += 1
        else:
            area = _area(centres[a], centres[b], centres[c])
            reach = _reach(centres[a], centres[b], centres[c], area) if area <= small_area else np.inf
            if way + reach <= allowance:
                charge = max(charge, way + reach)
                wants_point[a] = wants_point[b] = wants_point[c] = True
            elif _is_new_triangle(table, kept, a, b, c, n_kept):
                keep[t] = True
                n_kept += 1
    return n_links, charge


@kernel
def _sort_connections(
    sides: Rows,
    segments: Rows,
    segment_moved: Array,
    links: Rows,
    link_moved: Array,
    centres: Array,
    allowance: float,
    wants_point: npt.NDArray[np.bool_],
    keep: npt.NDArray[np.bool_],
) -> float:
    """Mark the connections (segments, then links; pairs of cells) that become lines; returns the charge.

    ``sides``: the kept triangles as cells.
    """
    n_segments = len(segments)
    table = new_table(3 * len(sides) + n_segments + len(links))
    used = np.zeros(len(table), np.int32)
    for t in range(len(sides)):
        for k in range(3):
            key = pair_key(sides[t, k], sides[t, (k + 1) % 3])
            slot = find_slot(table, key)
            table[slot] = key
            used[slot] += 1
    charge = 0.0
    for i in range(n_segments + len(links)):
        is_segment = i < n_segments
        a, b = segments[i] if is_segment else links[i - n_segments]
        if a == b:
            wants_point[a] = True
            continue
        key = pair_key(a, b)
        slot = find_slot(table, key)
        table[slot] = key
        if used[slot] >= (2 if is_segment else 1):
            continue
        way = segment_moved[i] if is_segment else link_moved[i - n_segments]
        reach = 0.5 * np.sqrt(_square(centres[a], centres[b]))
        if used[slot] == 0 and way + reach <= allowance:
            charge = max(charge, way + reach)
            wants_point[a] = wants_point[b] = True
            continue
        keep[i] = True
        used[slot] = 2  # once is enough
    return charge


def simplify(soup: Soup, clusters: Clusters, small_area: float, allowance: float) -> tuple[Soup, float]:
    """Keep what is drawn of a clustered soup.

    Args:
        soup: the primitives before clustering.
        clusters: where their vertices went.
        small_area: mm²; triangles up to it may become points.
        allowance: mm; the furthest that clustering and points together may move a primitive.

    Returns:
        The new soup, its vertices in order of use, and how far (mm) any primitive moved at most.
    """
    n_cells = len(clusters.positions)
    wants_point = np.zeros(n_cells, np.bool_)
    wants_point[clusters.cell[soup.points]] = True
    keep = np.zeros(len(soup.triangles), np.bool_)
    links, link_moved = np.empty((len(keep), 2), np.int32), np.empty(len(keep))
    n_links, charge = _sort_triangles(
        soup.triangles, clusters.cell, clusters.moved, clusters.positions, small_area, allowance, keep, wants_point,
        links, link_moved,
    )  # fmt: skip
    triangles = soup.triangles[keep]
    segments, links = clusters.cell[soup.lines], links[:n_links]
    keep_line = np.zeros(len(segments) + n_links, np.bool_)
    segment_moved = clusters.moved[soup.lines].max(axis=1, initial=0.0)
    charge_lines = _sort_connections(
        clusters.cell[triangles], segments, segment_moved, links, link_moved, clusters.positions, allowance,
        wants_point, keep_line,
    )  # fmt: skip
    lines = np.concatenate([segments, links])[keep_line]
    wants_point[clusters.cell[triangles]] = False
    wants_point[lines] = False
    result = _compact(clusters, clusters.vertex[triangles], lines, np.flatnonzero(wants_point).astype(np.int32))
    return result, max(float(clusters.moved.max(initial=0.0)), charge, charge_lines)


@kernel
def _number_by_use(used: Rows, rank: Rows, source: Rows) -> int:
    """Number rows in order of first use, ``rank`` (filled with -1) by row, ``source`` by number; returns how many."""
    n = 0
    for row in used:
        if rank[row] < 0:
            rank[row] = n
            source[n] = row
            n += 1
    return n


def _compact(clusters: Clusters, triangles: Rows, lines: Rows, points: Rows) -> Soup:
    """Number the vertices that are used; lines and points reuse a triangle's vertex of their cell."""
    n_vertices, n_cells = len(clusters.vertex_cell), len(clusters.positions)
    # Rows after those of clustered vertices stand for cells that no triangle uses.
    of_cell = np.arange(n_vertices, n_vertices + n_cells, dtype=np.int32)
    corners = triangles.reshape(-1)
    of_cell[clusters.vertex_cell[corners[::-1]]] = corners[::-1]
    used = np.concatenate([corners, of_cell[lines.reshape(-1)], of_cell[points]])
    rank, source = np.full(n_vertices + n_cells, -1, np.int32), np.empty(n_vertices + n_cells, np.int32)
    source = source[: _number_by_use(used, rank, source)]
    rows = rank[used]
    cells = np.concatenate([clusters.vertex_cell, np.arange(n_cells, dtype=np.int32)])
    normals = np.concatenate([clusters.normals, clusters.cell_normals])
    n, m = corners.size, corners.size + lines.size
    return Soup(
        clusters.positions[cells[source]],
        normals[source],
        rows[:n].reshape(-1, 3),
        rows[n:m].reshape(-1, 2),
        rows[m:],
    )
