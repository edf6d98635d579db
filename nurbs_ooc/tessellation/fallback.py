"""What is drawn of a face whose loops cross one another: the part that the even-odd rule gives.

A constraint that crosses another cannot become an edge. Each triangle is then judged by its centre:
inside if a ray to the left meets the loops an odd number of times. The face's outline is ragged by
up to the size of the triangles along the lost constraint, and its error says so.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.triangulate import INSIDE, N_OUTER, N_TRIANGLES, Triangulation
from nurbs_ooc.tessellation.trimming import Boundary

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@leaf
def mask_inside(t: Triangulation, b: Boundary, point: Ints) -> None:
    """Set ``inside`` of every triangle by its centre and the loops ``b``; ``point`` maps them to lattice points."""
    for k in range(t.n[N_TRIANGLES]):
        if t.tri[k, 0] < N_OUTER or t.tri[k, 1] < N_OUTER or t.tri[k, 2] < N_OUTER:
            t.tri[k, INSIDE] = 0
            continue
        x = (t.points[t.tri[k, 0], 0] + t.points[t.tri[k, 1], 0] + t.points[t.tri[k, 2], 0]) / 3.0
        y = (t.points[t.tri[k, 0], 1] + t.points[t.tri[k, 1], 1] + t.points[t.tri[k, 2], 1]) / 3.0
        odd = 0
        for i in range(len(b.next)):
            p, q = point[i], point[b.next[i]]
            yp, yq = float(t.points[p, 1]), float(t.points[q, 1])
            if (yp > y) != (yq > y) and x > t.points[p, 0] + (y - yp) / (yq - yp) * (t.points[q, 0] - t.points[p, 0]):
                odd ^= 1
        t.tri[k, INSIDE] = odd


@leaf
def segment_length(b: Boundary, i: int) -> float:
    """Length in space of the boundary segment that starts at point i, mm."""
    total = 0.0
    for k in range(3):
        total += (b.position[b.next[i], k] - b.position[i, k]) ** 2
    return math.sqrt(total)


@leaf
def box_diagonal(points: Floats) -> float:
    """Diagonal of the box of points (n, 3); 0 of none."""
    if len(points) == 0:
        return 0.0
    total = 0.0
    for k in range(3):
        low, high = points[0, k], points[0, k]
        for i in range(len(points)):
            low, high = min(low, points[i, k]), max(high, points[i, k])
        total += (high - low) ** 2
    return math.sqrt(total)


@leaf
def surface_diagonal(g: Tables, row: int, b: Boundary) -> float:
    """Diagonal of a box that holds a B-spline surface and its boundary points, mm; infinite for other kinds."""
    s = g.surfaces[row]
    if s.kind != NURBS:
        return math.inf
    step = 4 if s.rational else 3
    total = 0.0
    for k in range(3):
        low, high = math.inf, -math.inf
        for i in range(s.n_u * s.n_v):
            at = s.points + i * step
            x = g.values[at + k] / g.values[at + 3] if s.rational else g.values[at + k]
            low, high = min(low, x), max(high, x)
        for i in range(len(b.position)):
            low, high = min(low, b.position[i, k]), max(high, b.position[i, k])
        total += (high - low) ** 2
    return math.sqrt(total)
