"""From a face's triangulation to mesh arrays: used points, evaluated; triangles that enclose area."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.triangulate import INSIDE, N_POINTS, N_TRIANGLES, Triangulation
from nurbs_ooc.tessellation.trimming import Boundary

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Number = TypeVar("Number", bound=np.generic)


class Output(NamedTuple):
    """Growing arrays of a run of faces; ``n``: vertices, triangles, segments in use."""

    position: Floats
    normal: Floats
    uv: Floats
    triangle: Ints
    segment: Ints
    n: Ints


@helper
def new_output(vertices: int) -> Output:
    """Room for that many vertices to begin with."""
    return Output(
        np.empty((vertices, 3)),
        np.empty((vertices, 3)),
        np.empty((vertices, 2)),
        np.empty((2 * vertices, 3), dtype=np.int64),
        np.empty((vertices, 2), dtype=np.int64),
        np.zeros(3, dtype=np.int64),
    )


@helper
def _more_rows(a: npt.NDArray[Number], used: int, need: int) -> npt.NDArray[Number]:
    if need <= len(a):
        return a
    bigger = np.empty((2 * need, a.shape[1]), dtype=a.dtype)
    bigger[:used] = a[:used]
    return bigger


@helper
def _with_room(o: Output, vertices: int, triangles: int, segments: int) -> Output:
    """``o`` with room for that many more."""
    v, t, s = o.n[0] + vertices, o.n[1] + triangles, o.n[2] + segments
    return Output(
        _more_rows(o.position, o.n[0], v),
        _more_rows(o.normal, o.n[0], v),
        _more_rows(o.uv, o.n[0], v),
        _more_rows(o.triangle, o.n[1], t),
        _more_rows(o.segment, o.n[2], s),
        o.n,
    )


@leaf
def _put_vertex(o: Output, position: Floats, normal: Floats, u: float, v: float) -> int:
    at = o.n[0]
    for k in range(3):
        o.position[at, k] = position[k]
        o.normal[at, k] = normal[k]
    o.uv[at, 0], o.uv[at, 1] = u, v
    o.n[0] = at + 1
    return at


@leaf
def _same_place(o: Output, a: int, b: int) -> bool:
    return (
        o.position[a, 0] == o.position[b, 0]
        and o.position[a, 1] == o.position[b, 1]
        and o.position[a, 2] == o.position[b, 2]
    )


@helper
def emit_face(
    g: Tables, row: int, b: Boundary, t: Triangulation, point: Ints, f: Frame, scratch: Floats, o: Output
) -> Output:
    """Append a face: boundary points first (each once per lattice point), then inner ones, then triangles."""
    n = len(b.next)
    total = t.n[N_POINTS]
    o = _with_room(o, total + n, t.n[N_TRIANGLES], n)
    number = np.full(total, -1, dtype=np.int64)
    for i in range(n):
        if point[i] < 0:
            continue
        if number[point[i]] < 0:
            number[point[i]] = _put_vertex(o, b.position[i], b.normal[i], b.uv[i, 0], b.uv[i, 1])
    at = np.empty(12)
    normal = np.empty(3)
    reverse = g.surfaces[row].reversed != 0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] == 0:
            continue
        for i in range(3):
            c = t.tri[k, i]
            if number[c] < 0:
                u, v = f.u0 + t.points[c, 0] * f.du, f.v0 + t.points[c, 1] * f.dv
                surface_point(g, row, u, v, scratch, at)
                surface_normal(g, row, u, v, scratch, at, normal)
                number[c] = _put_vertex(o, at, normal, u, v)
        p, q, r = number[t.tri[k, 0]], number[t.tri[k, 1]], number[t.tri[k, 2]]
        # At a pole, where loops touch and across a closed chord two corners may be one point.
        if _same_place(o, p, q) or _same_place(o, q, r) or _same_place(o, r, p):
            continue
        if reverse:
            q, r = r, q
        m = o.n[1]
        o.triangle[m, 0], o.triangle[m, 1], o.triangle[m, 2] = p, q, r
        o.n[1] = m + 1
    for i in range(n):
        if point[i] < 0:
            continue
        p, q = number[point[i]], number[point[b.next[i]]]
        if not _same_place(o, p, q):
            m = o.n[2]
            o.segment[m, 0], o.segment[m, 1] = p, q
            o.n[2] = m + 1
    return o


@helper
def emit_points(b: Boundary, o: Output) -> Output:
    """Append a face that has no triangles: its boundary points alone, so that it is not lost."""
    n = len(b.next)
    o = _with_room(o, n, 0, 0)
    for i in range(n):
        _put_vertex(o, b.position[i], b.normal[i], b.uv[i, 0], b.uv[i, 1])
    return o
