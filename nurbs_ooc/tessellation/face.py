"""One face from its loops to certified triangles: boundary, cells, triangulation, refinement.

Where the face needs more samples on an edge (two polylines cross although their curves do not, or a
boundary segment alone breaks the bound) it asks for them and is done again with the faces along those
edges, so that shared edges stay shared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_cache.local_array import local_line
from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_ooc.bounds.closed_form import closed_form_bounds
from nurbs_ooc.bounds.derivatives import LU, LV
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.predicates import LATTICE
from nurbs_ooc.geometry.surface import PLANE
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import CHILD, GRID, Cells, build_cells
from nurbs_ooc.tessellation.certify_shading import measure_shading, refine_shading, segments_too_long
from nurbs_ooc.tessellation.constraints import flood_inside, insert_constraint
from nurbs_ooc.tessellation.deviation import Check, Frame, can_shrink, segment_bound, worst_bound
from nurbs_ooc.tessellation.edges import AIM, EdgeSamples
from nurbs_ooc.tessellation.fallback import box_diagonal, mask_inside, segment_length, surface_diagonal
from nurbs_ooc.tessellation.grid_points import DONE, FULL, insert_grids
from nurbs_ooc.tessellation.refine import certify, parts_needed
from nurbs_ooc.tessellation.shading import ANGLE, APPEARANCE, Aim, new_corners
from nurbs_ooc.tessellation.shading_cells import DISTANCE_SHARE, insert_both, shading_cells
from nurbs_ooc.tessellation.triangulate import (
    INSIDE,
    N_OUTER,
    N_TRIANGLES,
    Room,
    Triangulation,
    enough_room,
    insert_point,
    new_triangulation,
)
from nurbs_ooc.tessellation.trimming import Boundary, gather_boundary, to_lattice
from nurbs_ooc.tessellation.unfold import unfold_poles

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

DEGRADED = int(FaceStatus.DEGRADED)
EVEN_ODD_MASK = int(FaceReason.EVEN_ODD_MASK)
BOX_AS_POINTS = int(FaceReason.BOX_AS_POINTS)
BUDGET_EXHAUSTED = int(FaceReason.BUDGET_EXHAUSTED)
NORMALS_NOT_KEPT = int(FaceReason.NORMALS_NOT_KEPT)

# Codes of a ``Draft``.
READY, NEEDS_SAMPLES = 0, 1
# Points of one face, absolutely and by what its grids and boundary promise; a face that wants more keeps
# the bound it has reached and says so.
MAX_POINTS = 1 << 21
MOST_POINTS = 24.0
MOST_SHADED = 4.0
SPARE_POINTS = 4096.0
# A gap in the file may take this much of the error; beyond it the surface's share stays and the sum is reported.
GAP_SHARE = 0.5
MAX_BLAMES = 256


class Draft(NamedTuple):
    """A face as ``tessellate_face`` leaves it."""

    code: int  # READY, or NEEDS_SAMPLES: nothing else counts then
    boundary: Boundary
    triangulation: Triangulation
    point: Ints  # (n_boundary,) boundary to lattice points
    frame: Frame
    worst: float  # mm, the largest bound of a triangle
    extra: float  # mm, what a fallback adds to the trim error
    status: int
    reason: int


@leaf
def _metric(c: Cells) -> tuple[float, float]:
    """Root mean square density of columns and rows over the cells: points per parameter unit."""
    area = 0.0
    su = 0.0
    sv = 0.0
    for node in range(len(c.node)):
        if c.node[node, CHILD] >= 0:
            continue
        a, b = c.box[node, 1] - c.box[node, 0], c.box[node, 3] - c.box[node, 2]
        area += a * b
        su += a * b * (c.node[node, GRID + 0] / a) ** 2
        sv += a * b * (c.node[node, GRID + 1] / b) ** 2
    return math.sqrt(su / area), math.sqrt(sv / area)


@leaf
def _plane_metric(g: Tables, row: int) -> tuple[float, float]:
    """Lengths of a plane's two axes: mm per parameter unit."""
    bounds = local_line(5)
    closed_form_bounds(g, row, 0.0, 1.0, 0.0, 1.0, bounds)
    return bounds[LU], bounds[LV]


@leaf
def _grid_points(c: Cells) -> float:
    """Grid points of all leaves together."""
    total = 0.0
    for node in range(len(c.node)):
        if c.node[node, CHILD] < 0:
            total += (c.node[node, GRID + 0] + 1.0) * (c.node[node, GRID + 1] + 1.0)
    return total


@leaf
def _ask(b: Boundary, i: int, parts: int, wanted: Ints) -> None:
    """Ask that the boundary segment from point i be cut into that many parts."""
    wanted[b.segment[i]] = max(wanted[b.segment[i]], parts)


@leaf
def _ask_between(b: Boundary, owner: Ints, p: int, q: int, parts: int, wanted: Ints) -> None:
    """Ask for samples on the segment that joins lattice points p and q, or on those from either."""
    i, j = owner[p], owner[q]
    if i < 0 or j < 0:
        return
    if b.next[i] == j:
        _ask(b, i, parts, wanted)
    elif b.next[j] == i:
        _ask(b, j, parts, wanted)
    else:
        _ask(b, i, parts, wanted)
        _ask(b, j, parts, wanted)


@leaf
def _ask_all(b: Boundary, wanted: Ints) -> None:
    """Ask that all segments be halved."""
    for i in range(len(b.next)):
        _ask(b, i, 2, wanted)


@helper
def _constrain(t: Triangulation, b: Boundary, point: Ints, owner: Ints, pairs: Ints, wanted: Ints) -> tuple[int, float]:
    """Insert all loop segments; how many crossed others, and the longest of those, mm."""
    crossed = np.empty(2, dtype=np.int64)
    lost = 0
    longest = 0.0
    for i in range(len(point)):
        p, q = point[i], point[b.next[i]]
        if p != q and not insert_constraint(t, p, q, pairs, crossed):
            lost += 1
            longest = max(longest, segment_length(b, i))
            _ask(b, i, 2, wanted)
            _ask_between(b, owner, crossed[0], crossed[1], 2, wanted)
    return lost, longest


@leaf
def _triangulate_loops(t: Triangulation, b: Boundary, point: Ints, owner: Ints) -> None:
    """Insert the boundary points; ``point`` maps boundary to lattice points, ``owner`` the first back."""
    for i in range(len(point)):
        px = to_lattice(b.uv[i, 0], b.box[0], b.box[1])
        py = to_lattice(b.uv[i, 1], b.box[2], b.box[3])
        point[i] = insert_point(t, px, py)
        if owner[point[i]] < 0:
            owner[point[i]] = i


@leaf
def _ask_for_long_segments(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, point: Ints, target: float,
    check: Check, wanted: Ints,
) -> bool:  # fmt: skip
    """Ask for parts of all boundary segments that break the bound by themselves; whether there are any."""
    found = False
    for i in range(len(point)):
        bound = segment_bound(g, p, row, c, f, t, point[i], point[b.next[i]], check, target)
        if bound > target and can_shrink(g, p, row, c, f, t, point[i], point[b.next[i]], check, target):
            _ask(b, i, parts_needed(bound / target), wanted)
            found = True
    return found


@leaf
def _any_inside(t: Triangulation) -> bool:
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] != 0:
            return True
    return False


@helper
def _waiting(b: Boundary, t: Triangulation, point: Ints, f: Frame) -> Draft:
    """A face that has asked for samples."""
    return Draft(NEEDS_SAMPLES, b, t, point, f, 0.0, 0.0, 0, 0)


@helper
def _nothing_inside(b: Boundary, t: Triangulation, point: Ints, f: Frame, final: bool, wanted: Ints) -> Draft:
    """A face whose loops enclose nothing: it asks for twice the samples, or its boundary points stand for it."""
    if not final:
        _ask_all(b, wanted)
        return _waiting(b, t, point, f)
    return Draft(READY, b, t, point, f, box_diagonal(b.position), 0.0, DEGRADED, BOX_AS_POINTS)


@helper
def tessellate_face(
    g: Tables, p: Pieces, samples: EdgeSamples, row: int, error: float, final: bool, check: Check,
    wanted: Ints, room: Room, aim: Aim | None, found: Floats,
) -> tuple[Draft, Room]:  # fmt: skip
    """Triangulate surface ``row`` within ``error`` mm.

    With ``final`` False the face may ask for edge samples: it raises ``wanted`` (by segment: the parts
    it must be cut into) and returns NEEDS_SAMPLES. The triangulation lies in ``room``, or in the larger
    one that is returned. ``aim`` is what is to be kept beside the distance, if anything; ``found`` (2,) what is.
    """
    b = gather_boundary(g, samples, row)
    n = len(b.next)
    point = np.full(n, -1, dtype=np.int64)
    size_u, size_v = b.box[1] - b.box[0], b.box[3] - b.box[2]
    f = Frame(b.box[0], b.box[2], size_u / LATTICE, size_v / LATTICE)
    target = max(error - b.trim - b.gap, error * (1.0 - GAP_SHARE)) * AIM
    flat = g.surfaces[row].kind == PLANE
    if size_u <= 0.0 or size_v <= 0.0 or n < 3:
        return _nothing_inside(b, new_triangulation(room, 0, 1.0, 1.0), point, f, final, wanted), room
    planned = target
    if aim is not None:
        flat = flat and aim.n_attributes == 0
        planned *= DISTANCE_SHARE if aim.appearance > 0.0 else 1.0
    c = build_cells(g, p, row, b.box, 1e300 if flat else planned)
    du, dv = _plane_metric(g, row) if flat else _metric(c)
    promised = n + _grid_points(c)
    if aim is not None:
        shades = shading_cells(g, aim, p, row, b.box, target)
        promised += _grid_points(shades)
    capacity = int(min(2.0 * promised + 2.0 * n + 64.0, float(MAX_POINTS)))
    most = int(min(MOST_POINTS * promised + SPARE_POINTS, float(MAX_POINTS)))
    if aim is not None:
        # Normals that turn within a sliver of the domain could ask for any number.
        most = int(min(MOST_SHADED * promised + SPARE_POINTS, float(MAX_POINTS)))
    while True:
        room = enough_room(room, capacity)
        t = new_triangulation(room, capacity, du * f.du * LATTICE, dv * f.dv * LATTICE)
        owner = np.full(capacity + N_OUTER, -1, dtype=np.int64)
        status, reason, extra = 0, 0, 0.0
        _triangulate_loops(t, b, point, owner)
        lost, longest = _constrain(t, b, point, owner, room.pairs, wanted)
        if lost > 0 and not final:
            return _waiting(b, t, point, f), room
        if lost > 0:
            mask_inside(t, b, point)
            status, reason, extra = DEGRADED, EVEN_ODD_MASK, longest
        else:
            flood_inside(t)
        if not _any_inside(t):
            return _nothing_inside(b, t, point, f, final, wanted), room
        if flat:
            return Draft(READY, b, t, point, f, 0.0, extra, status, reason), room
        if not final and _ask_for_long_segments(g, p, row, c, f, t, b, point, target, check, wanted):
            return _waiting(b, t, point, f), room
        blame = np.zeros(3 * MAX_BLAMES + 1, dtype=np.int64)
        worst = 0.0
        if aim is not None:
            found[ANGLE], found[APPEARANCE] = 0.0, 0.0
            corners = new_corners(g, p, row, capacity + N_OUTER, b, owner, found)
            if not final:
                parts = np.zeros(n, dtype=np.int64)
                if segments_too_long(g, p, aim, row, f, t, b, point, target, corners, parts):
                    for i in range(n):
                        _ask(b, i, parts[i], wanted)
                    return _waiting(b, t, point, f), room
            code = DONE
            if promised < MAX_POINTS:
                code = insert_both(t, c, shades, f, check.stack)
            if code == DONE:
                code, worst = refine_shading(g, p, aim, row, c, f, t, b, target, check, corners, final, blame)
        else:
            code = insert_grids(t, c, f, check.stack) if promised < MAX_POINTS else DONE
            if code == DONE:
                code, worst = certify(g, p, row, c, f, t, target, check, blame)
        if code == FULL and capacity < most:
            capacity = min(2 * capacity, most)
            continue
        if code == FULL:
            status, reason, worst = DEGRADED, BUDGET_EXHAUSTED, worst_bound(g, p, row, c, f, t, target, check)
        elif code != DONE and not final:
            for m in range(blame[0]):
                _ask_between(b, owner, blame[3 * m + 1], blame[3 * m + 2], blame[3 * m + 3], wanted)
            return _waiting(b, t, point, f), room
        unfold_poles(g, p, row, c, f, t, b, owner, target, check)
        if aim is not None:
            measure_shading(g, p, aim, row, c, f, t, b, target, check, corners)
            over = found[ANGLE] > aim.normal or (aim.appearance > 0.0 and found[APPEARANCE] > target)
            if status == 0 and over:
                status, reason = DEGRADED, NORMALS_NOT_KEPT
        if worst > target:
            # No point is farther off than the face is large.
            worst = min(worst, surface_diagonal(g, row, b))
            if status == 0:
                status, reason = DEGRADED, BUDGET_EXHAUSTED
        return Draft(READY, b, t, point, f, worst, extra, status, reason), room
