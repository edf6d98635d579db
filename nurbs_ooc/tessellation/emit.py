"""From a face's triangulation to mesh arrays: used points, evaluated; triangles that enclose area."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.corner_normals import any_crease, crease_normal, on_crease, pole_normal
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.triangulate import INSIDE, N_POINTS, N_TRIANGLES, Triangulation
from nurbs_ooc.tessellation.trimming import Boundary

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.uint8]
Number = TypeVar("Number", bound=np.generic)

# How many normals a point has: one, or several, on a crease or at a pole.
ONE, CREASE, POLE = 0, 1, 2
# Cosine of 0.06 degrees: normals closer than this are one.
SAME_NORMAL = 1.0 - 0.5e-6
LAST, UNUSED = -1, -2


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


@leaf
def _normals_at(p: Pieces, row: int, f: Frame, uv: Floats, pole: bool, creased: bool) -> int:
    """ONE, or why a point has several normals."""
    if pole:
        return POLE
    return CREASE if creased and on_crease(p, row, f, uv[0], uv[1]) else ONE


@leaf
def _put_boundary(
    p: Pieces, row: int, b: Boundary, point: Ints, f: Frame, creased: bool, o: Output, at: Ints, kind: Flags
) -> None:
    """Vertices of the boundary points, one per lattice point: their numbers to ``at``, ``_normals_at`` to ``kind``."""
    for i in range(len(point)):
        c = point[i]
        if c >= 0 and at[c] < 0:
            at[c] = _put_vertex(o, b.position[i], b.normal[i], b.uv[i, 0], b.uv[i, 1])
            kind[c] = _normals_at(p, row, f, o.uv[at[c]], b.pole[i] != 0, creased)


@leaf
def _put_inner(
    g: Tables, p: Pieces, row: int, t: Triangulation, f: Frame, scratch: Floats, creased: bool, o: Output, at: Ints,
    kind: Flags,
) -> int:  # fmt: skip
    """Vertices of the other points in use; how many corners of triangles may want a normal of their own."""
    place = local_line(12)
    normal = local_line(3)
    corners = 0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] == 0:
            continue
        for i in range(3):
            c = t.tri[k, i]
            if at[c] < 0:
                u, v = f.u0 + t.points[c, 0] * f.du, f.v0 + t.points[c, 1] * f.dv
                surface_point(g, row, u, v, scratch, place)
                own = surface_normal(g, row, u, v, scratch, place, normal)
                at[c] = _put_vertex(o, place, normal, u, v)
                kind[c] = _normals_at(p, row, f, o.uv[at[c]], not own, creased)
            if kind[c] != ONE:
                corners += 1
    return corners


@leaf
def _with_normal(o: Output, first: int, following: Ints, base: int, normal: Floats, uv: Floats, apart: bool) -> int:
    """The vertex at the place of vertex ``base`` that has this normal, new if there is none.

    ``following`` leads from one vertex of a place to the next, by number after ``first``: LAST ends, UNUSED
    says that no triangle has taken ``base`` yet, so that it may still have any normal. With ``apart`` it must have
    these parameters too.
    """
    v = base
    if following[v - first] == UNUSED:
        following[v - first] = LAST
        for k in range(3):
            o.normal[v, k] = normal[k]
        o.uv[v, 0], o.uv[v, 1] = uv[0], uv[1]
        return v
    while True:
        cosine = 0.0
        for k in range(3):
            cosine += normal[k] * o.normal[v, k]
        if cosine >= SAME_NORMAL and not (apart and (o.uv[v, 0] != uv[0] or o.uv[v, 1] != uv[1])):
            return v
        if following[v - first] == LAST:
            break
        v = first + following[v - first]
    new = _put_vertex(o, o.position[base], normal, uv[0], uv[1])
    following[v - first] = new - first
    following[new - first] = LAST
    return new


@leaf
def _corner(
    g: Tables, p: Pieces, row: int, f: Frame, o: Output, first: int, following: Ints, kind: int, corners: Ints,
    i: int, scratch: Floats, nominal: Floats, apart: bool,
) -> int:  # fmt: skip
    """The vertex of corner ``i`` of a triangle with vertices ``corners``, with the normal that is right for it.

    ``nominal`` has the parameters of vertices, from ``first`` on; ``apart``: see ``_with_normal``.
    """
    base = corners[i]
    j, k = corners[(i + 1) % 3], corners[(i + 2) % 3]
    uv = local_line(2)
    middle = local_line(2)
    normal = local_line(3)
    for m in range(2):
        uv[m] = nominal[base - first, m]
        middle[m] = 0.5 * (nominal[j - first, m] + nominal[k - first, m])
    if kind == POLE:
        pole_normal(g, row, uv, middle, scratch, normal)
    else:
        crease_normal(g, p, row, f, uv, middle, scratch, normal)
    return _with_normal(o, first, following, base, normal, uv, apart)


@leaf
def _put_segments(b: Boundary, point: Ints, at: Ints, o: Output) -> None:
    for i in range(len(point)):
        if point[i] < 0:
            continue
        p, q = at[point[i]], at[point[b.next[i]]]
        if not _same_place(o, p, q):
            m = o.n[2]
            o.segment[m, 0], o.segment[m, 1] = p, q
            o.n[2] = m + 1


@helper
def emit_face(
    g: Tables, p: Pieces, row: int, b: Boundary, t: Triangulation, point: Ints, f: Frame, scratch: Floats,
    apart: bool, o: Output,
) -> Output:  # fmt: skip
    """Append a face: boundary points first (each once per lattice point), then inner ones, then triangles.

    Where triangles at one point want different normals it gets a vertex for each, all in the same place; with
    ``apart`` also where its parameters differ, so that they can be interpolated like normals.
    """
    n = len(b.next)
    total = t.n[N_POINTS]
    first = o.n[0]
    o = _with_room(o, total + n, t.n[N_TRIANGLES], n)
    at = np.full(total, -1, dtype=np.int64)
    kind = np.zeros(total, dtype=np.uint8)
    creased = any_crease(p, row)
    _put_boundary(p, row, b, point, f, creased, o, at, kind)
    several = _put_inner(g, p, row, t, f, scratch, creased, o, at, kind)
    o = _with_room(o, several, 0, 0)
    following = np.full(o.n[0] - first + several if several > 0 else 0, UNUSED, dtype=np.int64)
    # Vertices' parameters move as they take normals.
    nominal = o.uv[first : o.n[0]].copy() if apart else o.uv[first:]
    corners = np.empty(3, dtype=np.int64)
    own = np.empty(3, dtype=np.int64)
    reverse = g.surfaces[row].reversed != 0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] == 0:
            continue
        for i in range(3):
            corners[i] = at[t.tri[k, i]]
        # At a pole, where loops touch and across a closed chord two corners may be one point.
        if (
            _same_place(o, corners[0], corners[1])
            or _same_place(o, corners[1], corners[2])
            or _same_place(o, corners[2], corners[0])
        ):
            continue
        for i in range(3):
            own[i] = corners[i]
            if kind[t.tri[k, i]] != ONE:
                own[i] = _corner(
                    g, p, row, f, o, first, following, kind[t.tri[k, i]], corners, i, scratch, nominal, apart
                )
        m = o.n[1]
        o.triangle[m, 0] = own[0]
        o.triangle[m, 1], o.triangle[m, 2] = (own[2], own[1]) if reverse else (own[1], own[2])
        o.n[1] = m + 1
    _put_segments(b, point, at, o)
    return o


@helper
def emit_points(b: Boundary, o: Output) -> Output:
    """Append a face that has no triangles: its boundary points alone, so that it is not lost."""
    n = len(b.next)
    o = _with_room(o, n, 0, 0)
    for i in range(n):
        _put_vertex(o, b.position[i], b.normal[i], b.uv[i, 0], b.uv[i, 1])
    return o
