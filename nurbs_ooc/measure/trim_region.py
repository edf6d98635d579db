r"""Which parameters belong to a trimmed face: its boundary in pieces, sorted by height.

The loops of every face become pieces of curves in (u, v), halved until the surface over each is nearly
straight in space. They are sorted into horizontal strips, so that a point is tested against the few of
its own height::

    v ^   .--------.      strip 2
      |  /   .--.   \     strip 1     a point is inside if a ray to the right
      | (    '--'    )                crosses an odd number of pieces
      |  '----------'     strip 0
      +----------------> u

A loop whose curves leave a gap is closed by a straight segment; a face without loops is its whole
native domain. How coarse the pieces are decides nothing: the test itself is against the exact curves
(``inside``).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.local_array import local_line
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.exact_curve import MAX_DEGREE, curve_point
from nurbs_ooc.measure.inside import MAX_DEPTH, is_inside, strip_of
from nurbs_ooc.measure.placed_faces import PlacedFaces, placed_point

STRAIGHT_SHARE = 0.02  # of its own length that a piece may bend: 40 pieces a circle
BAND_CAUTION = 2.0  # times the bend in (u, v) that three points show
MAX_HALVINGS = 14  # of one knot span; ends the halving at a crease that the tolerance never lets pass
MAX_STRIPS = 4096
ROOM = 64  # pieces a loop that are made room for; more cost a second pass
GAP, SIDE = -1, -2  # in ``coedge``: a straight closing segment, a side of the native domain

SEGMENT_DTYPE = np.dtype(
    [
        ("uv0", "f8", (2,)),
        ("uv1", "f8", (2,)),
        ("t0", "f8"),  # p-curve parameters at the two ends
        ("t1", "f8"),
        ("coedge", "i4"),  # row of the co-edge, GAP or SIDE
        ("deviation", "f8"),  # mm; how far the surface over the segment was seen to leave the 3D chord
        ("band", "f8", (2,)),  # how far the curve leaves its chord in u and in v, with some caution
    ]
)


@leaf
def _boundary_uv(curves, values, curve, side, t, scratch, at) -> None:  # type: ignore[no-untyped-def]
    """``at[0, :2]`` becomes the p-curve's point, or the point at share t of a straight ``side``."""
    if curve >= 0:
        curve_point(values, curves[curve], t, scratch, at)
    else:  # at its ends exactly what it joins
        for k in range(2):
            at[0, k] = side[k] + t * (side[2 + k] - side[k]) if t < 1.0 else side[2 + k]


@leaf
def _bend(tables, placed, uv, s, scratch, band) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """How far the surface over a piece leaves its chord, and the length of the chord; ``band``: the same in (u, v)."""
    row, transform = placed
    deviation, length = 0.0, 0.0
    band[:] = 0.0
    for k in range(1, 4):
        chord, straight = 0.0, 0.0
        u = uv[0, 0] + 0.25 * k * (uv[4, 0] - uv[0, 0])
        v = uv[0, 1] + 0.25 * k * (uv[4, 1] - uv[0, 1])
        band[0], band[1] = max(band[0], abs(uv[k, 0] - u)), max(band[1], abs(uv[k, 1] - v))
        placed_point(tables, row, transform, u, v, scratch, s[5])
        for i in range(3):
            chord += (s[k, 0, i] - (s[0, 0, i] + 0.25 * k * (s[4, 0, i] - s[0, 0, i]))) ** 2
            straight += (s[k, 0, i] - s[5, 0, i]) ** 2
        deviation = max(deviation, chord, straight)
    for i in range(3):
        length += (s[4, 0, i] - s[0, 0, i]) ** 2
    return np.sqrt(deviation), np.sqrt(length)


@leaf
def _span_segments(tables, placed, curve, side, ta, tb, tolerance, coedge, out, n, work) -> int:  # type: ignore[no-untyped-def]
    """Halve [ta, tb] until straight in space; write the segments from ``out[n]`` on, or count if out is short."""
    curves, values = tables[1], tables[2]
    scratch, at, uv, s, stack, band = work
    row, transform = placed
    stack[0, 0], stack[0, 1], stack[0, 2] = ta, tb, 0.0
    top = 1
    while top > 0:
        top -= 1
        a, b, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        for k in range(5):
            t = a + 0.25 * k * (b - a) if k < 4 else b
            _boundary_uv(curves, values, curve, side, t, scratch[0], at)
            uv[k, 0], uv[k, 1] = at[0, 0], at[0, 1]
            placed_point(tables, row, transform, uv[k, 0], uv[k, 1], scratch, s[k])
        deviation, length = _bend(tables, placed, uv, s, scratch, band)
        if depth < MAX_HALVINGS and not deviation <= max(tolerance, STRAIGHT_SHARE * length):
            middle = 0.5 * (a + b)
            stack[top, 0], stack[top, 1], stack[top, 2] = middle, b, depth + 1
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = a, middle, depth + 1
            top += 2
            continue
        if n < len(out):
            for k in range(2):
                out[n].uv0[k], out[n].uv1[k] = uv[0, k], uv[4, k]
                out[n].band[k] = BAND_CAUTION * band[k] if coedge >= 0 else 0.0
            out[n].t0, out[n].t1, out[n].coedge, out[n].deviation = a, b, coedge, deviation
        n += 1
    return n


@leaf
def _curve_segments(tables, placed, coedge, curve, tolerance, out, n, work) -> int:  # type: ignore[no-untyped-def]
    """All segments of a p-curve: knot span by knot span, conics by quarters of their range."""
    curves, values = tables[1], tables[2]
    c = curves[curve]
    side = local_line(4)
    ta = c.t0
    if c.kind == 0:
        for i in range(c.degree, c.n + 1):
            knot = values[c.knots + i]
            if knot > ta and knot < c.t1:
                n = _span_segments(tables, placed, curve, side, ta, knot, tolerance, coedge, out, n, work)
                ta = knot
    else:
        for i in range(1, 4):
            tb = c.t0 + 0.25 * i * (c.t1 - c.t0)
            n = _span_segments(tables, placed, curve, side, ta, tb, tolerance, coedge, out, n, work)
            ta = tb
    return _span_segments(tables, placed, curve, side, ta, c.t1, tolerance, coedge, out, n, work)


@leaf
def _straight(tables, placed, u0, v0, u1, v1, tolerance, coedge, out, n, work) -> int:  # type: ignore[no-untyped-def]
    side = local_line(4)
    side[0], side[1], side[2], side[3] = u0, v0, u1, v1
    return _span_segments(tables, placed, -1, side, 0.0, 1.0, tolerance, coedge, out, n, work)


@kernel
def _segments(surfaces, curves, values, faces, transforms, loops, coedges, tolerances, out, start):  # type: ignore[no-untyped-def]
    """Segments of every face, face after face; ``start`` gets their offsets. Returns how many, even if out is short."""
    scratch = np.empty((3, 2, MAX_DEGREE + 1))
    at = np.zeros((2, 3))
    work = (scratch, at, np.empty((5, 2)), np.empty((6, 3, 3)), np.empty((MAX_HALVINGS + 3, 3)), np.empty(2))
    tables = (surfaces, curves, values)
    ends = np.empty((2, 2))
    n = 0
    for f in range(len(faces)):
        start[f] = n
        s = surfaces[faces[f]]
        placed = (faces[f], transforms[f])
        if s.n_loops == 0:
            for k in range(4):
                a0, a1 = (s.u0, s.u1)[(k + 1) // 2 % 2], (s.v0, s.v1)[k // 2]
                b0, b1 = (s.u0, s.u1)[(k + 2) // 2 % 2], (s.v0, s.v1)[(k + 1) // 2 % 2]
                n = _straight(tables, placed, a0, a1, b0, b1, tolerances[f], SIDE, out, n, work)
        for loop in range(s.first_loop, s.first_loop + s.n_loops):
            first, count = loops[loop].first_coedge, loops[loop].n_coedges
            for i in range(count):
                coedge = coedges[first + i]
                n = _curve_segments(tables, placed, first + i, coedge.pcurve, tolerances[f], out, n, work)
                # Close the gap from this curve's end to the next one's start, if there is one.
                after = coedges[first + (i + 1) % count]
                for e in range(2):
                    one = coedge if e == 0 else after
                    c = curves[one.pcurve]
                    t = c.t1 if (one.reversed != 0) == (e == 1) else c.t0
                    curve_point(values, c, t, scratch[0], at)
                    ends[e, 0], ends[e, 1] = at[0, 0], at[0, 1]
                if ends[0, 0] != ends[1, 0] or ends[0, 1] != ends[1, 1]:
                    a, b = ends[0], ends[1]
                    n = _straight(tables, placed, a[0], a[1], b[0], b[1], tolerances[f], GAP, out, n, work)
    start[len(faces)] = n
    return n


@kernel
def _fill_strips(segments, start, bounds, strip_start, entry_start, entries):  # type: ignore[no-untyped-def]
    """Count (first call, no ``entries``) or list the segments that reach into each strip."""
    for f in range(len(bounds)):
        n_strips = strip_start[f + 1] - strip_start[f]
        for i in range(start[f], start[f + 1]):
            a, b, band = segments[i].uv0[1], segments[i].uv1[1], segments[i].band[1]
            low = strip_of(bounds[f], n_strips, min(a, b) - band)
            high = strip_of(bounds[f], n_strips, max(a, b) + band)
            for strip in range(strip_start[f] + low, strip_start[f] + high + 1):
                if len(entries) > 0:
                    entries[entry_start[strip]] = i
                entry_start[strip] += 1


@kernel
def _inside(pieces, faces, uv, out):  # type: ignore[no-untyped-def]
    scratch, stack = np.empty((2, MAX_DEGREE + 1)), np.empty((MAX_DEPTH + 2, 8))
    for i in range(len(faces)):
        out[i] = is_inside(pieces, faces[i], uv[i, 0], uv[i, 1], scratch, stack)


class TrimRegion:
    """The trimmed parameter regions of some faces of a batch.

    Args:
        geometry: holds the faces.
        faces: (f,) rows of ``geometry.surfaces``; later calls name a face by its index in here.
        tolerance: mm; a piece of boundary that is straight within it is not halved (a scalar or one a face).
        transforms: (f, 3, 4) where the faces stand; left out: as recorded.

    Attributes:
        placed: the faces, to be evaluated.
        segments: all faces' boundary pieces, ``SEGMENT_DTYPE``; of face f from ``start[f]`` on.
        bounds: (f, 4) float64, u_min, v_min, u_max, v_max: a box around each face's pieces.
        pieces: what ``inside.is_inside`` takes.
    """

    def __init__(
        self,
        geometry: GeometryBatch,
        faces: npt.ArrayLike,
        tolerance: npt.ArrayLike,
        transforms: npt.NDArray[np.float64] | None = None,
    ) -> None:
        self.placed = PlacedFaces(geometry, faces, transforms)
        n_faces = len(self.placed)
        tolerances = np.ascontiguousarray(np.broadcast_to(np.asarray(tolerance, float), n_faces))
        self.start = np.zeros(n_faces + 1, np.int64)
        tables = (*self.placed.tables, geometry.loops, geometry.coedges, tolerances)
        loops = geometry.surfaces["n_loops"][self.placed.rows]
        self.segments = np.zeros(ROOM * int(np.maximum(loops, 1).sum()), SEGMENT_DTYPE)
        n = _segments(*tables, self.segments, self.start)
        if n > len(self.segments):
            self.segments = np.zeros(n, SEGMENT_DTYPE)
            _segments(*tables, self.segments, self.start)
        self.segments = self.segments[:n].copy()
        self.bounds = self._bounds()
        strips = self._sort_into_strips()
        self.pieces = (geometry.curves, geometry.values, geometry.coedges, self.segments, self.bounds, *strips)

    def __len__(self) -> int:
        return len(self.placed)

    def _bounds(self) -> npt.NDArray[np.float64]:
        s = self.segments
        low, high = np.minimum(s["uv0"], s["uv1"]) - s["band"], np.maximum(s["uv0"], s["uv1"]) + s["band"]
        bounds = np.zeros((len(self), 4))
        bounds[:, 2:] = -1.0  # a face with no segments at all contains nothing
        some = np.flatnonzero(np.diff(self.start))
        if len(some):
            bounds[some, :2] = np.minimum.reduceat(low, self.start[some])
            bounds[some, 2:] = np.maximum.reduceat(high, self.start[some])
        return bounds

    def _sort_into_strips(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        n_strips = np.clip(np.diff(self.start) // 2, 1, MAX_STRIPS)
        strip_start = np.concatenate([[0], np.cumsum(n_strips)])
        args = (self.segments, self.start, self.bounds, strip_start)
        counts = np.zeros(strip_start[-1], np.int64)
        _fill_strips(*args, counts, np.empty(0, np.int64))
        entry_start = np.concatenate([[0], np.cumsum(counts)])
        entries = np.empty(entry_start[-1], np.int64)
        if len(entries):
            _fill_strips(*args, entry_start[:-1].copy(), entries)
        return strip_start, entry_start, entries

    def contains(self, face: npt.ArrayLike, uv: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """(n,) bool: is each of (n, 2) parameters inside its face (index in ``faces``) by the even-odd rule?"""
        at = np.ascontiguousarray(uv, float).reshape(-1, 2)
        of = np.ascontiguousarray(np.broadcast_to(np.asarray(face, np.int64), len(at)))
        out = np.empty(len(at), np.bool_)
        _inside(self.pieces, of, at, out)
        return out
