"""Rough triangles over every face, to begin a search from: a grid of cells over its (u, v) box, each two triangles.

The grid is as fine as the face bends, measured on a coarse one; cells that lie wholly outside the
loops are left out. How far the surface was seen to leave its triangles is kept, so that a search can
pass over faces and cells that are too far away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.measure.exact_curve import MAX_DEGREE
from nurbs_ooc.measure.inside import MAX_DEPTH, is_inside
from nurbs_ooc.measure.placed_faces import placed_point
from nurbs_ooc.measure.trim_region import TrimRegion

PROBES = 8  # intervals per direction of the coarse grid
BENT = 2e-3  # of a face's size that its triangles may leave it
MAX_CELLS = 64  # per direction
CAUTION = 2.0  # times the bend that the middles of a cell and its sides show

_NURBS = int(SurfaceKind.NURBS)


@leaf
def _grid_uv(box, i, n_i, j, n_j) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    u = box[0] + (box[2] - box[0]) * (i / n_i) if i < n_i else box[2]
    v = box[1] + (box[3] - box[1]) * (j / n_j) if j < n_j else box[3]
    return u, v


@leaf
def _cells_along(bend, size, spans) -> int:  # type: ignore[no-untyped-def]
    """Cells for a chord error of ``BENT``: second differences over 1/PROBES shrink with the square."""
    want = 0.5 * PROBES * math.sqrt(bend / max(BENT * size, 1e-300))
    return max(1, min(MAX_CELLS, max(math.ceil(min(want, 1e6)), min(spans, MAX_CELLS // 2))))


@kernel
def _counts(surfaces, curves, values, rows, transforms, bounds, counts):  # type: ignore[no-untyped-def]
    scratch, out = np.empty((3, 2, MAX_DEGREE + 1)), np.empty((3, 3))
    p = np.empty((PROBES + 1, PROBES + 1, 3))
    for f in range(len(rows)):
        s = surfaces[rows[f]]
        for i in range(PROBES + 1):
            for j in range(PROBES + 1):
                u, v = _grid_uv(bounds[f], i, PROBES, j, PROBES)
                placed_point((surfaces, curves, values), rows[f], transforms[f], u, v, scratch, out)
                p[i, j] = out[0]
        size2 = 0.0
        for k in range(3):
            size2 += (p[:, :, k].max() - p[:, :, k].min()) ** 2
        bend_u, bend_v = 0.0, 0.0
        for i in range(1, PROBES):
            for j in range(PROBES + 1):
                along, across = 0.0, 0.0
                for k in range(3):
                    along += (p[i, j, k] - 0.5 * (p[i - 1, j, k] + p[i + 1, j, k])) ** 2
                    across += (p[j, i, k] - 0.5 * (p[j, i - 1, k] + p[j, i + 1, k])) ** 2
                bend_u, bend_v = max(bend_u, along), max(bend_v, across)
        spans_u, spans_v = 1, 1
        if s.kind == _NURBS:
            spans_u, spans_v = s.n_u - s.degree_u, s.n_v - s.degree_v
        counts[f, 0] = _cells_along(math.sqrt(bend_u), math.sqrt(size2), spans_u)
        counts[f, 1] = _cells_along(math.sqrt(bend_v), math.sqrt(size2), spans_v)


@leaf
def _mark_boundary(segments, first, last, box, n_u, n_v, touched) -> None:  # type: ignore[no-untyped-def]
    """Set ``touched`` of every cell that the box of a boundary piece reaches into."""
    width, height = box[2] - box[0], box[3] - box[1]
    touched[: n_u * n_v] = False
    for e in range(first, last):
        s = segments[e]
        low_u, high_u = min(s.uv0[0], s.uv1[0]) - s.band[0], max(s.uv0[0], s.uv1[0]) + s.band[0]
        low_v, high_v = min(s.uv0[1], s.uv1[1]) - s.band[1], max(s.uv0[1], s.uv1[1]) + s.band[1]
        i0, i1, j0, j1 = 0, n_u - 1, 0, n_v - 1
        if width > 0.0:
            i0, i1 = int((low_u - box[0]) / width * n_u - 1e-6), int((high_u - box[0]) / width * n_u + 1e-6)
        if height > 0.0:
            j0, j1 = int((low_v - box[1]) / height * n_v - 1e-6), int((high_v - box[1]) / height * n_v + 1e-6)
        for i in range(max(i0, 0), min(i1, n_u - 1) + 1):
            for j in range(max(j0, 0), min(j1, n_v - 1) + 1):
                touched[i * n_v + j] = True


@leaf
def _leave(p, w, i, j) -> float:  # type: ignore[no-untyped-def]
    """How far the middles of cell (i, j) and its sides lie from the plane quadrilateral; ``p`` has half steps."""
    row = 2 * i * w + 2 * j
    worst, twist = 0.0, 0.0
    for at in range(5):
        # The five middles with the corners whose mean they are compared to.
        middle = (row + 1, row + w, row + 2 * w + 1, row + w + 2, row + w + 1)[at]
        d2 = 0.0
        for k in range(3):
            a, b, c, d = p[row, k], p[row + 2, k], p[row + 2 * w, k], p[row + 2 * w + 2, k]
            mean = (0.5 * (a + b), 0.5 * (a + c), 0.5 * (c + d), 0.5 * (b + d), 0.25 * (a + b + c + d))[at]
            d2 += (p[middle, k] - mean) ** 2
            if at == 0:
                twist += (0.25 * (a - b - c + d)) ** 2
        worst = max(worst, d2)
    return CAUTION * math.sqrt(worst) + math.sqrt(twist)


@kernel
def _fill(tables, pieces, start, counts, vertex_start, cell_start, positions, uv, triangles, leave):  # type: ignore[no-untyped-def]
    """Vertices of all grids with half steps, triangles of the cells that are kept; returns how many cells."""
    surfaces, curves, values, rows, transforms = tables
    segments, bounds = pieces[3], pieces[4]
    scratch, out = np.empty((3, 2, MAX_DEGREE + 1)), np.empty((3, 3))
    stack, touched = np.empty((MAX_DEPTH + 2, 8)), np.empty(MAX_CELLS * MAX_CELLS, np.bool_)
    n = 0
    for f in range(len(rows)):
        n_u, n_v, first = counts[f, 0], counts[f, 1], vertex_start[f]
        w = 2 * n_v + 1
        cell_start[f] = n
        for i in range(2 * n_u + 1):
            for j in range(w):
                u, v = _grid_uv(bounds[f], i, 2 * n_u, j, 2 * n_v)
                placed_point((surfaces, curves, values), rows[f], transforms[f], u, v, scratch, out)
                positions[first + i * w + j], uv[first + i * w + j, 0], uv[first + i * w + j, 1] = out[0], u, v
        _mark_boundary(segments, start[f], start[f + 1], bounds[f], n_u, n_v, touched)
        for i in range(n_u):
            for j in range(n_v):
                middle = uv[first + (2 * i + 1) * w + 2 * j + 1]
                if not touched[i * n_v + j] and not is_inside(pieces, f, middle[0], middle[1], scratch[0], stack):
                    continue
                a = first + 2 * i * w + 2 * j
                b, c, d = a + 2 * w, a + 2 * w + 2, a + 2
                triangles[2 * n, 0], triangles[2 * n, 1], triangles[2 * n, 2] = a, b, c
                triangles[2 * n + 1, 0], triangles[2 * n + 1, 1], triangles[2 * n + 1, 2] = a, c, d
                leave[n] = _leave(positions[first : first + (2 * n_u + 1) * w], w, i, j)
                n += 1
    cell_start[len(rows)] = n
    return n


@dataclass(frozen=True, eq=False)
class FaceCells:
    """The triangles of all faces of a region.

    Attributes:
        positions: (v, 3) mm; uv: (v, 2) native parameters of each.
        triangles: (2 c, 3) rows in them, two a cell, cells of face f from ``cell_start[f]`` on.
        leave: (c,) mm; how far the surface over a cell leaves its triangles.
    """

    positions: npt.NDArray[np.float64]
    uv: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    cell_start: npt.NDArray[np.int64]
    leave: npt.NDArray[np.float64]

    @property
    def face(self) -> npt.NDArray[np.int64]:
        """(2 c,) face of each triangle."""
        return np.repeat(np.arange(len(self.cell_start) - 1), 2 * np.diff(self.cell_start))


def face_cells(region: TrimRegion) -> FaceCells:
    """Cells of all faces of ``region``."""
    tables = region.placed.tables
    counts = np.empty((len(region), 2), np.int64)
    _counts(*tables, region.bounds, counts)
    counts[np.diff(region.start) == 0] = 1
    vertex_start = np.concatenate([[0], np.cumsum((2 * counts + 1).prod(1))])
    cell_start = np.zeros(len(region) + 1, np.int64)
    n_most = int(counts.prod(1).sum())
    positions, uv = np.empty((vertex_start[-1], 3)), np.empty((vertex_start[-1], 2))
    triangles, leave = np.empty((2 * n_most, 3), np.int64), np.empty(n_most)
    n = _fill(tables, region.pieces, region.start, counts, vertex_start, cell_start, positions, uv, triangles, leave)
    return FaceCells(positions, uv, triangles[: 2 * n], cell_start, leave[:n])
