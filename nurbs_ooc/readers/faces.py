"""One kernel face as a surface record with its loops, or a recorded failure."""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Precision import Precision
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS

from nurbs_cache.surface_record import FaceReason, FaceStatus, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.readers.edges import EdgeTable
from nurbs_ooc.readers.loops import FaceLoops, Loop, LoopReader, signed_area
from nurbs_ooc.readers.refusal import FaceRefusedError
from nurbs_ooc.readers.surfaces import Box, read_surface

FORWARD = TopAbs_Orientation.TopAbs_FORWARD
REVERSED = TopAbs_Orientation.TopAbs_REVERSED
HALF_TURN = 0.5 * np.pi
X, Y, Z = np.eye(3)


class FaceReader:
    """Appends the faces of one part to its builder."""

    def __init__(self, builder: BatchBuilder) -> None:
        self.builder = builder
        self.table = EdgeTable(builder)

    def read(self, face: Any, material: int, source: str) -> None:
        """Record ``face`` (a ``TopoDS_Face``); whatever is wrong with it ends up in its status."""
        try:
            self._read(face, material, source)
        except FaceRefusedError as refusal:
            add_failed(self.builder, refusal.reason, material, f"{source} ({refusal})")
        except Exception as error:  # noqa: BLE001 - the kernel's exceptions have no common Python base
            add_failed(self.builder, FaceReason.KERNEL_REFUSED, material, f"{source} ({_one_line(error)})")

    def _read(self, face: Any, material: int, source: str) -> None:
        forward = TopoDS.Face(face.Oriented(FORWARD))
        surface = BRep_Tool.Surface_s(forward)
        if surface is None:
            raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "the face has no surface")
        mirrored = face.Location().Transformation().IsNegative() if not face.Location().IsIdentity() else False
        outside = (face.Orientation() == REVERSED) != mirrored
        loops = LoopReader(forward, surface, self.table).read()
        natural = not loops.loops
        box = _natural_box(surface) if natural else _box_of(loops.loops, surface)
        reading = read_surface(surface, box)
        status, reason = reading.status, reading.reason
        coedges = [natural_loop(self.builder, reading.form)] if natural else _oriented(loops)
        if natural:
            loops.reasons.add(FaceReason.LOOP_MISSING)
        if loops.reasons and status == FaceStatus.EXACT:
            status, reason = FaceStatus.HEALED, max(loops.reasons)
        self.builder.surface(
            reading.form,
            reversed=outside,
            material=material,
            source=source,
            status=status,
            reason=reason,
            approximation_error=reading.approximation_error,
            tolerance=BRep_Tool.Tolerance_s(face),
        )
        for loop in coedges:
            self.builder.loop(loop)


def add_failed(builder: BatchBuilder, reason: FaceReason, material: int, source: str) -> None:
    """Record a face that could not be read: a plane of no extent without loops, status ``FAILED``."""
    form = SurfaceForm.framed(SurfaceKind.PLANE, np.zeros(3), X, Y, Z, domain=(0.0, 0.0, 0.0, 0.0))
    builder.surface(form, material=material, source=source, status=FaceStatus.FAILED, reason=reason)


def _natural_box(surface: Any) -> Box:
    bounds = tuple(float(b) for b in surface.Bounds(0.0, 0.0, 0.0, 0.0))
    if any(Precision.IsInfinite_s(b) for b in bounds):
        raise FaceRefusedError(FaceReason.LOOP_MISSING, "an infinite surface has no boundary")
    u0, u1, v0, v1 = bounds
    return u0, u1, v0, v1


def _box_of(loops: list[Loop], surface: Any) -> Box:
    hulls = [coedge.pcurve.hull() for loop in loops for coedge in loop.coedges]
    low = np.min([hull[0] for hull in hulls], axis=0)
    high = np.max([hull[1] for hull in hulls], axis=0)
    if type(surface).__name__ == "Geom_SphericalSurface":
        low[1], high[1] = max(low[1], -HALF_TURN), min(high[1], HALF_TURN)
    if not (low < high).all():
        raise FaceRefusedError(
            FaceReason.ZERO_AREA, f"the loops span {high[0] - low[0]} x {high[1] - low[1]} in (u, v)"
        )
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _oriented(loops: FaceLoops) -> list[list[Coedge]]:
    """The loops so that the face lies to their left."""
    area = sum(signed_area(loop) for loop in loops.loops)
    if area >= 0.0 or any(any(loop.winding) for loop in loops.loops):
        return [loop.coedges for loop in loops.loops]
    loops.reasons.add(FaceReason.LOOP_REORIENTED)
    return [_backwards(loop.coedges) for loop in loops.loops]


def _backwards(coedges: list[Coedge]) -> list[Coedge]:
    return [Coedge(c.edge, c.pcurve, reversed=not c.reversed, seam=c.seam, pole=c.pole) for c in reversed(coedges)]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
