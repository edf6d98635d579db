"""The loops of a face in its triangulation, and the edge samples that they turn out to lack.

A face asks by segment: ``wanted`` (n_samples,) says into how many parts each must be cut.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import Cells
from nurbs_ooc.tessellation.constraints import insert_constraint
from nurbs_ooc.tessellation.deviation import Check, Frame, can_shrink, segment_bound
from nurbs_ooc.tessellation.fallback import segment_length
from nurbs_ooc.tessellation.refine import parts_needed
from nurbs_ooc.tessellation.triangulate import Triangulation, insert_point
from nurbs_ooc.tessellation.trimming import Boundary, to_lattice

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Segments that cross are cut into so many parts a round: webs down to a millionth are told apart in time.
CROSSED_PARTS = 3


@leaf
def ask(b: Boundary, i: int, parts: int, wanted: Ints) -> None:
    """Ask that the boundary segment from point i be cut into that many parts."""
    wanted[b.segment[i]] = max(wanted[b.segment[i]], parts)


@leaf
def ask_between(b: Boundary, owner: Ints, p: int, q: int, parts: int, wanted: Ints) -> None:
    """Ask for samples on the segment that joins lattice points p and q, or on those from either."""
    i, j = owner[p], owner[q]
    if i < 0 or j < 0:
        return
    if b.next[i] == j:
        ask(b, i, parts, wanted)
    elif b.next[j] == i:
        ask(b, j, parts, wanted)
    else:
        ask(b, i, parts, wanted)
        ask(b, j, parts, wanted)


@leaf
def ask_all(b: Boundary, wanted: Ints) -> None:
    """Ask that all segments be halved."""
    for i in range(len(b.next)):
        ask(b, i, 2, wanted)


@leaf
def constrain_loops(
    t: Triangulation, b: Boundary, owner: Ints, pairs: Ints, crossed: Ints, wanted: Ints
) -> tuple[int, float]:
    """Insert all loop segments; how many crossed others, and the longest of those, mm. ``crossed`` (2,) is scratch."""
    point = b.point
    lost = 0
    longest = 0.0
    for i in range(len(point)):
        p, q = point[i], point[b.next[i]]
        if p != q and not insert_constraint(t, p, q, pairs, crossed):
            lost += 1
            longest = max(longest, segment_length(b, i))
            ask(b, i, CROSSED_PARTS, wanted)
            ask_between(b, owner, crossed[0], crossed[1], CROSSED_PARTS, wanted)
    return lost, longest


@leaf
def triangulate_loops(t: Triangulation, b: Boundary, owner: Ints) -> None:
    """Insert the boundary points; ``b.point`` maps boundary to lattice points, ``owner`` the first back."""
    point = b.point
    for i in range(len(point)):
        px = to_lattice(b.uv[i, 0], b.box[0], b.box[1])
        py = to_lattice(b.uv[i, 1], b.box[2], b.box[3])
        point[i] = insert_point(t, px, py)
        if owner[point[i]] < 0:
            owner[point[i]] = i


@leaf
def ask_for_long_segments(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, target: float, check: Check,
    wanted: Ints,
) -> bool:  # fmt: skip
    """Ask for parts of all boundary segments that break the bound by themselves; whether there are any."""
    point = b.point
    found = False
    for i in range(len(point)):
        bound = segment_bound(g, p, row, c, f, t, point[i], point[b.next[i]], check, target)
        if bound > target and can_shrink(g, p, row, c, f, t, point[i], point[b.next[i]], check, target):
            ask(b, i, parts_needed(bound / target), wanted)
            found = True
    return found
