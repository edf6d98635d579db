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

from nurbs_cache.jit import helper, kernel, leaf
from nurbs_ooc.hlod.cluster import Clusters
from nurbs_ooc.hlod.hashing import EMPTY, find_slot, new_table, pair_key
from nurbs_ooc.hlod.soup import Soup

CLEARLY = 1.0 + 1e-4  # ratio of squared areas: far more than rounding, for triangles of no more than a node's size

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int32]


@leaf
def _square(places: Array, p: int, q: int) -> float:
    """Squared distance of two places."""
    x, y, z = places[p, 0] - places[q, 0], places[p, 1] - places[q, 1], places[p, 2] - places[q, 2]
    return float(x**2 + y**2 + z**2)


@leaf
def _area(places: Array, p: int, q: int, r: int) -> float:
    """Area of a triangle by Heron's formula, in Kahan's stable order."""
    x, y, z = np.sqrt(_square(places, p, q)), np.sqrt(_square(places, q, r)), np.sqrt(_square(places, r, p))
    a, c = max(x, y, z), min(x, y, z)
    b = max(min(x, y), min(max(x, y), z))
    return float(0.25 * np.sqrt(max(0.0, (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)))))


@leaf
def _surely_larger(centres: Array, a: int, b: int, c: int, area: float) -> bool:
    """Whether a triangle of three cells is larger than ``area``, without roots; False where that is a close call."""
    x0, y0, z0 = centres[a, 0], centres[a, 1], centres[a, 2]
    x1, y1, z1 = centres[b, 0] - x0, centres[b, 1] - y0, centres[b, 2] - z0
    x2, y2, z2 = centres[c, 0] - x0, centres[c, 1] - y0, centres[c, 2] - z0
    x, y, z = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
    return bool(x * x + y * y + z * z > CLEARLY * 4.0 * area * area)


@leaf
def _reach(places: Array, p: int, q: int, r: int, area: float) -> float:
    """Smallest radius at which discs around the corners cover the triangle.

    That is the circumradius if no angle is obtuse. Else the last point to be covered lies on the longest
    side, where the perpendicular bisector of one of the others crosses it.
    """
    a, b, c = _square(places, q, r), _square(places, r, p), _square(places, p, q)
    longest = max(a, b, c)
    rest = a + b + c - longest
    if longest < rest and area > 0.0:
        return float(np.sqrt(a * b * c) / (4.0 * area))
    other = min(max(a, b), max(b, c), max(a, c))  # the second longest
    # cos of the angle between the longest side and the second longest, by the law of cosines; the
    # bisector of the second longest crosses further out than that of the shortest.
    cosine = (longest + other - (rest - other)) / (2.0 * np.sqrt(longest * other)) if other > 0.0 else 1.0
    return float(0.5 * np.sqrt(other) / cosine)


@leaf
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
        other = np.int64(table[slot])
        if kept[other, 0] == a and kept[other, 1] == b and kept[other, 2] == c:
            return False
        slot = (slot + 1) & mask
    table[slot] = np.uint64(n)
    kept[n, 0], kept[n, 1], kept[n, 2] = a, b, c
    return True


@helper
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
) -> tuple[int, int, float]:
    """Mark the triangles to keep and the cells that want a point; collect those that became a connection.

    Returns the number of triangles, that of connections (rows of ``links`` and their corners' way) and the
    largest charge.
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
            reach = np.inf
            if not _surely_larger(centres, a, b, c, small_area):
                area = _area(centres, a, b, c)
                if area <= small_area:
                    reach = _reach(centres, a, b, c, area)
            if way + reach <= allowance:
                charge = max(charge, way + reach)
                wants_point[a] = wants_point[b] = wants_point[c] = True
            elif _is_new_triangle(table, kept, a, b, c, n_kept):
                keep[t] = True
                n_kept += 1
    return n_kept, n_links, charge


@helper
def _sort_connections(
    triangles: Rows,
    kept: npt.NDArray[np.bool_],
    n_kept: int,
    lines: Rows,
    cell: Rows,
    moved: Array,
    links: Rows,
    link_moved: Array,
    centres: Array,
    allowance: float,
    wants_point: npt.NDArray[np.bool_],
    connections: Rows,
) -> tuple[int, float]:
    """Collect the connections (boundary lines, then links; pairs of cells) that become lines.

    Returns their number and the largest charge.
    """
    table = new_table(3 * n_kept + len(lines) + len(links))
    used = np.zeros(len(table), np.int32)
    for t in range(len(triangles)):
        if kept[t]:
            for k in range(3):
                key = pair_key(cell[triangles[t, k]], cell[triangles[t, (k + 1) % 3]])
                slot = find_slot(table, key)
                table[slot] = key
                used[slot] += 1
    n, charge = 0, 0.0
    for i in range(len(lines) + len(links)):
        is_line = i < len(lines)
        if is_line:
            p, q = lines[i, 0], lines[i, 1]
            a, b, way = cell[p], cell[q], max(moved[p], moved[q])
        else:
            a, b, way = links[i - len(lines), 0], links[i - len(lines), 1], link_moved[i - len(lines)]
        if a == b:
            wants_point[a] = True
            continue
        key = pair_key(a, b)
        slot = find_slot(table, key)
        table[slot] = key
        if used[slot] >= (2 if is_line else 1):
            continue
        reach = 0.5 * np.sqrt(_square(centres, a, b))
        if used[slot] == 0 and way + reach <= allowance:
            charge = max(charge, way + reach)
            wants_point[a] = wants_point[b] = True
            continue
        connections[n, 0], connections[n, 1] = a, b
        n += 1
        used[slot] = 2  # once is enough
    return n, charge


@leaf
def _used(row: int, rank: Rows, source: Rows, n: int) -> int:
    """Number ``row`` the ``n``-th if it has no number yet; returns how many have one."""
    if rank[row] < 0:
        rank[row] = n
        source[n] = row
        return n + 1
    return n


@helper
def _compact(
    triangles: Rows,
    kept: npt.NDArray[np.bool_],
    vertex: Rows,
    vertex_cell: Rows,
    connections: Rows,
    wants_point: npt.NDArray[np.bool_],
    new_triangles: Rows,
    new_lines: Rows,
    points: Rows,
    source: Rows,
) -> tuple[int, int]:
    """Number the vertices that are used in order of first use; returns their number and that of the points.

    Lines and points take the first vertex of a triangle in their cell. ``source`` gives the clustered vertex
    of each number, or, counted on from the last of these, the cell that no triangle uses.
    """
    n_vertices = len(vertex_cell)
    rank = np.full(n_vertices + len(wants_point), -1, np.int32)
    of_cell = np.full(len(wants_point), -1, np.int32)
    n, t = 0, 0
    for row in range(len(triangles)):
        if kept[row]:
            for k in range(3):
                v = vertex[triangles[row, k]]
                n = _used(v, rank, source, n)
                new_triangles[t, k] = rank[v]
                wants_point[vertex_cell[v]] = False
                if of_cell[vertex_cell[v]] < 0:
                    of_cell[vertex_cell[v]] = v
            t += 1
    for i in range(len(connections)):
        for k in range(2):
            c = connections[i, k]
            row = of_cell[c] if of_cell[c] >= 0 else n_vertices + c
            n = _used(row, rank, source, n)
            new_lines[i, k] = rank[row]
            wants_point[c] = False
    n_points = 0
    for c in range(len(wants_point)):
        if wants_point[c]:
            row = n_vertices + c
            n = _used(row, rank, source, n)
            points[n_points] = rank[row]
            n_points += 1
    return n, n_points


@leaf
def _gather(
    source: Rows, clusters_positions: Array, normals: npt.NDArray[np.float32], cell_normals: npt.NDArray[np.float32],
    vertex_cell: Rows, positions: Array, new_normals: npt.NDArray[np.float32],
) -> None:  # fmt: skip
    """Positions and normals of the vertices that are used."""
    for i in range(len(source)):
        row = source[i]
        whole = row >= len(vertex_cell)
        c = row - len(vertex_cell) if whole else vertex_cell[row]
        for axis in range(3):
            positions[i, axis] = clusters_positions[c, axis]
            new_normals[i, axis] = cell_normals[c, axis] if whole else normals[row, axis]


@kernel
def _simplify(
    triangles: Rows,
    lines: Rows,
    points: Rows,
    cell: Rows,
    vertex: Rows,
    moved: Array,
    centres: Array,
    normals: npt.NDArray[np.float32],
    cell_normals: npt.NDArray[np.float32],
    vertex_cell: Rows,
    small_area: float,
    allowance: float,
) -> tuple[Array, npt.NDArray[np.float32], Rows, Rows, Rows, float]:
    """Positions, normals, triangles, lines and points of the new soup, and the furthest that any moved."""
    n_cells, n_triangles = len(centres), len(triangles)
    # triangles that stay, that become points, that become connections
    wants_point = np.zeros(n_cells, np.bool_)
    for i in range(len(points)):
        wants_point[cell[points[i]]] = True
    kept = np.zeros(n_triangles, np.bool_)
    links, link_moved = np.empty((n_triangles, 2), np.int32), np.empty(n_triangles)
    n_kept, n_links, charge = _sort_triangles(
        triangles, cell, moved, centres, small_area, allowance, kept, wants_point, links, link_moved
    )
    # connections and boundary lines that stay
    connections = np.empty((len(lines) + n_links, 2), np.int32)
    n_lines, charge_lines = _sort_connections(
        triangles, kept, n_kept, lines, cell, moved, links[:n_links], link_moved, centres, allowance, wants_point,
        connections,
    )  # fmt: skip
    # what is left, in new numbers
    new_triangles, new_lines = np.empty((n_kept, 3), np.int32), np.empty((n_lines, 2), np.int32)
    new_points, source = np.empty(n_cells, np.int32), np.empty(len(vertex_cell) + n_cells, np.int32)
    n, n_points = _compact(
        triangles, kept, vertex, vertex_cell, connections[:n_lines], wants_point, new_triangles, new_lines, new_points,
        source,
    )  # fmt: skip
    positions, new_normals = np.empty((n, 3)), np.empty((n, 3), np.float32)
    _gather(source[:n], centres, normals, cell_normals, vertex_cell, positions, new_normals)
    furthest = max(charge, charge_lines)
    for v in range(len(moved)):
        furthest = max(furthest, moved[v])
    return positions, new_normals, new_triangles, new_lines, new_points[:n_points].copy(), furthest


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
    positions, normals, triangles, lines, points, moved = _simplify(
        soup.triangles, soup.lines, soup.points, clusters.cell, clusters.vertex, clusters.moved, clusters.positions,
        clusters.normals, clusters.cell_normals, clusters.vertex_cell, small_area, allowance,
    )  # fmt: skip
    return Soup(positions, normals, triangles, lines, points), moved
