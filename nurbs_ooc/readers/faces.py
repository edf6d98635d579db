"""One kernel face as a surface record with its loops, or a recorded failure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Precision import Precision
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS

from nurbs_cache.surface_record import FaceReason, FaceStatus, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import Array, CurveForm, SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.readers.edges import EdgeTable
from nurbs_ooc.readers.loops import FaceLoops, Loop, LoopReader, signed_area
from nurbs_ooc.readers.refusal import FaceRefusedError
from nurbs_ooc.readers.seams import close_with_seams
from nurbs_ooc.readers.surfaces import Box, read_surface

FORWARD = TopAbs_Orientation.TopAbs_FORWARD
REVERSED = TopAbs_Orientation.TopAbs_REVERSED
HALF_TURN = 0.5 * np.pi
X, Y, Z = np.eye(3)
ENDING_SURFACES = ("Geom_BSplineSurface", "Geom_BezierSurface")
REACH_SAMPLES = 65
SURE_SHARE = 1e-3  # of the face's box: a smaller negative area may be rounding, the file's sense is kept


@dataclass(frozen=True)
class FaceLabel:
    """What is known of a face besides its shape: row of its material, its name in the file."""

    material: int
    source: str


class FaceReader:
    """Appends the faces of one part to its builder."""

    def __init__(self, builder: BatchBuilder) -> None:
        self.builder = builder
        self.table = EdgeTable(builder)

    def read(self, face: Any, material: int, source: str) -> None:
        """Record ``face`` (a ``TopoDS_Face``); whatever is wrong with it ends up in its status."""
        try:
            self._read(face, FaceLabel(material, source))
        except FaceRefusedError as refusal:
            add_failed(self.builder, refusal.reason, material, f"{source} ({refusal})")
        except Exception as error:  # noqa: BLE001 - the kernel's exceptions have no common Python base
            add_failed(self.builder, FaceReason.KERNEL_REFUSED, material, f"{source} ({_one_line(error)})")

    def _read(self, face: Any, label: FaceLabel) -> None:
        surface, loops = self._loops(face)
        if any(any(loop.winding) for loop in loops.loops):
            loops.reasons.add(FaceReason.SEAM_ADDED)
            loops.loops = close_with_seams(loops.loops, surface, self.table)
        self._record(face, surface, loops, label)

    def _loops(self, face: Any) -> tuple[Any, FaceLoops]:
        forward = TopoDS.Face(face.Oriented(FORWARD))
        surface = BRep_Tool.Surface_s(forward)
        if surface is None:
            raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "the face has no surface")
        return surface, LoopReader(forward, surface, self.table).read()

    def _record(self, face: Any, surface: Any, loops: FaceLoops, label: FaceLabel) -> None:
        natural = not loops.loops
        box = _natural_box(surface) if natural else _box_of(loops.loops, surface)
        reading = read_surface(surface, box)
        coedges = [natural_loop(self.builder, reading.form)] if natural else _oriented(loops, box)
        if natural:
            loops.reasons.add(FaceReason.LOOP_MISSING)
        status, reason = reading.status, reading.reason
        if loops.reasons and status == FaceStatus.EXACT:
            status, reason = FaceStatus.HEALED, max(loops.reasons)
        self.builder.surface(
            reading.form,
            reversed=(face.Orientation() == REVERSED) != _is_mirrored(face),
            material=label.material,
            source=label.source,
            status=status,
            reason=reason,
            approximation_error=reading.approximation_error,
            tolerance=BRep_Tool.Tolerance_s(face),
        )
        for loop in coedges:
            self.builder.loop(loop)


def _is_mirrored(face: Any) -> bool:
    location = face.Location()
    return not location.IsIdentity() and bool(location.Transformation().IsNegative())


def add_failed(builder: BatchBuilder, reason: FaceReason, material: int, source: str) -> None:
    """Record a face that could not be read: a plane of no extent without loops, status ``FAILED``."""
    form = SurfaceForm.framed(SurfaceKind.PLANE, np.zeros(3), X, Y, Z, domain=(0.0, 0.0, 0.0, 0.0))
    builder.surface(form, material=material, source=source, status=FaceStatus.FAILED, reason=reason)


def _natural_box(surface: Any) -> Box:
    bounds = tuple(float(b) for b in surface.Bounds())
    if any(Precision.IsInfinite_s(b) for b in bounds):
        raise FaceRefusedError(FaceReason.LOOP_MISSING, "an infinite surface has no boundary")
    u0, u1, v0, v1 = bounds
    return u0, u1, v0, v1


def _box_of(loops: list[Loop], surface: Any) -> Box:
    curves = [coedge.pcurve for loop in loops for coedge in loop.coedges]
    low, high = _union([curve.hull() for curve in curves])
    if type(surface).__name__ in ENDING_SURFACES:
        u0, u1, v0, v1 = surface.Bounds()
        if low[0] < u0 or high[0] > u1 or low[1] < v0 or high[1] > v1:
            low, high = _union([_reach(curve) for curve in curves])
    if type(surface).__name__ == "Geom_SphericalSurface":
        low[1], high[1] = max(low[1], -HALF_TURN), min(high[1], HALF_TURN)
    if not (low < high).all():
        raise FaceRefusedError(
            FaceReason.ZERO_AREA, f"the loops span {high[0] - low[0]} x {high[1] - low[1]} in (u, v)"
        )
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _union(boxes: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    low, high = zip(*boxes, strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def _reach(curve: CurveForm) -> tuple[Array, Array]:
    """A box around a p-curve, tighter than its hull: by samples, widened where they may miss a bulge."""
    low, high = curve.hull()
    if curve.degree == 1 and len(curve.points) == 2:
        return low, high
    rows = np.array([curve.point(t) for t in np.linspace(curve.t0, curve.t1, REACH_SAMPLES)])
    sampled_low, sampled_high = rows.min(axis=0), rows.max(axis=0)
    margin = np.abs(np.diff(rows, n=2, axis=0)).max(axis=0)
    return np.maximum(low, sampled_low - margin), np.minimum(high, sampled_high + margin)


def _oriented(loops: FaceLoops, box: Box) -> list[list[Coedge]]:
    """The loops so that the face lies to their left."""
    area = sum(signed_area(loop) for loop in loops.loops)
    width, height = box[1] - box[0], box[3] - box[2]
    if area >= -SURE_SHARE * width * height:
        return [loop.coedges for loop in loops.loops]
    loops.reasons.add(FaceReason.LOOP_REORIENTED)
    return [_backwards(loop.coedges) for loop in loops.loops]


def _backwards(coedges: list[Coedge]) -> list[Coedge]:
    return [Coedge(c.edge, c.pcurve, reversed=not c.reversed, seam=c.seam, pole=c.pole) for c in reversed(coedges)]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
