"""From a face's triangulation to mesh arrays: used points, evaluated; triangles that enclose area."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.pieces import CREASED, Pieces
from nurbs_ooc.geometry.surface import surface_normal, surface_point
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.corner_normals import crease_normal, on_crease, pole_normal
from nurbs_ooc.tessellation.deviation import Frame
from nurbs_ooc.tessellation.face import face_frame
from nurbs_ooc.tessellation.triangulate import INSIDE, N_OUTER, N_POINTS, N_TRIANGLES, Triangulation, triangles_of
from nurbs_ooc.tessellation.workspace import CAPACITY, N_BOUNDARY, BoundaryRoom, Workspace

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
    following: Ints  # by vertex: the next one in the same place, see ``_with_normal``
    n: Ints
    more: Ints  # (3,) room that was missing


@helper
def new_output(vertices: int) -> Output:
    """Room for that many vertices to begin with."""
    return Output(
        np.empty((vertices, 3)),
        np.empty((vertices, 3)),
        np.empty((vertices, 2)),
        np.empty((2 * vertices, 3), dtype=np.int64),
        np.empty((vertices, 2), dtype=np.int64),
        np.empty(vertices, dtype=np.int64),
        np.zeros(3, dtype=np.int64),
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
def with_room(o: Output) -> Output:
    """``o`` with the room that it has missed."""
    v, t, s = o.n[0] + o.more[0], o.n[1] + o.more[1], o.n[2] + o.more[2]
    following = o.following
    if v > len(following):
        following = np.empty(2 * v, dtype=np.int64)
    return Output(
        _more_rows(o.position, o.n[0], v),
        _more_rows(o.normal, o.n[0], v),
        _more_rows(o.uv, o.n[0], v),
        _more_rows(o.triangle, o.n[1], t),
        _more_rows(o.segment, o.n[2], s),
        following,
        o.n,
        o.more,
    )


@leaf
def _has_room(o: Output, vertices: int, triangles: int, segments: int) -> bool:
    """Whether that many more fit; if not, ``more`` says so."""
    o.more[0], o.more[1], o.more[2] = vertices, triangles, segments
    return (
        o.n[0] + vertices <= min(len(o.position), len(o.following))
        and o.n[1] + triangles <= len(o.triangle)
        and o.n[2] + segments <= len(o.segment)
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
def _encloses_nothing(o: Output, i: int, j: int, k: int) -> bool:
    """Whether three vertices lie on one line, as far as float64 can tell."""
    q = o.position
    size = 0.0
    for m in range(3):
        x, y = (m + 1) % 3, (m + 2) % 3
        flat = (q[j, x] - q[i, x]) * (q[k, y] - q[i, y]) - (q[j, y] - q[i, y]) * (q[k, x] - q[i, x])
        size += flat * flat
    return size == 0.0


@leaf
def _normals_at(p: Pieces, row: int, f: Frame, uv: Floats, pole: bool, creased: bool) -> int:
    """ONE, or why a point has several normals."""
    if pole:
        return POLE
    return CREASE if creased and on_crease(p, row, f, uv[0], uv[1]) else ONE


@leaf
def _put_boundary(
    p: Pieces, row: int, b: BoundaryRoom, n: int, f: Frame, creased: bool, o: Output, at: Ints, kind: Flags
) -> None:
    """Vertices of the boundary points, one per lattice point: their numbers to ``at``, ``_normals_at`` to ``kind``."""
    for i in range(n):
        c = b.point[i]
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
def _with_normal(o: Output, base: int, normal: Floats, uv: Floats, apart: bool) -> int:
    """The vertex at the place of vertex ``base`` that has this normal, new if there is none.

    ``o.following`` leads from one vertex of a place to the next: LAST ends, UNUSED says that no triangle has
    taken ``base`` yet, so that it may still have any normal. With ``apart`` it must have these parameters too.
    """
    following = o.following
    v = base
    if following[v] == UNUSED:
        following[v] = LAST
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
        if following[v] == LAST:
            break
        v = following[v]
    new = _put_vertex(o, o.position[base], normal, uv[0], uv[1])
    following[v] = new
    following[new] = LAST
    return new


@leaf
def _corner(
    g: Tables, p: Pieces, row: int, f: Frame, o: Output, kind: int, base: int, j: int, k: int, scratch: Floats,
    nominal: Floats, first: int, apart: bool,
) -> int:  # fmt: skip
    """The vertex that a triangle of vertices ``base``, j, k gets at ``base``: the one with the right normal.

    ``nominal`` has the parameters of vertices, from ``first`` on; ``apart``: see ``_with_normal``.
    """
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
    return _with_normal(o, base, normal, uv, apart)


@leaf
def _put_segments(b: BoundaryRoom, n: int, at: Ints, o: Output) -> None:
    for i in range(n):
        if b.point[i] < 0:
            continue
        p, q = at[b.point[i]], at[b.point[b.next[i]]]
        if not _same_place(o, p, q):
            m = o.n[2]
            o.segment[m, 0], o.segment[m, 1] = p, q
            o.n[2] = m + 1


@leaf
def _put_triangles(
    g: Tables, p: Pieces, row: int, t: Triangulation, f: Frame, scratch: Floats, o: Output, at: Ints, kind: Flags,
    nominal: Floats, from_vertex: int, apart: bool,
) -> None:  # fmt: skip
    """The triangles inside that enclose area, each with the vertices that have the right normals for it."""
    reverse = g.surfaces[row].reversed != 0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] == 0:
            continue
        x, y, z = t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]
        i, j, m = at[x], at[y], at[z]
        # At a pole, where loops touch and across a closed chord two corners may be one point.
        if _same_place(o, i, j) or _same_place(o, j, m) or _same_place(o, m, i):
            continue
        # Of a triangle a few units of roundoff large all three may lie on its longest edge, which the next one has.
        if _encloses_nothing(o, i, j, m):
            continue
        first, second, third = i, j, m
        if kind[x] != ONE:
            first = _corner(g, p, row, f, o, kind[x], i, j, m, scratch, nominal, from_vertex, apart)
        if kind[y] != ONE:
            second = _corner(g, p, row, f, o, kind[y], j, m, i, scratch, nominal, from_vertex, apart)
        if kind[z] != ONE:
            third = _corner(g, p, row, f, o, kind[z], m, i, j, scratch, nominal, from_vertex, apart)
        n = o.n[1]
        o.triangle[n, 0] = first
        o.triangle[n, 1], o.triangle[n, 2] = (third, second) if reverse else (second, third)
        o.n[1] = n + 1


@leaf
def emit_face(g: Tables, p: Pieces, row: int, w: Workspace, apart: bool, o: Output) -> bool:
    """Append the face in the workspace: boundary points first (each once per lattice point), inner ones, triangles.

    Where triangles at one point want different normals it gets a vertex for each, all in the same place; with
    ``apart`` also where its parameters differ, so that they can be interpolated like normals.
    Returns False where ``o`` has no room for it (see ``with_room``); then nothing has been added.
    """
    n = w.size[N_BOUNDARY]
    points = w.size[CAPACITY] + N_OUTER
    t = Triangulation(w.room.points[:points], w.room.tri[: triangles_of(points)], w.counts, w.scale)
    total = t.n[N_POINTS]
    first = o.n[0]
    if not _has_room(o, total + n, t.n[N_TRIANGLES], n):
        return False
    u0, v0, du, dv = face_frame(w.boundary.box)
    f = Frame(u0, v0, du, dv)
    at, kind = w.drawn.owner, w.drawn.kind
    for c in range(total):
        at[c], kind[c] = -1, ONE
    creased = p.table[row, CREASED] != 0
    _put_boundary(p, row, w.boundary, n, f, creased, o, at, kind)
    several = _put_inner(g, p, row, t, f, w.scratch, creased, o, at, kind)
    if several > 0:
        taken = o.n[0] - first
        o.n[0] = first
        if not _has_room(o, taken + several, t.n[N_TRIANGLES], n):
            return False
        o.n[0] = first + taken
        for v in range(first, first + taken):
            o.following[v] = UNUSED
    nominal = o.uv[first:]
    if apart:
        # Vertices' parameters move as they take normals.
        nominal = w.drawn.place
        for v in range(o.n[0] - first):
            nominal[v, 0], nominal[v, 1] = o.uv[first + v, 0], o.uv[first + v, 1]
    _put_triangles(g, p, row, t, f, w.scratch, o, at, kind, nominal, first, apart)
    _put_segments(w.boundary, n, at, o)
    return True


@leaf
def emit_points(w: Workspace, o: Output) -> bool:
    """Append a face that has no triangles: its boundary points alone, so that it is not lost; False: no room."""
    n = w.size[N_BOUNDARY]
    if not _has_room(o, n, 0, 0):
        return False
    for i in range(n):
        _put_vertex(o, w.boundary.position[i], w.boundary.normal[i], w.boundary.uv[i, 0], w.boundary.uv[i, 1])
    return True
