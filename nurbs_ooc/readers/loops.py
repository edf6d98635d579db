"""The trimming loops of a kernel face, chained in (u, v).

A wire's edges come in any order and their p-curves may lie a period apart. The chain takes them so
that each starts where the one before it ended: by a whole number of periods, across a pole (an edge
that is one point is put in), or across a gap in the file (a straight bridge is put in). What was
done is noted for the face's status.

::

        v ^   +------<------+        p-curve of a seam edge at u1 ...
          |   |             |
          |   v             ^        ... and the same edge at u0 = u1 - period
          |   +------>------+
          +-----------------------> u
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.ShapeFix import ShapeFix_Edge
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Iterator

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.geometry.builder import Coedge
from nurbs_ooc.geometry.forms import Array, CurveForm
from nurbs_ooc.readers.curves import curve_form
from nurbs_ooc.readers.edges import EdgeTable
from nurbs_ooc.readers.pcurve_fit import EdgeOnSurface, refitted
from nurbs_ooc.readers.refusal import FaceRefusedError

FORWARD = TopAbs_Orientation.TopAbs_FORWARD
REVERSED = TopAbs_Orientation.TopAbs_REVERSED
WIRE = TopAbs_ShapeEnum.TopAbs_WIRE
EDGE = TopAbs_ShapeEnum.TopAbs_EDGE

ROUNDING = 1e-9  # relative: p-curve ends closer than this are equal
SLIVER_SHARE = 0.2  # of its box: a loop that fills less has its area sampled
SLIVER_SAMPLES = 65
POLE_SHARE = 0.02  # of the face's extent in u or v: a jump over a pole, not a gap in the file
MIN_TOLERANCE = 1e-7  # mm, the kernel's own confusion distance
GAP_SLACK = 2.0  # both ends may be off by the tolerance


@dataclass
class Loop:
    """A chain of coedges.

    Attributes:
        winding: how many periods in u and in v it runs forward in total; (0, 0) for a closed loop.
    """

    coedges: list[Coedge]
    winding: tuple[int, int] = (0, 0)


@dataclass
class FaceLoops:
    """All loops of a face and what was done to them."""

    loops: list[Loop] = field(default_factory=list)
    reasons: set[FaceReason] = field(default_factory=set)


class LoopReader:
    """Reads the loops of one face.

    Args:
        face: a ``TopoDS_Face`` with forward orientation.
        surface: its located ``Geom_Surface``.
        table: the part's edges.
    """

    def __init__(self, face: Any, surface: Any, table: EdgeTable) -> None:
        self.face = face
        self.surface = surface
        self.table = table
        self.periods = np.array(
            [
                surface.UPeriod() if surface.IsUPeriodic() else 0.0,
                surface.VPeriod() if surface.IsVPeriodic() else 0.0,
            ]
        )
        self._plane = type(surface).__name__ == "Geom_Plane"  # its p-curves are projections already
        self.result = FaceLoops()
        self._tolerance: dict[int, float] = {}
        self._broken: dict[int, tuple[int, bool]] = {}  # by the vertex where the loop enters it

    def read(self) -> FaceLoops:
        """All loops, chained; seams are marked."""
        wires = [list(self._coedges(wire)) for wire in _children(self.face, WIRE)]
        wires = [wire for wire in wires if wire]
        extent = self._extent(wires)
        for wire in wires:
            self.result.loops.append(self._chain(wire, extent))
        _mark_seams(self.result.loops)
        return self.result

    def _coedges(self, wire: Any) -> Iterator[Coedge]:
        """The wire's edges in the file's order; those whose curve is broken are put aside."""
        for shape in _children(wire, EDGE):
            edge = TopoDS.Edge(shape)
            row = self.table.edge(edge)
            self._tolerance[row] = max(BRep_Tool.Tolerance_s(edge), MIN_TOLERANCE)
            pole = bool(BRep_Tool.Degenerated_s(edge))
            reverse = edge.Orientation() == REVERSED
            if row in self.table.broken:
                self.result.reasons.add(FaceReason.PCURVE_REBUILT)
                start, end = self.table.ends(row)
                self._broken[end if reverse else start] = (row, reverse)
                continue
            pcurve = self._pcurve(edge)
            if pole and self._spans(pcurve) > GAP_SLACK * self._tolerance[row]:
                self.result.reasons.add(FaceReason.DEGENERATE_EDGE_DROPPED)
                continue
            yield Coedge(row, pcurve, reverse, pole=pole)

    def _spans(self, pcurve: CurveForm) -> float:
        """How far apart three points of a p-curve are in space."""
        middle = pcurve.point(0.5 * (pcurve.t0 + pcurve.t1))
        points = [self.surface.Value(*uv) for uv in (pcurve.start, middle, pcurve.end)]
        return float(max(points[0].Distance(point) for point in points[1:]))

    def _pcurve(self, edge: Any) -> CurveForm:
        curve = BRep_Tool.CurveOnSurface_s(edge, self.face, 0.0, 0.0)
        if curve is None:
            self.result.reasons.add(FaceReason.PCURVE_REBUILT)
            ShapeFix_Edge().FixAddPCurve(edge, self.face, False)
            curve = BRep_Tool.CurveOnSurface_s(edge, self.face, 0.0, 0.0)
        if curve is None:
            raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "an edge cannot be projected to its surface")
        over = BRep_Tool.Range_s(edge, self.face)
        space = BRep_Tool.Curve_s(edge, 0.0, 0.0)
        if space is not None and not self._plane:
            pair = EdgeOnSurface(self.surface, space, curve, BRep_Tool.Range_s(edge), over)
            better = refitted(pair, BRep_Tool.Tolerance_s(edge))
            if better is not None:
                self.result.reasons.add(FaceReason.PCURVE_REBUILT)
                return better
        return curve_form(curve, *over)

    def _extent(self, wires: list[list[Coedge]]) -> Array:
        ends = [end for wire in wires for coedge in wire for end in (coedge.start, coedge.end)]
        return np.asarray(np.maximum(np.ptp(np.array(ends), axis=0), 1e-12) if ends else np.ones(2))

    def _chain(self, wire: list[Coedge], extent: Array) -> Loop:
        """Order the coedges so that each starts where the last one ended."""
        starts: dict[int, list[Coedge]] = {}
        for coedge in wire[1:]:
            starts.setdefault(self._vertices(coedge)[0], []).append(coedge)
        chain = [wire[0]]
        for _ in wire[1:]:
            last = chain[-1]
            meeting = starts.get(self._target(last))
            coedge = self._nearest(last, meeting or [c for cs in starts.values() for c in cs])
            starts[self._vertices(coedge)[0]].remove(coedge)
            shift = self._shift(last.end, coedge.start)
            if shift.any():
                self.result.reasons.add(FaceReason.LOOP_SHIFTED_BY_PERIOD)
                coedge = replace(coedge, pcurve=coedge.pcurve.shifted(shift))
            chain += [*self._between(last, coedge, extent), coedge]
        shift = self._shift(chain[-1].end, chain[0].start)
        if not shift.any():
            chain += self._between(chain[-1], chain[0], extent)
            return Loop(chain)
        turns = np.round(shift / np.where(self.periods > 0.0, self.periods, 1.0)).astype(int)
        return Loop(chain, (int(turns[0]), int(turns[1])))

    def _target(self, last: Coedge) -> int:
        """The vertex at which the next sound coedge has to start."""
        vertex = self._vertices(last)[1]
        if vertex in self._broken:
            row, reverse = self._broken[vertex]
            return self.table.ends(row)[not reverse]
        return vertex

    def _between(self, last: Coedge, coedge: Coedge, extent: Array) -> list[Coedge]:
        """What comes between two sound coedges: a broken edge made straight, or what ``_bridge`` finds."""
        vertex = self._vertices(last)[1]
        if vertex not in self._broken or self._target(last) != self._vertices(coedge)[0]:
            return self._bridges(last, coedge) or self._closed(last, coedge, extent)
        row, reverse = self._broken.pop(vertex)
        ends = (coedge.start, last.end) if reverse else (last.end, coedge.start)
        return [Coedge(row, CurveForm.line(*ends), reverse)]

    def _vertices(self, coedge: Coedge) -> tuple[int, int]:
        """Rows of the vertices where the loop enters and leaves ``coedge``."""
        start, end = self.table.ends(coedge.edge)
        return (end, start) if coedge.reversed else (start, end)

    def _nearest(self, last: Coedge, candidates: list[Coedge]) -> Coedge:
        """Which of the candidates goes on from ``last``; one that need not be moved by a period wins."""
        if len(candidates) == 1:
            return candidates[0]

        def cost(coedge: Coedge) -> tuple[float, bool]:
            shift = self._shift(last.end, coedge.start)
            gap = float(np.abs(coedge.start + shift - last.end).max())
            return (gap if gap > 1e-6 else 0.0, bool(shift.any()))

        return min(candidates, key=cost)

    def _shift(self, target: Array, start: Array) -> Array:
        """Whole periods that bring ``start`` next to ``target``."""
        gap = target - start
        if not self.periods.any() or float(np.abs(gap).max()) < 1e-6:
            return np.zeros(2)
        turns = np.round(gap / np.where(self.periods > 0.0, self.periods, np.inf))
        return np.asarray(np.where(turns == 0.0, 0.0, turns * self.periods))

    def _bridges(self, first: Coedge, second: Coedge) -> list[Coedge]:
        """Where an edge's curve misses the vertex between the two: the way from the curve's end to it."""
        leaving = self.table.bridge(first.edge, 1 - first.reversed)
        entering = self.table.bridge(second.edge, int(second.reversed))
        if leaving is None and entering is None:
            return []
        self.result.reasons.add(FaceReason.LOOP_GAP_CLOSED)
        middle = 0.5 * (first.end + second.start)
        middle = second.start if entering is None else first.end if leaving is None else middle
        way = []
        if leaving is not None:
            way.append(Coedge(leaving, CurveForm.line(first.end, middle)))
        if entering is not None:
            way.append(Coedge(entering, CurveForm.line(second.start, middle), reversed=True))
        return way

    def _closed(self, first: Coedge, second: Coedge, extent: Array) -> list[Coedge]:
        """What has to be put in between: nothing, a pole, or the straight edge between two open vertices."""
        start, end = first.end, second.start
        gap = np.abs(end - start)
        vertex, other = self._vertices(first)[1], self._vertices(second)[0]
        if gap.max() <= ROUNDING * (1.0 + np.abs(start).max()) and vertex == other:
            return []
        points = [self.surface.Value(*uv) for uv in (start, 0.5 * (start + end), end)]
        tolerance = max(self._tolerance.get(c.edge, 0.0) for c in (first, second))
        tolerance = max(tolerance, min(self.table.vertex_tolerance(vertex), points[0].Distance(points[2])))
        one_point = max(p.Distance(points[0]) for p in points) <= GAP_SLACK * tolerance
        small = bool((gap <= POLE_SHARE * extent).all())
        if vertex == other and small:
            return []
        self.result.reasons.add(FaceReason.LOOP_GAP_CLOSED)
        if vertex == other:
            row = self.table.add(None, vertex, vertex, tolerance)
            return [Coedge(row, CurveForm.line(start, end), pole=one_point)]
        row, backwards = self.table.join(vertex, other)
        return [Coedge(row, CurveForm.line(end, start) if backwards else CurveForm.line(start, end), backwards)]


def _children(shape: Any, kind: Any) -> Iterator[Any]:
    """Direct sub-shapes of one kind that bound: those of internal or external orientation do not."""
    iterator = TopoDS_Iterator(shape)
    while iterator.More():
        child = iterator.Value()
        if child.ShapeType() == kind and child.Orientation() in (FORWARD, REVERSED):
            yield child
        iterator.Next()


def _mark_seams(loops: list[Loop]) -> None:
    rows = [coedge.edge for loop in loops for coedge in loop.coedges if not coedge.pole]
    twice = {row for row in rows if rows.count(row) > 1} if len(set(rows)) < len(rows) else set()
    if twice:
        for loop in loops:
            loop.coedges = [replace(c, seam=True) if c.edge in twice else c for c in loop.coedges]


def signed_area(loop: Loop) -> float:
    """Area in (u, v) inside the loop, positive if it runs counter-clockwise.

    The control polygon is near enough, except for slivers: these are sampled.
    """
    rows = np.concatenate([c.pcurve.polygon()[:: -1 if c.reversed else 1] for c in loop.coedges])
    area = _polygon_area(rows)
    if abs(area) > SLIVER_SHARE * float(np.prod(np.ptp(rows, axis=0))):
        return area
    return _polygon_area(np.concatenate([_sampled(coedge) for coedge in loop.coedges]))


def _sampled(coedge: Coedge) -> Array:
    curve = coedge.pcurve
    n = 2 if len(curve.points) == 2 else SLIVER_SAMPLES
    parameters = np.linspace(curve.t0, curve.t1, n)[:: -1 if coedge.reversed else 1]
    return np.array([curve.point(t) for t in parameters])


def _polygon_area(rows: Array) -> float:
    x, y = (rows - rows[0]).T
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(y[:-1], x[1:]))
