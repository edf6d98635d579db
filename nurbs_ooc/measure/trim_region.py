r"""Which parameters belong to a trimmed face: loops as fine polylines, and the even-odd rule.

The loops of every face become segments in (u, v), halved until the surface over each is straight
within a tolerance in space. Segments are sorted into horizontal strips, so that a point is tested
against the few of its own height::

    v ^   .--------.      strip 2
      |  /   .--.   \     strip 1     a point is inside if a ray to the right
      | (    '--'    )                crosses an odd number of segments
      |  '----------'     strip 0
      +----------------> u

A loop whose curves leave a gap is closed by a straight segment; a face without loops is its whole
native domain. The polylines' own error decides nothing: a sample found to break a promise is tested
again with far finer ones.

Source: M. Shimrat, Algorithm 112: Position of point relative to polygon, CACM 5(8), 1962.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.exact_curve import MAX_DEGREE, curve_point
from nurbs_ooc.measure.exact_surface import surface_point

MAX_HALVINGS = 14  # of one knot span; ends the halving at a crease that the tolerance never lets pass
MAX_STRIPS = 4096
GAP, SIDE = -1, -2  # in ``coedge``: a straight closing segment, a side of the native domain

SEGMENT_DTYPE = np.dtype(
    [
        ("uv0", "f8", (2,)),
        ("uv1", "f8", (2,)),
        ("t0", "f8"),  # p-curve parameters at the two ends
        ("t1", "f8"),
        ("coedge", "i4"),  # row of the co-edge, GAP or SIDE
        ("deviation", "f8"),  # mm; how far the surface over the segment was seen to leave the 3D chord
    ]
)


@helper
def _boundary_uv(curves, values, curve, side, t, scratch, at):  # type: ignore[no-untyped-def]
    """``at[0, :2]`` becomes the p-curve's point, or the point at share t of a straight ``side``."""
    if curve >= 0:
        curve_point(values, curves[curve], t, scratch, at)
    else:
        at[0, 0] = side[0] + t * (side[2] - side[0])
        at[0, 1] = side[1] + t * (side[3] - side[1])


@helper
def _span_segments(tables, row, curve, side, ta, tb, tolerance, coedge, out, n, work):  # type: ignore[no-untyped-def]
    """Halve [ta, tb] until straight in space; write the segments from ``out[n]`` on, or count if out is short."""
    surfaces, curves, values = tables
    scratch, at, uv, s, stack = work
    stack[0, 0], stack[0, 1], stack[0, 2] = ta, tb, 0.0
    top = 1
    while top > 0:
        top -= 1
        a, b, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        for k in range(5):
            t = a + 0.25 * k * (b - a) if k < 4 else b
            _boundary_uv(curves, values, curve, side, t, scratch[0], at)
            uv[k, 0], uv[k, 1] = at[0, 0], at[0, 1]
            surface_point(surfaces, curves, values, row, uv[k, 0], uv[k, 1], scratch, s[k])
        deviation = 0.0
        for k in range(1, 4):
            chord, straight = 0.0, 0.0
            u = uv[0, 0] + 0.25 * k * (uv[4, 0] - uv[0, 0])
            v = uv[0, 1] + 0.25 * k * (uv[4, 1] - uv[0, 1])
            surface_point(surfaces, curves, values, row, u, v, scratch, s[5])
            for i in range(3):
                chord += (s[k, 0, i] - (s[0, 0, i] + 0.25 * k * (s[4, 0, i] - s[0, 0, i]))) ** 2
                straight += (s[k, 0, i] - s[5, 0, i]) ** 2
            deviation = max(deviation, chord, straight)
        deviation = np.sqrt(deviation)
        if depth < MAX_HALVINGS and not deviation <= tolerance:
            middle = 0.5 * (a + b)
            stack[top, 0], stack[top, 1], stack[top, 2] = middle, b, depth + 1
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = a, middle, depth + 1
            top += 2
            continue
        if n < len(out):
            out[n].uv0[0], out[n].uv0[1] = uv[0, 0], uv[0, 1]
            out[n].uv1[0], out[n].uv1[1] = uv[4, 0], uv[4, 1]
            out[n].t0, out[n].t1, out[n].coedge, out[n].deviation = a, b, coedge, deviation
        n += 1
    return n


@helper
def _curve_segments(tables, row, coedge, curve, tolerance, out, n, work):  # type: ignore[no-untyped-def]
    """All segments of a p-curve: knot span by knot span, conics by quarters of their range."""
    _, curves, values = tables
    c = curves[curve]
    side = np.zeros(4)
    ta = c.t0
    if c.kind == 0:
        for i in range(c.degree, c.n + 1):
            knot = values[c.knots + i]
            if knot > ta and knot < c.t1:
                n = _span_segments(tables, row, curve, side, ta, knot, tolerance, coedge, out, n, work)
                ta = knot
    else:
        for i in range(1, 4):
            tb = c.t0 + 0.25 * i * (c.t1 - c.t0)
            n = _span_segments(tables, row, curve, side, ta, tb, tolerance, coedge, out, n, work)
            ta = tb
    return _span_segments(tables, row, curve, side, ta, c.t1, tolerance, coedge, out, n, work)


@helper
def _straight(tables, row, u0, v0, u1, v1, tolerance, coedge, out, n, work):  # type: ignore[no-untyped-def]
    side = np.array([u0, v0, u1, v1])
    return _span_segments(tables, row, -1, side, 0.0, 1.0, tolerance, coedge, out, n, work)


@kernel
def _segments(surfaces, curves, values, loops, coedges, faces, tolerances, out, start):  # type: ignore[no-untyped-def]
    """Segments of every face, face after face; ``start`` gets their offsets. Called twice: count, then fill."""
    scratch = np.empty((3, 2, MAX_DEGREE + 1))
    at = np.zeros((2, 3))
    work = (scratch, at, np.empty((5, 2)), np.empty((6, 3, 3)), np.empty((MAX_HALVINGS + 3, 3)))
    tables = (surfaces, curves, values)
    ends = np.empty((2, 2))
    n = 0
    for f in range(len(faces)):
        start[f] = n
        s = surfaces[faces[f]]
        if s.n_loops == 0:
            for k in range(4):
                a0, a1 = (s.u0, s.u1)[(k + 1) // 2 % 2], (s.v0, s.v1)[k // 2]
                b0, b1 = (s.u0, s.u1)[(k + 2) // 2 % 2], (s.v0, s.v1)[(k + 1) // 2 % 2]
                n = _straight(tables, faces[f], a0, a1, b0, b1, tolerances[f], SIDE, out, n, work)
        for loop in range(s.first_loop, s.first_loop + s.n_loops):
            first, count = loops[loop].first_coedge, loops[loop].n_coedges
            for i in range(count):
                coedge = coedges[first + i]
                n = _curve_segments(tables, faces[f], first + i, coedge.pcurve, tolerances[f], out, n, work)
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
                    n = _straight(tables, faces[f], a[0], a[1], b[0], b[1], tolerances[f], GAP, out, n, work)
    start[len(faces)] = n
    return n


@helper
def _strip(bounds, n, v):  # type: ignore[no-untyped-def]
    height = bounds[3] - bounds[1]
    share = (v - bounds[1]) / height if height > 0.0 else 0.0
    return min(n - 1, max(0, int(share * n)))


@kernel
def _fill_strips(segments, start, bounds, strip_start, entry_start, entries):  # type: ignore[no-untyped-def]
    """Count (first call, no ``entries``) or list the segments that reach into each strip."""
    for f in range(len(bounds)):
        n_strips = strip_start[f + 1] - strip_start[f]
        for i in range(start[f], start[f + 1]):
            a, b = segments[i].uv0[1], segments[i].uv1[1]
            low = _strip(bounds[f], n_strips, min(a, b))
            high = _strip(bounds[f], n_strips, max(a, b))
            for strip in range(strip_start[f] + low, strip_start[f] + high + 1):
                if len(entries) > 0:
                    entries[entry_start[strip]] = i
                entry_start[strip] += 1


@kernel
def _inside(segments, bounds, strip_start, entry_start, entries, faces, uv, out):  # type: ignore[no-untyped-def]
    for i in range(len(faces)):
        f = faces[i]
        u, v = uv[i, 0], uv[i, 1]
        out[i] = False
        if not (bounds[f, 0] <= u <= bounds[f, 2] and bounds[f, 1] <= v <= bounds[f, 3]):
            continue
        strip = strip_start[f] + _strip(bounds[f], strip_start[f + 1] - strip_start[f], v)
        odd = False
        for e in range(entry_start[strip], entry_start[strip + 1]):
            a, b = segments[entries[e]].uv0, segments[entries[e]].uv1
            if (a[1] <= v) != (b[1] <= v):
                # Orient the segment upwards, so that both its users round alike.
                x0, y0, x1, y1 = (a[0], a[1], b[0], b[1]) if a[1] < b[1] else (b[0], b[1], a[0], a[1])
                if (x1 - x0) * (v - y0) - (u - x0) * (y1 - y0) > 0.0:
                    odd = not odd
        out[i] = odd


class TrimRegion:
    """The trimmed parameter regions of some faces of a batch.

    Args:
        geometry: holds the faces.
        faces: (f,) rows of ``geometry.surfaces``; later calls name a face by its index in here.
        tolerance: mm; the surface over each segment is straight within it (a scalar or one a face).

    Attributes:
        segments: all faces' boundary segments, ``SEGMENT_DTYPE``; of face f from ``start[f]`` on.
        bounds: (f, 4) float64, u_min, v_min, u_max, v_max of each face's segments.
    """

    def __init__(self, geometry: GeometryBatch, faces: npt.ArrayLike, tolerance: npt.ArrayLike) -> None:
        self.geometry = geometry
        self.faces = np.asarray(faces, np.int64)
        tolerances = np.ascontiguousarray(np.broadcast_to(np.asarray(tolerance, float), len(self.faces)))
        self.start = np.zeros(len(self.faces) + 1, np.int64)
        tables = (geometry.surfaces, geometry.curves, geometry.values, geometry.loops, geometry.coedges)
        self.segments = np.zeros(0, SEGMENT_DTYPE)
        n = _segments(*tables, self.faces, tolerances, self.segments, self.start)
        self.segments = np.zeros(n, SEGMENT_DTYPE)
        _segments(*tables, self.faces, tolerances, self.segments, self.start)
        self.bounds = self._bounds()
        self._sort_into_strips()

    def _bounds(self) -> npt.NDArray[np.float64]:
        low = np.minimum(self.segments["uv0"], self.segments["uv1"])
        high = np.maximum(self.segments["uv0"], self.segments["uv1"])
        bounds = np.zeros((len(self.faces), 4))
        bounds[:, 2:] = -1.0  # a face with no segments at all contains nothing
        some = np.flatnonzero(np.diff(self.start))
        if len(some):
            bounds[some, :2] = np.minimum.reduceat(low, self.start[some])
            bounds[some, 2:] = np.maximum.reduceat(high, self.start[some])
        return bounds

    def _sort_into_strips(self) -> None:
        n_strips = np.clip(np.diff(self.start) // 2, 1, MAX_STRIPS)
        self._strip_start = np.concatenate([[0], np.cumsum(n_strips)])
        args = (self.segments, self.start, self.bounds, self._strip_start)
        counts = np.zeros(self._strip_start[-1], np.int64)
        _fill_strips(*args, counts, np.empty(0, np.int64))
        self._entry_start = np.concatenate([[0], np.cumsum(counts)])
        self._entries = np.empty(self._entry_start[-1], np.int64)
        if len(self._entries):
            _fill_strips(*args, self._entry_start[:-1].copy(), self._entries)

    def contains(self, face: npt.ArrayLike, uv: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """(n,) bool: is each of (n, 2) parameters inside its face (index in ``faces``) by the even-odd rule?"""
        at = np.ascontiguousarray(uv, float).reshape(-1, 2)
        of = np.ascontiguousarray(np.broadcast_to(np.asarray(face, np.int64), len(at)))
        out = np.empty(len(at), np.bool_)
        lists = (self._strip_start, self._entry_start, self._entries)
        _inside(self.segments, self.bounds, *lists, of, at, out)
        return out


def inside_for_sure(
    geometry: GeometryBatch,
    rows: npt.NDArray[np.int64],
    uv: npt.NDArray[np.float64],
    tolerance: npt.NDArray[np.float64],
) -> npt.NDArray[np.bool_]:
    """(n,) bool: a second opinion on a few samples, with their faces' loops cut anew at ``tolerance`` (n,) mm."""
    inside = np.zeros(len(rows), np.bool_)
    for row in np.unique(rows):
        own = rows == row
        inside[own] = TrimRegion(geometry, [row], tolerance[own].min()).contains(0, uv[own])
    return inside
