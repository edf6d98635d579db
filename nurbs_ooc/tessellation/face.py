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
from nurbs_ooc.bounds.sampled_bound import evaluation_error
from nurbs_ooc.geometry.predicates import LATTICE
from nurbs_ooc.geometry.surface import NURBS, PLANE
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.cells import CHILD, GRID, Cells, build_cells
from nurbs_ooc.tessellation.certify_shading import (
    forget_shading,
    measure_shading,
    refine_shading,
    segments_too_long,
)
from nurbs_ooc.tessellation.constraints import flood_inside
from nurbs_ooc.tessellation.deviation import Frame, closer_bound, worst_bound
from nurbs_ooc.tessellation.edge_samples import EdgeSamples
from nurbs_ooc.tessellation.edges import AIM
from nurbs_ooc.tessellation.fallback import box_diagonal, mask_inside, surface_diagonal
from nurbs_ooc.tessellation.grid_points import DONE, FULL, insert_grids
from nurbs_ooc.tessellation.loops_on_lattice import (
    ask,
    ask_all,
    ask_between,
    ask_for_long_segments,
    constrain_loops,
    triangulate_loops,
)
from nurbs_ooc.tessellation.refine import certify
from nurbs_ooc.tessellation.shading import ANGLE, APPEARANCE, Aim, Corners, new_corners
from nurbs_ooc.tessellation.shading_cells import DISTANCE_SHARE, insert_both, shading_cells
from nurbs_ooc.tessellation.triangulate import (
    INSIDE,
    N_OUTER,
    N_TRIANGLES,
    Triangulation,
    start_triangulation,
    triangles_of,
)
from nurbs_ooc.tessellation.trimming import Boundary, count_points, gather_boundary
from nurbs_ooc.tessellation.unfold import break_folded, unfold_poles
from nurbs_ooc.tessellation.workspace import (
    CAPACITY,
    MORE_BOUNDARY,
    MORE_CELLS,
    MORE_POINTS,
    N_BOUNDARY,
    Workspace,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

DEGRADED = int(FaceStatus.DEGRADED)
EVEN_ODD_MASK = int(FaceReason.EVEN_ODD_MASK)
BOX_AS_POINTS = int(FaceReason.BOX_AS_POINTS)
BUDGET_EXHAUSTED = int(FaceReason.BUDGET_EXHAUSTED)
NORMALS_NOT_KEPT = int(FaceReason.NORMALS_NOT_KEPT)
APPEARANCE_NOT_KEPT = int(FaceReason.APPEARANCE_NOT_KEPT)

# Results of ``tessellate_face``; NO_ROOM: the workspace's ``size`` says what it lacks.
READY, NEEDS_SAMPLES, NO_ROOM = 0, 1, 2
# A result of ``_refine``, beside those of ``certify``: samples have been asked for.
ASKED = 3
# Points of one face, absolutely and by what its grids and boundary promise; a face that wants more keeps
# the bound it has reached and says so.
MAX_POINTS = 1 << 21
MOST_POINTS = 24.0
MOST_SHADED = 16.0  # where normals count: those that turn within a sliver of the domain could ask for any number
SPARE_POINTS = 4096.0
# Folded triangles at poles are mended so often.
MENDINGS = 3
# The bound of a face of so FEW triangles is looked at once more: does this share of it hold for all of them?
FEW, LOOSE = 256, 0.25
# A gap in the file may take this much of the error; beyond it the surface's share stays and the sum is reported.
GAP_SHARE = 0.5


class Draft(NamedTuple):
    """What ``tessellate_face`` says of a face beside its triangulation."""

    error: Floats  # (4,) mm: largest bound of a triangle, trim error, gap, what a fallback adds to the trim error
    code: Ints  # (2,) status and reason, 0 unless the face is DEGRADED
    found: Floats  # (2,) of what is kept beside the distance, see ``shading``


WORST, TRIM, GAP, EXTRA = 0, 1, 2, 3
STATUS, REASON = 0, 1


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
def _any_inside(t: Triangulation) -> bool:
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] != 0:
            return True
    return False


@leaf
def _nothing_inside(b: Boundary, d: Draft, final: bool, wanted: Ints) -> int:
    """A face whose loops enclose nothing: it asks for twice the samples, or its boundary points stand for it."""
    if not final:
        ask_all(b, wanted)
        return NEEDS_SAMPLES
    d.error[WORST] = box_diagonal(b.position)
    d.found[ANGLE], d.found[APPEARANCE] = math.pi, d.error[WORST]
    d.code[STATUS], d.code[REASON] = DEGRADED, BOX_AS_POINTS
    return READY


@helper
def _refine(
    g: Tables, p: Pieces, row: int, c: Cells, shades: Cells, f: Frame, t: Triangulation, b: Boundary, target: float,
    promised: float, final: bool, w: Workspace, wanted: Ints, d: Draft, aim: Aim | None, corners: Corners | None,
) -> int:  # fmt: skip
    """Insert the grids' points and refine: FULL, NEEDS_SAMPLES or what ``certify`` says of boundary edges."""
    planned = promised < MAX_POINTS
    code = DONE
    if aim is not None and corners is not None:
        d.found[ANGLE], d.found[APPEARANCE] = 0.0, 0.0
        if not final:
            parts = np.zeros(len(b.next), dtype=np.int64)
            if segments_too_long(g, p, aim, row, c, f, t, b, target, w.check, corners, parts):
                for i in range(len(parts)):
                    ask(b, i, parts[i], wanted)
                return ASKED
        if planned:
            code = insert_both(t, c, shades, f, w.check.stack)
        if code == DONE:
            code, worst = refine_shading(g, p, aim, row, c, f, t, b, target, w, corners, final)
            d.error[WORST] = worst
    else:
        if planned:
            code = insert_grids(t, c, f, w.check.stack)
        if code == DONE:
            code, worst = certify(g, p, row, c, f, t, target, w.check, w.blame)
            d.error[WORST] = worst
    return code


@helper
def _attempt(
    g: Tables, p: Pieces, row: int, c: Cells, shades: Cells, f: Frame, t: Triangulation, b: Boundary, target: float,
    promised: float, flat: bool, final: bool, w: Workspace, wanted: Ints, d: Draft, aim: Aim | None,
    corners: Corners | None,
) -> int:  # fmt: skip
    """Triangulate and refine in ``t``; NO_ROOM where that is too small, else as ``tessellate_face``."""
    owner = w.drawn.owner
    for i in range(len(t.points)):
        owner[i] = -1
    d.code[STATUS], d.code[REASON], d.error[EXTRA], d.error[WORST] = 0, 0, 0.0, 0.0
    triangulate_loops(t, b, owner)
    lost, longest = constrain_loops(t, b, owner, w.room.pairs, w.check.stack, wanted)
    if lost > 0 and not final:
        return NEEDS_SAMPLES
    if lost > 0:
        mask_inside(t, b, b.point)
        d.code[STATUS], d.code[REASON], d.error[EXTRA] = DEGRADED, EVEN_ODD_MASK, longest
    else:
        flood_inside(t)
    if not _any_inside(t):
        return _nothing_inside(b, d, final, wanted)
    if flat:
        return READY
    if not final and ask_for_long_segments(g, p, row, c, f, t, b, target, w.check, wanted):
        return NEEDS_SAMPLES
    w.blame[0] = 0
    code = _refine(g, p, row, c, shades, f, t, b, target, promised, final, w, wanted, d, aim, corners)
    if code == FULL:
        return NO_ROOM
    if code != DONE and not final:
        # Blames, unless the asking has been done.
        for m in range(w.blame[0]):
            ask_between(b, owner, w.blame[3 * m + 1], w.blame[3 * m + 2], w.blame[3 * m + 3], wanted)
        return NEEDS_SAMPLES
    return READY


@leaf
def _shading_is_over(d: Draft, aim: Aim, target: float) -> bool:
    """Whether more is found than what is asked for beside the distance."""
    return d.found[ANGLE] > aim.normal or (aim.appearance > 0.0 and d.found[APPEARANCE] > target)


@helper
def _settle(
    g: Tables, p: Pieces, row: int, c: Cells, f: Frame, t: Triangulation, b: Boundary, target: float, w: Workspace,
    d: Draft, aim: Aim | None, corners: Corners | None,
) -> None:  # fmt: skip
    """Last touches to a curved face's triangles, and what its bounds are worth."""
    for _ in range(MENDINGS):
        if not unfold_poles(g, p, row, c, f, t, b, w, target) or aim is not None:
            break
        if break_folded(g, row, f, t, b, w):
            w.blame[0] = 0
            code, worst = certify(g, p, row, c, f, t, target, w.check, w.blame)
            if code == FULL:
                worst = worst_bound(g, p, row, c, f, t, target, w.check)
            d.error[WORST] = max(d.error[WORST], worst)
    if aim is not None and corners is not None:
        measure_shading(g, p, aim, row, c, f, t, b, target, w.check, corners)
        if _shading_is_over(d, aim, target):
            # Triangles that were given up may have gone since: what stays is looked at alone.
            d.found[ANGLE], d.found[APPEARANCE] = 0.0, 0.0
            forget_shading(t)
            measure_shading(g, p, aim, row, c, f, t, b, target, w.check, corners)
        if d.code[STATUS] == 0 and _shading_is_over(d, aim, target):
            d.code[STATUS] = DEGRADED
            d.code[REASON] = NORMALS_NOT_KEPT if d.found[ANGLE] > aim.normal else APPEARANCE_NOT_KEPT
    if d.error[WORST] <= target and t.n[N_TRIANGLES] <= FEW:
        # What was enough may be far more than any triangle needs.
        closer = closer_bound(g, p, row, c, f, t, LOOSE * d.error[WORST], w.check)
        d.error[WORST] = min(d.error[WORST], closer)
    if d.error[WORST] > target:
        # No point is farther off than the face is large.
        largest = surface_diagonal(g, row, b)
        d.error[WORST] = min(d.error[WORST], largest)
        # Distance, an attribute, and normals twice, see ``shading_length``.
        d.found[APPEARANCE] = min(d.found[APPEARANCE], math.sqrt(6.0) * largest)
        if d.code[STATUS] == 0:
            d.code[STATUS], d.code[REASON] = DEGRADED, BUDGET_EXHAUSTED


@leaf
def _capacities(promised: float, boundary: int, times: float) -> tuple[int, int]:
    """Room for points to begin with, and at most: ``times`` what is promised."""
    # The boundary's points go in, however many they are.
    capacity = max(int(min(2.0 * promised + 2.0 * boundary + 64.0, float(MAX_POINTS))), boundary + 64)
    return capacity, int(min(times * promised + SPARE_POINTS, float(MAX_POINTS)))


@leaf
def face_frame(box: Floats) -> tuple[float, float, float, float]:
    """The ``Frame`` of a face whose parameters lie in ``box`` (4,)."""
    return box[0], box[2], (box[1] - box[0]) / LATTICE, (box[3] - box[2]) / LATTICE


@helper
def tessellate_face(
    g: Tables, p: Pieces, samples: EdgeSamples, row: int, error: float, final: bool, w: Workspace, wanted: Ints,
    d: Draft, aim: Aim | None,
) -> int:  # fmt: skip
    """Triangulate surface ``row`` within ``error`` mm in the workspace.

    With ``final`` False the face may ask for edge samples: it raises ``wanted`` (by segment: the parts
    it must be cut into) and returns NEEDS_SAMPLES. ``aim`` is what is to be kept beside the distance, if anything.
    """
    n = count_points(g, samples, row)
    w.size[N_BOUNDARY], w.size[CAPACITY] = n, 0
    if n > len(w.boundary.next):
        w.size[MORE_BOUNDARY] = n
        return NO_ROOM
    r = w.boundary
    trim, gap = gather_boundary(g, samples, row, r, w.scratch)
    d.error[TRIM], d.error[GAP], d.error[EXTRA] = trim, gap, 0.0
    b = Boundary(
        r.uv[:n], r.position[:n], r.normal[:n], r.pole[:n], r.next[:n], r.segment[:n], r.point[:n], r.box, trim, gap
    )
    for i in range(n):
        b.point[i] = -1
    if n < 3 or b.box[1] <= b.box[0] or b.box[3] <= b.box[2]:
        return _nothing_inside(b, d, final, wanted)
    u0, v0, du, dv = face_frame(b.box)
    f = Frame(u0, v0, du, dv)
    target = max(error - trim - gap, error * (1.0 - GAP_SHARE)) * AIM
    flat = g.surfaces[row].kind == PLANE
    planned = target
    if aim is not None:
        flat = flat and aim.n_attributes == 0
        planned *= DISTANCE_SHARE if aim.appearance > 0.0 else 1.0
    n_cells = build_cells(g, p, row, b.box, 1e300 if flat else planned, w.cells, w.nets, w.check.stack)
    if n_cells == 0:
        w.size[MORE_CELLS] = 1
        return NO_ROOM
    c = Cells(w.cells.node[:n_cells], w.cells.box[:n_cells])
    w.check.near[0], w.check.widest[0] = 0, 0
    # Where normals count too, triangles that just keep the distance are too long for them: no closer look then.
    w.check.off[0] = evaluation_error(g, row) if g.surfaces[row].kind == NURBS and aim is None else math.inf
    density_u, density_v = _plane_metric(g, row) if flat else _metric(c)
    promised = n + _grid_points(c)
    shades = c
    if aim is not None:
        shades = shading_cells(g, aim, p, row, b.box, target)
        promised += _grid_points(shades)
    capacity, most = _capacities(promised, n, MOST_POINTS if aim is None else MOST_SHADED)
    while True:
        if capacity + N_OUTER > len(w.room.points):
            w.size[MORE_POINTS] = capacity
            return NO_ROOM
        w.size[CAPACITY] = capacity
        points = capacity + N_OUTER
        t = Triangulation(w.room.points[:points], w.room.tri[: triangles_of(points)], w.counts, w.scale)
        start_triangulation(t, density_u * du * LATTICE, density_v * dv * LATTICE)
        if aim is not None:
            corners = new_corners(g, p, row, points, b, w.drawn.owner, d.found, w.scratch)
        else:
            corners = None
        code = _attempt(g, p, row, c, shades, f, t, b, target, promised, flat, final, w, wanted, d, aim, corners)
        if code != NO_ROOM or capacity >= most:
            break
        capacity = min(2 * capacity, most)
    if code == NO_ROOM:
        d.code[STATUS], d.code[REASON] = DEGRADED, BUDGET_EXHAUSTED
        d.error[WORST] = worst_bound(g, p, row, c, f, t, target, w.check)
        code = READY
    if code == READY and not flat and d.code[REASON] != BOX_AS_POINTS:
        _settle(g, p, row, c, f, t, b, target, w, d, aim, corners)
    return code
