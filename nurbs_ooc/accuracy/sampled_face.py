"""Triangles without a promise: a face on a grid of equal steps, or on one that samples call fine enough.

Both are there to be compared with. The estimate looks at few points of a cell or of a piece of boundary
and believes them; what lies between goes unseen::

    x----o----x     corners x and samples o of a cell: their distances from the bilinear patch of the
    o    o    o     corners, and a quarter of its twist for the two triangles, are the estimate
    x----o----x

The cells' corners and the boundary are triangulated together; then the middles of the triangles' edges are
sampled in the same way. The boundary is cut at the p-curves' parameters, face by face; neighbours need not meet.

Source: the estimate by samples in place of bounds, and the regular grid, are the fast mode and the
uniform tessellation that papers on NURBS rendering compare with, e.g. M. Guthe, A. Balázs, R. Klein,
"GPU-based trimming and tessellation of NURBS and T-Spline surfaces", SIGGRAPH 2005, section 4.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel, leaf
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.predicates import LATTICE
from nurbs_ooc.geometry.surface import NURBS, surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.constraints import flood_inside, insert_constraint
from nurbs_ooc.tessellation.triangulate import (
    FIXED,
    INSIDE,
    LAST,
    N_OUTER,
    N_POINTS,
    N_TRIANGLES,
    Triangulation,
    insert_point,
    new_triangulation,
    room_for,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_PASSES = 12  # over all triangles, each of which halves the edges that samples find too long
SPARE = 4  # times the cells' points: room for what these passes insert
MAX_DEPTH = 24  # halvings of a cell or of a piece of boundary
READY, FULL, CROSSED = 0, 1, 2  # codes of ``sampled_face``


@leaf
def _chord_deviation(
    g: Tables, row: int, pcurve: int, a: float, b: float, scratch: Floats, at: Floats, s: Floats
) -> float:
    """Largest of three distances between the curve on the surface over [a, b] and its chord, mm."""
    for k in range(5):
        curve_point(g, pcurve, a + 0.25 * k * (b - a), scratch, at)
        surface_point(g, row, at[0], at[1], scratch, s[k])
    worst = 0.0
    for k in range(1, 4):
        d = 0.0
        for i in range(3):
            d += (s[k, i] - (s[0, i] + 0.25 * k * (s[4, i] - s[0, i]))) ** 2
        worst = max(worst, d)
    return math.sqrt(worst)


@helper
def _sample_coedge(
    g: Tables, row: int, c: int, error: float, pieces: int, scratch: Floats, s: Floats, out: Floats, n: int
) -> int:
    """Append (u, v) along a coedge but for its end; the new count, or -1 if ``out`` is too short."""
    coedge = g.coedges[c]
    curve = g.curves[coedge.pcurve]
    stack = np.empty((MAX_DEPTH + 2, 3))
    at = np.empty(12)
    start = n
    first = pieces if error <= 0.0 else 1
    for piece in range(first):
        stack[0, 0] = curve.t0 + (curve.t1 - curve.t0) * piece / first
        stack[0, 1] = curve.t0 + (curve.t1 - curve.t0) * (piece + 1) / first
        stack[0, 2] = 0.0
        top = 1
        while top > 0:
            top -= 1
            a, b, depth = stack[top, 0], stack[top, 1], stack[top, 2]
            fine = error <= 0.0 or depth >= MAX_DEPTH
            if fine or _chord_deviation(g, row, coedge.pcurve, a, b, scratch, at, s) <= error:
                if n >= len(out):
                    return -1
                curve_point(g, coedge.pcurve, b if coedge.reversed else a, scratch, at)
                out[n, 0], out[n, 1] = at[0], at[1]
                n += 1
            else:
                middle = 0.5 * (a + b)
                stack[top, 0], stack[top, 1], stack[top, 2] = middle, b, depth + 1.0
                stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = a, middle, depth + 1.0
                top += 2
    if coedge.reversed:
        for i in range((n - start) // 2):
            for k in range(2):
                out[start + i, k], out[n - 1 - i, k] = out[n - 1 - i, k], out[start + i, k]
    return n


@helper
def _boundary(
    g: Tables, row: int, error: float, pieces: int, scratch: Floats, s: Floats, out: Floats, follow: Ints
) -> int:
    """All loops into ``out`` (u, v) and ``follow``; how many points, or -1 if they do not fit."""
    surface = g.surfaces[row]
    n = 0
    for m in range(surface.first_loop, surface.first_loop + surface.n_loops):
        start = n
        for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
            n = _sample_coedge(g, row, c, error, pieces, scratch, s, out, n)
            if n < 0:
                return -1
        for i in range(start, n):
            follow[i] = i + 1 if i + 1 < n else start
    if surface.n_loops == 0:
        for i in range(4):
            out[i, 0] = surface.u1 if i == 1 or i == 2 else surface.u0
            out[i, 1] = surface.v1 if i >= 2 else surface.v0
            follow[i] = (i + 1) % 4
        n = 4
    return n


@leaf
def _cell_estimate(g: Tables, row: int, box: Floats, scratch: Floats, s: Floats) -> tuple[float, bool]:
    """What nine samples say of a cell's error, mm, and whether to halve it in u."""
    for i in range(3):
        for j in range(3):
            u = box[0] + 0.5 * i * (box[1] - box[0])
            v = box[2] + 0.5 * j * (box[3] - box[2])
            surface_point(g, row, u, v, scratch, s[3 * i + j])
    in_u, in_v, middle, twist, long_u, long_v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        d, e = 0.0, 0.0
        for k in range(3):
            d += (s[3 + j, k] - 0.5 * (s[j, k] + s[6 + j, k])) ** 2
            e += (s[3 * j + 1, k] - 0.5 * (s[3 * j, k] + s[3 * j + 2, k])) ** 2
        in_u, in_v = max(in_u, d), max(in_v, e)
    for k in range(3):
        middle += (s[4, k] - 0.25 * (s[0, k] + s[2, k] + s[6, k] + s[8, k])) ** 2
        twist += (s[0, k] - s[2, k] - s[6, k] + s[8, k]) ** 2
        long_u += (s[0, k] - s[6, k]) ** 2
        long_v += (s[0, k] - s[2, k]) ** 2
    worst = math.sqrt(max(in_u, in_v, middle)) + 0.25 * math.sqrt(twist)
    if twist > 16.0 * max(in_u, in_v):
        return worst, long_u >= long_v
    return worst, in_u >= in_v


@leaf
def _breaks(g: Tables, row: int, axis: int, low: float, high: float, out: Floats) -> int:
    """Bounds of the Bézier pieces along u (0) or v (1) within [low, high]; how many."""
    s = g.surfaces[row]
    out[0] = low
    n = 1
    if s.kind == NURBS:
        at, degree, count = (s.knots_u, s.degree_u, s.n_u) if axis == 0 else (s.knots_v, s.degree_v, s.n_v)
        for i in range(at + degree + 1, at + count):
            t = g.values[i]
            if t > out[n - 1] and t < high and n < len(out) - 1:
                out[n] = t
                n += 1
    out[n] = high
    return n + 1


@helper
def _cell_points(
    g: Tables, row: int, box: Floats, error: float, grid: int, scratch: Floats, s: Floats, out: Floats
) -> int:
    """Corners of all cells as (u, v); how many, or -1 if they do not fit."""
    n = 0
    if error <= 0.0:
        if (grid + 1) * (grid + 1) > len(out):
            return -1
        for i in range(grid + 1):
            for j in range(grid + 1):
                out[n, 0] = box[0] + (box[1] - box[0]) * i / grid
                out[n, 1] = box[2] + (box[3] - box[2]) * j / grid
                n += 1
        return n
    in_u, in_v = np.empty(4096), np.empty(4096)
    n_u, n_v = _breaks(g, row, 0, box[0], box[1], in_u), _breaks(g, row, 1, box[2], box[3], in_v)
    stack = np.empty((2 * MAX_DEPTH + 4, 5))
    for i in range(n_u - 1):
        for j in range(n_v - 1):
            stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = in_u[i], in_u[i + 1], in_v[j], in_v[j + 1]
            stack[0, 4] = 0.0
            top = 1
            while top > 0:
                top -= 1
                b = stack[top].copy()
                worst, across = _cell_estimate(g, row, b, scratch, s)
                if worst <= error or b[4] >= MAX_DEPTH:
                    if n + 4 > len(out):
                        return -1
                    for k in range(4):
                        out[n, 0] = b[0] if k < 2 else b[1]
                        out[n, 1] = b[2] if k % 2 == 0 else b[3]
                        n += 1
                    continue
                side = 0 if across else 2
                middle = 0.5 * (b[side] + b[side + 1])
                b[4] += 1.0
                stack[top], stack[top + 1] = b, b
                stack[top, side + 1], stack[top + 1, side] = middle, middle
                top += 2
    return n


@leaf
def _worst_middle(
    g: Tables, row: int, t: Triangulation, k: int, f: Floats, scratch: Floats, s: Floats
) -> tuple[float, int]:
    """Largest distance of the surface from the middles of a triangle's inner edges, mm, and that edge (-1: none)."""
    for i in range(3):
        p = t.tri[k, i]
        surface_point(g, row, f[0] + t.points[p, 0] * f[1], f[2] + t.points[p, 1] * f[3], scratch, s[i])
    worst, edge = 0.0, -1
    for i in range(3):
        if t.tri[k, FIXED + i] > 0:
            continue
        a, b = (i + 1) % 3, (i + 2) % 3
        p, q = t.tri[k, a], t.tri[k, b]
        u = f[0] + 0.5 * (t.points[p, 0] + t.points[q, 0]) * f[1]
        v = f[2] + 0.5 * (t.points[p, 1] + t.points[q, 1]) * f[3]
        surface_point(g, row, u, v, scratch, s[3])
        d = 0.0
        for j in range(3):
            d += (s[3, j] - 0.5 * (s[a, j] + s[b, j])) ** 2
        if d > worst:
            worst, edge = d, i
    return math.sqrt(worst), edge


@leaf
def _halve_edges(g: Tables, row: int, t: Triangulation, f: Floats, error: float, scratch: Floats, s: Floats) -> None:
    """Insert middles of inner edges that are more than ``error`` off, while there is room."""
    for _ in range(MAX_PASSES):
        before = t.n[N_POINTS]
        for k in range(t.n[N_TRIANGLES]):
            if t.tri[k, INSIDE] == 0 or min(t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]) < N_OUTER:
                continue
            worst, i = _worst_middle(g, row, t, k, f, scratch, s)
            if worst > error:
                if t.n[N_POINTS] + 2 >= len(t.points):
                    return
                p, q = t.tri[k, (i + 1) % 3], t.tri[k, (i + 2) % 3]
                t.n[LAST] = k
                insert_point(t, (t.points[p, 0] + t.points[q, 0]) // 2, (t.points[p, 1] + t.points[q, 1]) // 2)
        if t.n[N_POINTS] == before:
            return


@kernel
def sampled_face(g: Tables, row: int, error: float, grid: int, capacity: int) -> tuple[int, Floats, Ints]:
    """Triangulate surface ``row`` by samples: within about ``error`` mm, or with ``grid`` steps where that is 0.

    Returns:
        A code, (n, 2) parameters, (t, 3) triangles. FULL: more than ``capacity`` points are needed. CROSSED:
        boundary pieces cross; those that could not be kept are left out.
    """
    scratch = np.empty((4, MAX_DEGREE + 2))
    s = np.empty((9, 12))
    uv, follow = np.empty((capacity, 2)), np.empty(capacity, dtype=np.int64)
    none_uv, none = np.empty((0, 2)), np.empty((0, 3), dtype=np.int64)
    n = _boundary(g, row, error, grid, scratch, s, uv, follow)
    if n < 0:
        return FULL, none_uv, none
    box = np.array([uv[:n, 0].min(), uv[:n, 0].max(), uv[:n, 1].min(), uv[:n, 1].max()]) if n else np.zeros(4)
    if n < 3 or not (box[1] > box[0] and box[3] > box[2]):
        return READY, none_uv, none
    inner = np.empty((capacity, 2))
    m = _cell_points(g, row, box, error, grid, scratch, s, inner)
    if m < 0:
        return FULL, none_uv, none
    # The metric of the in-circle test: lengths in space of a step in u and in v, at the middle.
    surface_point(g, row, 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]), scratch, s[0])
    size_u, size_v = box[1] - box[0], box[3] - box[2]
    su = math.sqrt(s[0, 3] ** 2 + s[0, 4] ** 2 + s[0, 5] ** 2) * size_u
    sv = math.sqrt(s[0, 6] ** 2 + s[0, 7] ** 2 + s[0, 8] ** 2) * size_v
    room = n + m + 8 if error <= 0.0 else n + SPARE * m + capacity
    arrays = room_for(room)
    t = new_triangulation(arrays, room, max(su, 1e-3 * sv, 1e-300), max(sv, 1e-3 * su, 1e-300))
    exact = np.empty((room + N_OUTER, 2))
    point = np.empty(n + m, dtype=np.int64)
    for i in range(n + m):
        u, v = (uv[i, 0], uv[i, 1]) if i < n else (inner[i - n, 0], inner[i - n, 1])
        px = int(math.floor((u - box[0]) / size_u * LATTICE + 0.5))
        py = int(math.floor((v - box[2]) / size_v * LATTICE + 0.5))
        before = t.n[N_POINTS]
        point[i] = insert_point(t, px, py)
        if t.n[N_POINTS] > before:
            exact[point[i], 0], exact[point[i], 1] = u, v
    code = READY
    crossed = np.empty(2, dtype=np.int64)
    for i in range(n):
        p, q = point[i], point[follow[i]]
        if p != q and not insert_constraint(t, p, q, arrays.pairs, crossed):
            code = CROSSED
    flood_inside(t)
    if error > 0.0:
        f = np.array([box[0], size_u / LATTICE, box[2], size_v / LATTICE])
        start = t.n[N_POINTS]
        _halve_edges(g, row, t, f, error, scratch, s)
        for i in range(start, t.n[N_POINTS]):
            exact[i, 0], exact[i, 1] = f[0] + t.points[i, 0] * f[1], f[2] + t.points[i, 1] * f[3]
    triangles = np.empty((t.n[N_TRIANGLES], 3), dtype=np.int64)
    count = 0
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, INSIDE] != 0 and min(t.tri[k, 0], t.tri[k, 1], t.tri[k, 2]) >= N_OUTER:
            for i in range(3):
                triangles[count, i] = t.tri[k, i] - N_OUTER
            count += 1
    return code, exact[N_OUTER : t.n[N_POINTS]].copy(), triangles[:count].copy()
