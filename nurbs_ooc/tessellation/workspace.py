"""Arrays that one face after the other is tessellated in.

Nothing is allocated for a face unless it is larger than all before. What they hold means nothing between
faces, and what comes out does not depend on how large they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_ooc.bounds.triangle_bound import MEASURES
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.cells import COLUMNS, NETS, NODE_COLUMNS, Cells
from nurbs_ooc.tessellation.deviation import Check
from nurbs_ooc.tessellation.triangulate import N_OUTER, Room, room_for

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.uint8]

MAX_BLAMES = 256
# Room for the first face.
CELLS, BOUNDARY, POINTS = 1024, 1024, 4096
# Entries of ``Workspace.size``: what the face at hand has, and what it found too small.
N_BOUNDARY, N_CELLS, CAPACITY, MORE_BOUNDARY, MORE_CELLS, MORE_POINTS = 0, 1, 2, 3, 4, 5


class BoundaryRoom(NamedTuple):
    """Columns of a ``Boundary``, and the lattice point of each of its points."""

    uv: Floats
    position: Floats
    normal: Floats
    pole: Flags
    next: Ints
    segment: Ints
    point: Ints
    box: Floats  # (4,)


class PointRoom(NamedTuple):
    """By lattice point: its boundary point or its vertex, why it has several normals; as it is drawn."""

    owner: Ints
    kind: Flags
    place: Floats  # (n, 3)
    normal: Floats  # (n, 3)


class Workspace(NamedTuple):
    """All of it."""

    boundary: BoundaryRoom
    cells: Cells
    nets: Floats  # (NETS, numbers of the largest net)
    room: Room
    drawn: PointRoom
    check: Check
    blame: Ints  # (3 * MAX_BLAMES + 1,)
    counts: Ints  # (3,) ``Triangulation.n``
    scale: Floats  # (2,) ``Triangulation.scale``
    size: Ints  # (6,) see N_BOUNDARY and after
    scratch: Floats  # (4, MAX_DEGREE + 2)


@leaf
def largest_net(g: Tables, faces: Ints) -> int:
    """Numbers of the largest Bézier net of any of the surfaces."""
    most = 1
    for i in range(len(faces)):
        s = g.surfaces[faces[i]]
        if s.kind == NURBS and s.status != 3:
            most = max(most, (s.degree_u + 1) * (s.degree_v + 1) * (4 if s.rational else 3))
    return most


@helper
def _boundary_room(n: int) -> BoundaryRoom:
    return BoundaryRoom(
        np.empty((n, 2)),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty(n, dtype=np.uint8),
        np.empty(n, dtype=np.int64),
        np.empty(n, dtype=np.int64),
        np.empty(n, dtype=np.int64),
        np.empty(4),
    )


@helper
def _point_room(n: int) -> PointRoom:
    return PointRoom(np.empty(n, dtype=np.int64), np.empty(n, dtype=np.uint8), np.empty((n, 3)), np.empty((n, 3)))


@helper
def new_workspace(g: Tables, faces: Ints) -> Workspace:
    """One for some faces of a part."""
    return Workspace(
        _boundary_room(BOUNDARY),
        Cells(np.empty((CELLS, NODE_COLUMNS), dtype=np.int64), np.empty((CELLS, COLUMNS))),
        np.empty((NETS, largest_net(g, faces))),
        room_for(POINTS),
        _point_room(POINTS + N_OUTER),
        Check(
            np.empty(MEASURES),
            np.empty(256, dtype=np.int64),
            np.zeros(1, dtype=np.int64),
            np.zeros(1),
            np.zeros(1, dtype=np.int64),
        ),
        np.empty(3 * MAX_BLAMES + 1, dtype=np.int64),
        np.zeros(3, dtype=np.int64),
        np.empty(2),
        np.zeros(6, dtype=np.int64),
        np.empty((4, MAX_DEGREE + 2)),
    )


@helper
def larger(w: Workspace) -> Workspace:
    """``w`` with room for what its ``size`` says was missing."""
    boundary, cells, room, drawn = w.boundary, w.cells, w.room, w.drawn
    if w.size[MORE_BOUNDARY] > 0:
        boundary = _boundary_room(2 * w.size[MORE_BOUNDARY])
    if w.size[MORE_CELLS] > 0:
        n = 2 * len(cells.node)
        cells = Cells(np.empty((n, NODE_COLUMNS), dtype=np.int64), np.empty((n, COLUMNS)))
    if w.size[MORE_POINTS] > 0:
        n = 2 * w.size[MORE_POINTS]
        room = room_for(n)
        drawn = _point_room(n + N_OUTER)
    w.size[MORE_BOUNDARY], w.size[MORE_CELLS], w.size[MORE_POINTS] = 0, 0, 0
    return Workspace(boundary, cells, w.nets, room, drawn, w.check, w.blame, w.counts, w.scale, w.size, w.scratch)
