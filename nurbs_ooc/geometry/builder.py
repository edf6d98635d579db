"""Collects surfaces, curves, edges, vertices and loops one by one into a ``GeometryBatch``.

A surface is followed by its loops, a loop is given whole, curves, edges and vertices may come at any
time before they are used::

    builder = BatchBuilder(part=3)
    edge = builder.edge(curve_form, vertex0, vertex1)
    builder.surface(surface_form, source="#12")
    builder.loop([Coedge(edge, pcurve_form), ...])
    batch = builder.build()
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    FaceReason,
    FaceStatus,
    GeometryBatch,
    SurfaceKind,
)
from nurbs_ooc.geometry.forms import Array, CurveForm, SurfaceForm, Vector

EDGE_ID_PART_SHIFT = 32  # edge id = part << 32 | row


@dataclass(frozen=True, eq=False)
class Coedge:
    """One use of an edge in a loop.

    Attributes:
        edge: row of the edge in the builder.
        pcurve: the edge in the surface's (u, v); its t0..t1 runs linearly as the edge's t0..t1.
        reversed: the loop runs from t1 to t0.
        seam: the edge bounds the same face twice.
        pole: the edge is one point in space.
    """

    edge: int
    pcurve: CurveForm
    reversed: bool = False
    seam: bool = False
    pole: bool = False

    @property
    def start(self) -> Array:
        """(2,) where the loop enters this coedge."""
        return self.pcurve.end if self.reversed else self.pcurve.start

    @property
    def end(self) -> Array:
        """(2,) where the loop leaves it."""
        return self.pcurve.start if self.reversed else self.pcurve.end


class BatchBuilder:
    """Appends records; rows are given out in order and never change.

    Args:
        part: the part's index in the assembly; it is the upper half of all edge ids.
    """

    def __init__(self, part: int = 0) -> None:
        self.part = part
        self._surfaces: list[tuple[int | float, ...]] = []
        self._loops: list[tuple[int, int]] = []
        self._coedges: list[tuple[int, int, bool, bool, bool]] = []
        self._edges: list[tuple[int | float, ...]] = []
        self._curves: list[tuple[int | float, ...]] = []
        self._vertices: list[Vector] = []
        self._values: list[Array] = []
        self._n_values = 0
        self._sources: list[str] = []

    @property
    def n_surfaces(self) -> int:
        """Surfaces so far."""
        return len(self._surfaces)

    def _store(self, values: Array) -> int:
        offset = self._n_values
        flat = np.ascontiguousarray(values, np.float64).ravel()
        self._values.append(flat)
        self._n_values += flat.size
        return offset

    def vertex(self, point: Vector) -> int:
        """Append a vertex (3,), mm."""
        self._vertices.append(point)
        return len(self._vertices) - 1

    def curve(self, form: CurveForm) -> int:
        """Append a curve of 2 or 3 dimensions."""
        knots = self._store(form.knots) if form.knots.size else 0
        points = self._store(form.points)
        n = len(form.points) if form.knots.size else 0
        self._curves.append((form.kind, form.dim, form.rational, form.degree, n, knots, points, form.t0, form.t1))
        return len(self._curves) - 1

    def edge(self, form: CurveForm, vertex0: int, vertex1: int, tolerance: float = 0.0) -> int:
        """Append an edge that runs along ``form`` (3D) from ``vertex0`` at t0 to ``vertex1`` at t1."""
        return self._edge(self.curve(form), vertex0, vertex1, form.t0, form.t1, tolerance)

    def pole(self, vertex: int, t0: float = 0.0, t1: float = 1.0, tolerance: float = 0.0) -> int:
        """Append an edge that is one point."""
        return self._edge(-1, vertex, vertex, t0, t1, tolerance)

    def _edge(self, curve: int, vertex0: int, vertex1: int, t0: float, t1: float, tolerance: float) -> int:
        row = len(self._edges)
        identity = self.part << EDGE_ID_PART_SHIFT | row
        self._edges.append((identity, curve, vertex0, vertex1, t0, t1, tolerance))
        return row

    def surface(
        self,
        form: SurfaceForm,
        *,
        reversed: bool = False,
        material: int = 0,
        source: str = "",
        status: FaceStatus = FaceStatus.EXACT,
        reason: FaceReason = FaceReason.NONE,
        approximation_error: float = 0.0,
        tolerance: float = 0.0,
    ) -> int:
        """Append a surface; the loops that follow are its own."""
        nurbs = form.kind == SurfaceKind.NURBS
        profile = -1 if form.profile is None else self.curve(form.profile)
        knots_u, knots_v = (self._store(form.knots_u), self._store(form.knots_v)) if nurbs else (0, 0)
        points = self._store(form.points) if nurbs else 0
        frame = -1 if nurbs else self._store(form.frame)
        n_u, n_v = form.points.shape[:2] if nurbs else (0, 0)
        row = len(self._surfaces)
        self._sources.append(source)
        shape = (form.degree_u, form.degree_v, n_u, n_v, profile, len(self._loops), 0, material, row)
        domain = (form.u0, form.u1, form.v0, form.v1, form.u_period, form.v_period)
        flags = (form.kind, form.rational, reversed, status, reason)
        offsets = (knots_u, knots_v, points, frame)
        self._surfaces.append((*flags, *shape, *offsets, *domain, approximation_error, tolerance))
        return row

    def loop(self, coedges: Sequence[Coedge]) -> int:
        """Append a closed loop, in running order, to the latest surface."""
        first = len(self._coedges)
        for coedge in coedges:
            pcurve = self.curve(coedge.pcurve)
            self._coedges.append((coedge.edge, pcurve, coedge.reversed, coedge.seam, coedge.pole))
        self._loops.append((first, len(coedges)))
        latest = self._surfaces[-1]
        self._surfaces[-1] = (*latest[:11], latest[11] + 1, *latest[12:])
        return len(self._loops) - 1

    def build(self) -> GeometryBatch:
        """All records so far as one batch."""
        return GeometryBatch(
            surfaces=np.array(self._surfaces, SURFACE_DTYPE),
            loops=np.array(self._loops, LOOP_DTYPE),
            coedges=np.array(self._coedges, COEDGE_DTYPE),
            edges=np.array(self._edges, EDGE_DTYPE),
            curves=np.array(self._curves, CURVE_DTYPE),
            vertices=np.array(self._vertices, np.float64).reshape(-1, 3),
            values=np.concatenate([*self._values, np.empty(0)]),
            sources=list(self._sources),
        )
