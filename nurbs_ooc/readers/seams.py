"""Seams for loops that run around a closed surface without one.

A loop that comes back a period further bounds nothing in (u, v). Two of them with opposite senses are
joined along a seam; a single one is joined to the pole on its left::

      v ^   +--<-- B --<--+              +-----pole----+
        |   |             |              |             |
        | seam           seam          seam           seam
        |   |             |              |             |
        |   +-->-- A -->--+              +-->-- A -->--+
        +----------------------> u

The file's own edges stay what they are, so that neighbours still share them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from OCP.Precision import Precision

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.geometry import interpolation
from nurbs_ooc.geometry.builder import Coedge
from nurbs_ooc.geometry.forms import Array, CurveForm
from nurbs_ooc.readers.edges import EdgeTable
from nurbs_ooc.readers.loops import Loop
from nurbs_ooc.readers.refusal import FaceRefusedError

SAMPLES = 33  # points through which a seam that is not straight in space is interpolated
SAME = 1e-9  # of the surface's size: distance at which points are one pole


def close_with_seams(loops: list[Loop], surface: Any, table: EdgeTable) -> list[Loop]:
    """The same loops, with those that wind joined to closed ones.

    Args:
        surface: the located ``Geom_Surface``, closed in the direction of the winding.

    Raises:
        FaceRefusedError: the winding loops do not pair up and there is no pole to join them to.
    """
    winding = [loop for loop in loops if any(loop.winding)]
    axes = {int(np.flatnonzero(loop.winding)[0]) for loop in winding if np.abs(loop.winding).sum() == 1}
    forward = [loop for loop in winding if sum(loop.winding) == 1]
    backward = [loop for loop in winding if sum(loop.winding) == -1]
    if len(axes) != 1 or len(forward) > 1 or len(backward) > 1 or len(forward) + len(backward) != len(winding):
        raise FaceRefusedError(FaceReason.SEAM_ADDED, f"{len(winding)} loops run around the surface and do not pair up")
    joiner = SeamJoiner(surface, table, axes.pop())
    if forward and backward:
        joined = joiner.pair(forward[0].coedges, backward[0].coedges)
    else:
        joined = joiner.to_pole(winding[0].coedges, bool(forward))
    return [Loop(joined), *(joiner.beside(loop, joined) for loop in loops if not any(loop.winding))]


class SeamJoiner:
    """Joins loops that wind along ``axis`` (0: u, 1: v) of one surface."""

    def __init__(self, surface: Any, table: EdgeTable, axis: int) -> None:
        self.surface, self.table, self.axis = surface, table, axis
        self.period = np.zeros(2)
        self.period[axis] = surface.UPeriod() if axis == 0 else surface.VPeriod()

    def pair(self, forward: list[Coedge], backward: list[Coedge]) -> list[Coedge]:
        """One closed loop: along ``forward``, over the seam, along ``backward``, back over the seam."""
        start = forward[0].start
        backward = self._turned(backward, start)
        target = start + self.period + self._across(start, backward[0].start)
        backward = [_moved(coedge, target - backward[0].start) for coedge in backward]
        vertices = self._entry(forward[0]), self._entry(backward[0])
        row, seam = self._seam(start, target - self.period, vertices)
        over = Coedge(row, seam.shifted(self.period), seam=True)
        return [*forward, over, *backward, Coedge(row, seam, reversed=True, seam=True)]

    def to_pole(self, loop: list[Coedge], forward: bool) -> list[Coedge]:
        """One closed loop: along ``loop``, to the pole on its left, along the pole, and back."""
        start = loop[0].start
        step = self.period if forward else -self.period
        tip = start.copy()
        tip[1 - self.axis] = self._pole(start, upwards=forward == (self.axis == 0))
        vertex = self.table.free_vertex(np.array(self.surface.Value(*tip).Coord()))
        row, seam = self._seam(start, tip, (self._entry(loop[0]), vertex))
        pole = Coedge(self.table.add(None, vertex, vertex, 0.0), CurveForm.line(tip + step, tip), pole=True)
        over = Coedge(row, seam.shifted(step), seam=True)
        return [*loop, over, pole, Coedge(row, seam, reversed=True, seam=True)]

    def beside(self, loop: Loop, joined: list[Coedge]) -> Loop:
        """A hole, moved by whole periods to where the joined loop is."""
        low = min(float(c.pcurve.hull()[0][self.axis]) for c in joined)
        own = [c.pcurve.hull() for c in loop.coedges]
        center = 0.5 * (min(h[0][self.axis] for h in own) + max(h[1][self.axis] for h in own))
        turns = np.floor((center - low) / self.period[self.axis])
        return Loop([_moved(c, -turns * self.period) for c in loop.coedges]) if turns else loop

    def _turned(self, loop: list[Coedge], start: Array) -> list[Coedge]:
        """``loop`` from the coedge on whose start the seam is straightest, as one chain."""
        period = float(self.period[self.axis])
        off = [abs((c.start[self.axis] - start[self.axis] + 0.5 * period) % period - 0.5 * period) for c in loop]
        k = int(np.argmin(off))
        return [*loop[k:], *(_moved(c, -self.period) for c in loop[:k])]

    def _across(self, start: Array, end: Array) -> Array:
        """From ``start`` to ``end`` without whole periods along the axis, to the left across it."""
        step = end - start
        period = self.period[self.axis]
        step[self.axis] -= np.round(step[self.axis] / period) * period
        other = 1 - self.axis
        closed = self.surface.IsVPeriodic() if other == 1 else self.surface.IsUPeriodic()
        if closed:
            width = self.surface.VPeriod() if other == 1 else self.surface.UPeriod()
            left = 1.0 if self.axis == 0 else -1.0
            step[other] = left * ((left * step[other]) % width or width)
        return step

    def _pole(self, start: Array, upwards: bool) -> float:
        """Where, across the axis, the surface shrinks to a point on the left of the loop."""
        bounds = self.surface.Bounds()
        other = 1 - self.axis
        value = float(bounds[2 * other + int(upwards)])
        if type(self.surface).__name__ == "Geom_ConicalSurface":
            value = -self.surface.RefRadius() / np.sin(self.surface.SemiAngle())
        ring = []
        for share in (0.0, 0.3, 0.6):
            uv = start + share * self.period
            uv[other] = value
            ring.append(np.array(self.surface.Value(*uv).Coord()))
        size = np.linalg.norm(ring[0] - np.array(self.surface.Value(*start).Coord()))
        misses = max(np.linalg.norm(point - ring[0]) for point in ring)
        if Precision.IsInfinite_s(value) or (value > start[other]) != upwards or not misses <= SAME * size:
            raise FaceRefusedError(FaceReason.SEAM_ADDED, "a loop runs around the surface and there is no pole")
        return value

    def _entry(self, coedge: Coedge) -> int:
        ends = self.table.ends(coedge.edge)
        return ends[1] if coedge.reversed else ends[0]

    def _seam(self, start: Array, end: Array, vertices: tuple[int, int]) -> tuple[int, CurveForm]:
        """A new edge along the straight line start..end of the parameter plane, and that line over 0..1."""
        shares = interpolation.nodes(SAMPLES)
        curve = interpolation.through(self._points(start, end, shares))
        middles = 0.5 * (shares[1:] + shares[:-1])
        fitted = np.array([curve.point(float(t)) for t in middles])
        gap = float(np.linalg.norm(fitted - self._points(start, end, middles), axis=1).max())
        return self.table.add(curve, vertices[0], vertices[1], 2.0 * gap), CurveForm.line(start, end)

    def _points(self, start: Array, end: Array, shares: Array) -> Array:
        return np.array([self.surface.Value(*(start + t * (end - start))).Coord() for t in shares])


def _moved(coedge: Coedge, shift: Array) -> Coedge:
    return replace(coedge, pcurve=coedge.pcurve.shifted(shift)) if np.any(shift) else coedge
