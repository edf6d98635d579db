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
from nurbs_ooc.readers.refusal import FaceRefusedError

FORWARD = TopAbs_Orientation.TopAbs_FORWARD
REVERSED = TopAbs_Orientation.TopAbs_REVERSED
WIRE = TopAbs_ShapeEnum.TopAbs_WIRE
EDGE = TopAbs_ShapeEnum.TopAbs_EDGE

ROUNDING = 1e-9  # relative: p-curve ends closer than this are equal
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
        self.result = FaceLoops()
        self._tolerance: dict[int, float] = {}

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
        for shape in _children(wire, EDGE):
            edge = TopoDS.Edge(shape)
            row = self.table.edge(edge)
            self._tolerance[row] = max(BRep_Tool.Tolerance_s(edge), MIN_TOLERANCE)
            pole = bool(BRep_Tool.Degenerated_s(edge))
            yield Coedge(row, self._pcurve(edge), edge.Orientation() == REVERSED, pole=pole)

    def _pcurve(self, edge: Any) -> CurveForm:
        curve = BRep_Tool.CurveOnSurface_s(edge, self.face, 0.0, 0.0)
        if curve is None:
            self.result.reasons.add(FaceReason.PCURVE_REBUILT)
            ShapeFix_Edge().FixAddPCurve(edge, self.face, False)
            curve = BRep_Tool.CurveOnSurface_s(edge, self.face, 0.0, 0.0)
        if curve is None:
            raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "an edge cannot be projected to its surface")
        return curve_form(curve, *BRep_Tool.Range_s(edge, self.face))

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
            meeting = starts.get(self._vertices(last)[1])
            coedge = self._nearest(last, meeting or [c for cs in starts.values() for c in cs])
            starts[self._vertices(coedge)[0]].remove(coedge)
            shift = self._shift(last.end, coedge.start)
            if shift.any():
                self.result.reasons.add(FaceReason.LOOP_SHIFTED_BY_PERIOD)
                coedge = self._moved(coedge, shift)
            chain += [*self._bridge(last, coedge, extent), coedge]
        shift = self._shift(chain[-1].end, chain[0].start)
        if not shift.any():
            chain += self._bridge(chain[-1], chain[0], extent)
            return Loop(chain)
        turns = -np.round(shift / np.where(self.periods > 0.0, self.periods, 1.0)).astype(int)
        return Loop(chain, (int(turns[0]), int(turns[1])))

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

    def _moved(self, coedge: Coedge, shift: Array) -> Coedge:
        return replace(coedge, pcurve=coedge.pcurve.shifted(shift))

    def _shift(self, target: Array, start: Array) -> Array:
        """Whole periods that bring ``start`` next to ``target``."""
        gap = target - start
        if not self.periods.any() or float(np.abs(gap).max()) < 1e-6:
            return np.zeros(2)
        turns = np.round(gap / np.where(self.periods > 0.0, self.periods, np.inf))
        return np.asarray(np.where(turns == 0.0, 0.0, turns * self.periods))

    def _bridge(self, first: Coedge, second: Coedge, extent: Array) -> list[Coedge]:
        """What has to be put in between two consecutive coedges: nothing, a pole or a straight bridge."""
        start, end = first.end, second.start
        gap = np.abs(end - start)
        if gap.max() <= ROUNDING * (1.0 + np.abs(start).max()):
            return []
        points = [self.surface.Value(*uv) for uv in (start, 0.5 * (start + end), end)]
        vertex = self._vertices(first)[1]
        tolerance = max(self._tolerance[first.edge], self._tolerance[second.edge], self.table.vertex_tolerance(vertex))
        one_point = max(p.Distance(points[0]) for p in points) <= GAP_SLACK * tolerance
        if one_point and bool((gap <= POLE_SHARE * extent).all()):
            return []
        self.result.reasons.add(FaceReason.LOOP_GAP_CLOSED)
        pcurve = CurveForm.line(start, end)
        if one_point:
            row = self.table.add(None, vertex, vertex, tolerance)
        else:
            curve = CurveForm.line(points[0].Coord(), points[2].Coord())
            other = self._vertices(second)[0]
            row = self.table.add(curve, vertex, other, max(tolerance, points[0].Distance(points[2])))
        self._tolerance[row] = tolerance
        return [Coedge(row, pcurve, pole=one_point)]


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
    """Area in (u, v) inside the loop, positive if it runs counter-clockwise; p-curves as 8 chords."""
    rows = []
    for coedge in loop.coedges:
        curve = coedge.pcurve
        n = 2 if curve.degree == 1 and len(curve.points) == 2 else 9
        points = [curve.point(t) for t in np.linspace(curve.t0, curve.t1, n)[:: -1 if coedge.reversed else 1]]
        rows += points[:-1]
    x, y = np.array(rows).T
    x, y = x - x[0], y - y[0]
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
