r"""Vertex clustering: vertices in one cell of a grid get one position, and one normal per direction.

All vertices of a cell move to the middle of their own box, so a vertex moves by at most half the
cell's diagonal, not at all if it is alone, and vertices that coincide stay bit-identical. Normals are
averaged only within ``SAME_NORMAL`` of one another: a cube keeps its edges sharp::

    cell    +-------+          positions: one per cell
            | \   / |          normals:   one per cell and direction
            |   x===|===       vertex of the result = (cell, direction)
            +-------+

Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993;
M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel, leaf
from nurbs_ooc.hlod.hashing import EMPTY, find_slot, new_table

SAME_NORMAL = np.cos(np.radians(30.0))  # smoother than what Gouraud shading shows within a pixel, sharper than any edge
CANCELLED = 1e-3  # sums of unit normals that are shorter have no direction
CELL_BITS = 21  # per axis in a cell's key
MAX_CELLS = 2**CELL_BITS - 2  # per axis; nodes have about 4 r


@dataclass(frozen=True, eq=False)
class Clusters:
    """Where every vertex went.

    Attributes:
        cell: (n,) int32 cell of each vertex, numbered in order of first use.
        vertex: (n,) int32 clustered vertex (cell and direction) of each vertex.
        moved: (n,) float64, mm: how far each vertex moved.
        positions: (n_cells, 3) float64.
        cell_normals: (n_cells, 3) float32, mean of the whole cell, for points.
        normals: (n_vertices, 3) float32, of the clustered vertices.
        vertex_cell: (n_vertices,) int32.
    """

    cell: npt.NDArray[np.int32]
    vertex: npt.NDArray[np.int32]
    moved: npt.NDArray[np.float64]
    positions: npt.NDArray[np.float64]
    cell_normals: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    vertex_cell: npt.NDArray[np.int32]


@leaf
def _box(positions: npt.NDArray[np.float64], box: npt.NDArray[np.float64]) -> None:
    """Least and largest coordinates, to the two rows of ``box``."""
    for axis in range(3):
        box[0, axis], box[1, axis] = np.inf, -np.inf
    for v in range(len(positions)):
        for axis in range(3):
            box[0, axis] = min(box[0, axis], positions[v, axis])
            box[1, axis] = max(box[1, axis], positions[v, axis])


@helper
def _assign_cells(
    positions: npt.NDArray[np.float64], origin: npt.NDArray[np.float64], size: float, cell: npt.NDArray[np.int32]
) -> int:
    """Number the occupied cells in order of their first vertex; returns how many there are."""
    table = new_table(len(positions))
    number = np.empty(len(table), np.int32)
    n_cells = 0
    for v in range(len(positions)):
        key = np.uint64(0)
        for axis in range(3):
            index = np.uint64(np.floor((positions[v, axis] - origin[axis]) / size))
            key = (key << np.uint64(CELL_BITS)) | index
        slot = find_slot(table, key)
        if table[slot] == EMPTY:
            table[slot] = key
            number[slot] = n_cells
            n_cells += 1
        cell[v] = number[slot]
    return n_cells


@leaf
def _centre_cells(
    positions: npt.NDArray[np.float64],
    cell: npt.NDArray[np.int32],
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
    centres: npt.NDArray[np.float64],
    moved: npt.NDArray[np.float64],
) -> None:
    """Middle of the box (``low`` to ``high``) of each cell's vertices, and each vertex's way to it."""
    for c in range(len(centres)):
        for axis in range(3):
            low[c, axis], high[c, axis] = np.inf, -np.inf
    for v in range(len(positions)):
        own = np.uint32(cell[v])
        for axis in range(3):
            low[own, axis] = min(low[own, axis], positions[v, axis])
            high[own, axis] = max(high[own, axis], positions[v, axis])
    for c in range(len(centres)):
        for axis in range(3):
            a, b = low[c, axis], high[c, axis]
            centres[c, axis] = a if a == b else 0.5 * (a + b)
    for v in range(len(positions)):
        own = np.uint32(cell[v])
        square = 0.0
        for axis in range(3):
            square += (positions[v, axis] - centres[own, axis]) ** 2
        moved[v] = np.sqrt(square)


@helper
def _group_normals(
    normals: npt.NDArray[np.float32],
    cell: npt.NDArray[np.int32],
    n_cells: int,
    vertex: npt.NDArray[np.int32],
    sums: npt.NDArray[np.float64],
    vertex_cell: npt.NDArray[np.int32],
) -> int:
    """Clustered vertex of each vertex and the sum of its normals; returns how many there are.

    The first vertex of a group is its leader; a vertex joins the first leader within ``SAME_NORMAL``.
    """
    first = np.full(n_cells, -1, np.int32)  # groups of a cell form a list
    after = np.empty(len(normals), np.int32)
    leader = np.empty(len(normals), np.int32)
    n_groups = 0
    for v in range(len(normals)):
        group, last = first[cell[v]], -1
        while group >= 0:
            dot = 0.0
            for axis in range(3):
                dot += normals[v, axis] * normals[leader[group], axis]
            if dot >= SAME_NORMAL:
                break
            last, group = group, after[group]
        if group < 0:
            group = n_groups
            n_groups += 1
            after[group] = -1
            leader[group] = v
            vertex_cell[group] = cell[v]
            for axis in range(3):
                sums[group, axis] = 0.0
            if last < 0:
                first[cell[v]] = group
            else:
                after[last] = group
        vertex[v] = group
        for axis in range(3):
            sums[group, axis] += normals[v, axis]
    return n_groups


@leaf
def _unit(
    sums: npt.NDArray[np.float64], fallback: npt.NDArray[np.float32], of: npt.NDArray[np.int32],
    out: npt.NDArray[np.float32],
) -> None:  # fmt: skip
    """Normalised rows; row ``of[i]`` of the fallback where the sum has cancelled out."""
    for i in range(len(out)):
        length = np.sqrt(sums[i, 0] ** 2 + sums[i, 1] ** 2 + sums[i, 2] ** 2)
        for axis in range(3):
            out[i, axis] = sums[i, axis] / length if length > CANCELLED else fallback[of[i], axis]


@leaf
def _sum_cells(
    sums: npt.NDArray[np.float64], vertex_cell: npt.NDArray[np.int32], n_vertices: int,
    whole: npt.NDArray[np.float64], leader: npt.NDArray[np.int32],
) -> None:  # fmt: skip
    """Sum of the normals of each cell, and its first clustered vertex."""
    for v in range(n_vertices - 1, -1, -1):
        leader[vertex_cell[v]] = v
        for axis in range(3):
            whole[vertex_cell[v], axis] += sums[v, axis]


@kernel
def _cluster(
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float32],
    origin: npt.NDArray[np.float64],
    size: float,
    cell: npt.NDArray[np.int32],
    vertex: npt.NDArray[np.int32],
    moved: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Fill what is known of each vertex; returns the last four fields of ``Clusters``."""
    n = len(positions)
    # widen the cells where there would be too many, and begin at a corner of the grid below all vertices
    box = np.empty((2, 3))
    _box(positions, box)
    if n == 0:
        box[:] = 0.0
    size = max(size, (box[1] - box[0]).max() / (MAX_CELLS - 1))
    anchor = np.empty(3)
    for axis in range(3):
        anchor[axis] = min(origin[axis] + np.floor((box[0, axis] - origin[axis]) / size) * size, box[0, axis])
    n_cells = _assign_cells(positions, anchor, size, cell)
    centres = np.empty((n_cells, 3))
    _centre_cells(positions, cell, np.empty((n_cells, 3)), np.empty((n_cells, 3)), centres, moved)
    # one normal a direction, and one a cell
    sums, cell_of = np.empty((n, 3)), np.empty(n, np.int32)
    n_vertices = _group_normals(normals, cell, n_cells, vertex, sums, cell_of)
    merged, whole_normals = np.empty((n_vertices, 3), np.float32), np.empty((n_cells, 3), np.float32)
    upward = np.zeros((1, 3), np.float32)
    upward[0, 2] = 1.0
    _unit(sums, upward, np.zeros(n_vertices, np.int32), merged)
    whole, leader = np.zeros((n_cells, 3)), np.empty(n_cells, np.int32)
    _sum_cells(sums, cell_of, n_vertices, whole, leader)
    _unit(whole, merged, leader, whole_normals)
    return centres, whole_normals, merged, cell_of[:n_vertices].copy()


def cluster_vertices(
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float32],
    origin: npt.NDArray[np.float64],
    size: float,
) -> Clusters:
    """Cluster vertices on a grid.

    Args:
        positions: (n, 3) float64, mm.
        normals: (n, 3) float32, unit.
        origin: (3,) a corner of the grid, mm; vertices may lie on any side of it.
        size: edge of a cell, mm, > 0; widened where the vertices span more than ``MAX_CELLS`` of them.
    """
    n = len(positions)
    cell, vertex, moved = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n)
    centres, cell_normals, merged, vertex_cell = _cluster(positions, normals, origin, size, cell, vertex, moved)
    return Clusters(cell, vertex, moved, centres, cell_normals, merged, vertex_cell)
