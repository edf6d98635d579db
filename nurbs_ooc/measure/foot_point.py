"""Feet of points on trimmed faces: the witnesses that a drawn point is near its surface.

Per point and candidate face, two feet are sought: one inside, from the nearest rough triangle of the
face downhill, and one on the boundary, along the nearest piece of it. The nearer counts. A point that
stays too far from all candidates is worth ``search``, which begins from every triangle and every piece
that could reach it; what is then still too far goes to ``FarProof`` of ``certify_far``.

A foot found is a proof that the distance is no larger; that none was found proves nothing.

Source: K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares Problems, 2004,
section 3.2 (Levenberg-Marquardt), with steps clamped to the face's parameter box.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_table
from nurbs_ooc.measure.closest import ClosestPrimitive, nearest_primitive, triangle_distance2
from nurbs_ooc.measure.exact_curve import MAX_DEGREE, curve_point
from nurbs_ooc.measure.face_cells import face_cells
from nurbs_ooc.measure.inside import MAX_DEPTH, is_inside
from nurbs_ooc.measure.placed_faces import placed_point
from nurbs_ooc.measure.trim_region import TrimRegion

MAX_STEPS = 60
SHRINK, GROW = 0.2, 6.0  # of the damping, after a good and a bad step
FIRST_SHARES = 5  # points of a boundary piece that are tried: it is nearly straight
SLIDES = 10  # steps from the best of them
SETTLED = 1e-13  # of the squared distance: a step that gains less is the last
CAUTION = 2.0  # times the bend of a boundary piece that three points show

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@leaf
def _offset2(p, s) -> float:  # type: ignore[no-untyped-def]
    return (s[0] - p[0]) ** 2 + (s[1] - p[1]) ** 2 + (s[2] - p[2]) ** 2


@leaf
def _normal_equations(p, s) -> tuple[float, float, float, float, float]:  # type: ignore[no-untyped-def]
    """J^T J as (a, b; b, c) and J^T r as (g, h) for r = p - S."""
    a, b, c, g, h = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r = p[k] - s[0, k]
        a += s[1, k] * s[1, k]
        b += s[1, k] * s[2, k]
        c += s[2, k] * s[2, k]
        g += s[1, k] * r
        h += s[2, k] * r
    return a, b, c, g, h


@leaf
def _descend(tables, row, transform, box, p, at, work) -> float:  # type: ignore[no-untyped-def]
    """Move ``at`` downhill to a local foot of ``p``, inside ``box``; returns the squared distance left."""
    scratch, s, trial, goal = work
    for k in range(2):
        at[k] = min(box[2 + k], max(box[k], at[k]))
    placed_point(tables, row, transform, at[0], at[1], scratch, s)
    d2, damping = _offset2(p, s[0]), 1e-4
    for _ in range(MAX_STEPS):
        a, b, c, g, h = _normal_equations(p, s)
        # A coordinate that would leave the box is held.
        hold_u = (at[0] <= box[0] and g <= 0.0) or (at[0] >= box[2] and g >= 0.0) or a == 0.0
        hold_v = (at[1] <= box[1] and h <= 0.0) or (at[1] >= box[3] and h >= 0.0) or c == 0.0
        if hold_u and hold_v:
            break
        a, c = a * (1.0 + damping), c * (1.0 + damping)
        det = a * c - b * b
        if hold_u or hold_v or det <= 1e-14 * a * c:
            step_u, step_v = (0.0 if hold_u else g / a), (0.0 if hold_v else h / c)
        else:
            step_u, step_v = (c * g - b * h) / det, (a * h - b * g) / det
        goal[0] = min(box[2], max(box[0], at[0] + step_u))
        goal[1] = min(box[3], max(box[1], at[1] + step_v))
        placed_point(tables, row, transform, goal[0], goal[1], scratch, trial)
        better = _offset2(p, trial[0])
        if better >= d2:
            damping *= GROW
            if damping > 1e9:
                break
            continue
        # What is left to gain, or what was moved, is rounding.
        moved, size2 = _offset2(s[0], trial[0]), trial[0, 0] ** 2 + trial[0, 1] ** 2 + trial[0, 2] ** 2
        small = d2 - better <= SETTLED * d2 or moved <= 1e-31 * size2
        d2, at[0], at[1] = better, goal[0], goal[1]
        for i in range(3):
            for k in range(3):
                s[i, k] = trial[i, k]
        damping = max(1e-12, damping * SHRINK)
        if small:
            break
    return d2


@leaf
def _slide(tables, coedges, segment, row, transform, p, best_uv, work) -> float:  # type: ignore[no-untyped-def]
    """Squared distance of ``p`` to the exact boundary curve over one piece: the best of a few, then Gauss-Newton."""
    scratch, s, _, _ = work
    on = local_table(2, 3)
    best, share, step = np.inf, 0.0, 0.0
    for k in range(FIRST_SHARES + SLIDES):
        # Step from the best point so far; after a bad step, only half as far.
        trial = k / (FIRST_SHARES - 1) if k < FIRST_SHARES else min(1.0, max(0.0, share + step))
        if k >= FIRST_SHARES and trial == share:
            break
        if segment.coedge >= 0:
            t = segment.t0 + trial * (segment.t1 - segment.t0)
            curve_point(tables[2], tables[1][coedges[segment.coedge].pcurve], t, scratch[0], on)
            for j in range(2):
                on[1, j] *= segment.t1 - segment.t0
        else:
            for j in range(2):
                on[1, j] = segment.uv1[j] - segment.uv0[j]
                on[0, j] = segment.uv0[j] + trial * on[1, j]
        placed_point(tables, row, transform, on[0, 0], on[0, 1], scratch, s)
        d2 = _offset2(p, s[0])
        if d2 < best:
            small = best - d2 <= SETTLED * best and k >= FIRST_SHARES
            best, share = d2, trial
            best_uv[0], best_uv[1] = on[0, 0], on[0, 1]
            up, down = 0.0, 0.0
            for j in range(3):
                along = on[1, 0] * s[1, j] + on[1, 1] * s[2, j]
                up += (p[j] - s[0, j]) * along
                down += along * along
            step = up / down if down > 0.0 else 0.0
            if small:
                break
        elif k >= FIRST_SHARES:
            step *= 0.5
    return best


@leaf
def _start_uv(p, t, positions, uv, at) -> None:  # type: ignore[no-untyped-def]
    """Parameters at the foot of ``p`` on a rough triangle, by its barycentric coordinates."""
    a, b, c = positions[t[0]], positions[t[1]], positions[t[2]]
    aa, ab, bb, pa, pb = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        x, y, z = b[k] - a[k], c[k] - a[k], p[k] - a[k]
        aa, ab, bb = aa + x * x, ab + x * y, bb + y * y
        pa, pb = pa + x * z, pb + y * z
    det = aa * bb - ab * ab
    beta, gamma = 1.0 / 3.0, 1.0 / 3.0
    if det > 1e-12 * aa * bb:
        beta = min(1.0, max(0.0, (bb * pa - ab * pb) / det))
        gamma = min(1.0 - beta, max(0.0, (aa * pb - ab * pa) / det))
    for k in range(2):
        at[k] = uv[t[0], k] + beta * (uv[t[1], k] - uv[t[0], k]) + gamma * (uv[t[2], k] - uv[t[0], k])


@kernel
def _nearest(tables, pieces, cells, chords, p, start, candidates, found_uv, found_face, distance):  # type: ignore[no-untyped-def]
    surfaces, curves, values, rows, transforms = tables
    coedges, segments, bounds = pieces[2], pieces[3], pieces[4]
    forest, positions, triangles, uv, leave = cells
    chord_forest, chord_ends, chord_rows = chords
    scratch, stack = np.empty((3, 2, MAX_DEGREE + 1)), np.empty((MAX_DEPTH + 2, 8))
    work = (scratch, np.empty((3, 3)), np.empty((3, 3)), np.empty(2))
    at = np.empty(2)
    records = (surfaces, curves, values)
    for i in range(len(p)):
        best = np.inf
        for j in range(start[i], start[i + 1]):
            f = candidates[j]
            # Inside: downhill from the nearest rough triangle.
            d2, t = nearest_primitive(forest, positions, triangles, f, p[i])
            if t >= 0 and np.sqrt(d2) - leave[t // 2] < best:
                _start_uv(p[i], triangles[t], positions, uv, at)
                d = np.sqrt(_descend(records, rows[f], transforms[f], bounds[f], p[i], at, work))
                if d < best and is_inside(pieces, f, at[0], at[1], scratch[0], stack):
                    best, found_face[i] = d, f
                    found_uv[i, 0], found_uv[i, 1] = at[0], at[1]
            # On the boundary: along the nearest piece.
            d2, e = nearest_primitive(chord_forest, chord_ends, chord_rows, f, p[i])
            if e >= 0 and np.sqrt(d2) - CAUTION * segments[e].deviation < best:
                d = np.sqrt(_slide(records, coedges, segments[e], rows[f], transforms[f], p[i], at, work))
                if d < best:
                    best, found_face[i] = d, f
                    found_uv[i, 0], found_uv[i, 1] = at[0], at[1]
        distance[i] = best


@kernel
def _search(tables, pieces, cells, chords, face, cell_range, segment_range, p, limit):  # type: ignore[no-untyped-def]
    """Smallest distance of ``p`` to one face from every start within ``limit``; first inside, then on the boundary."""
    surfaces, curves, values, rows, transforms = tables
    coedges, segments, bounds = pieces[2], pieces[3], pieces[4]
    _, positions, triangles, uv, leave = cells
    _, chord_ends, chord_rows = chords
    scratch, stack = np.empty((3, 2, MAX_DEGREE + 1)), np.empty((MAX_DEPTH + 2, 8))
    work = (scratch, np.empty((3, 3)), np.empty((3, 3)), np.empty(2))
    at = np.empty(2)
    records = (surfaces, curves, values)
    inner, outer = np.inf, np.inf
    for c in range(cell_range[0], cell_range[1]):
        for t in range(2 * c, 2 * c + 2):
            i, j, k = triangles[t]
            if np.sqrt(triangle_distance2(p, positions[i], positions[j], positions[k])) - leave[c] > limit:
                continue
            _start_uv(p, triangles[t], positions, uv, at)
            d = np.sqrt(_descend(records, rows[face], transforms[face], bounds[face], p, at, work))
            if d < inner and is_inside(pieces, face, at[0], at[1], scratch[0], stack):
                inner = d
    for e in range(segment_range[0], segment_range[1]):
        i, j, k = chord_rows[e]
        away = np.sqrt(triangle_distance2(p, chord_ends[i], chord_ends[j], chord_ends[k]))
        if away - CAUTION * segments[e].deviation > limit:
            continue
        d = np.sqrt(_slide(records, coedges, segments[e], rows[face], transforms[face], p, at, work))
        outer = min(outer, d)
    return inner, outer


class FootFinder:
    """Finds points of trimmed faces near given points.

    Args:
        region: the faces.
    """

    def __init__(self, region: TrimRegion) -> None:
        self.region, n = region, len(region)
        self.cells = face_cells(region)
        rough = ClosestPrimitive(self.cells.positions, self.cells.triangles, self.cells.face, n)
        of = np.repeat(np.arange(n), np.diff(region.start))
        ends = [region.placed.points(of, region.segments[name]) for name in ("uv0", "uv1")]
        m = np.arange(len(of))
        chords = ClosestPrimitive(np.concatenate(ends), np.stack([m, m + len(m), m + len(m)], 1), of, n)
        self._cells = (rough.forest, rough.positions, rough.primitives, self.cells.uv, self.cells.leave)
        self._chords = (chords.forest, chords.positions, chords.primitives)

    def nearest(self, p: Floats, start: Indices, candidates: Indices) -> tuple[Indices, Floats, Floats]:
        """The nearest feet found, two tries a candidate.

        Args:
            p: (n, 3) mm.
            start: (n + 1,) offsets of each point's candidates.
            candidates: indices of faces.

        Returns:
            face (n,), -1 where there is no candidate; (n, 2) parameters; (n,) distances in mm, upper bounds of the
            true ones, inf where there is no candidate.
        """
        n = len(p)
        face, uv, distance = np.full(n, -1), np.full((n, 2), np.nan), np.empty(n)
        lists = (np.ascontiguousarray(p, float), np.asarray(start, np.int64), np.asarray(candidates, np.int64))
        _nearest(self.region.placed.tables, self.region.pieces, self._cells, self._chords, *lists, uv, face, distance)
        return face, uv, distance

    def search(self, p: Floats, face: int, limit: float) -> tuple[float, float]:
        """Distances (mm) of a point to a face, by all starts within ``limit``, and to its boundary or ``limit``."""
        cells, region = self.cells, self.region
        inner, outer = _search(
            region.placed.tables, region.pieces, self._cells, self._chords, face,
            cells.cell_start[face : face + 2], region.start[face : face + 2], p, limit,
        )  # fmt: skip
        return min(inner, outer), min(outer, limit)
