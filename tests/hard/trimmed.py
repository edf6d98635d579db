"""Trimming loops that are thin, gaping, turned the wrong way, many, or wound many times around."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_polygon_trimmed
from tests.hard.case import ERRORS, EXACT_OR_HEALED, HardCase
from tests.hard.loops import TURN, X, Y, Z, circle_loop, hermite_edge, plane, shrunk_polygon_loop

Array = npt.NDArray[np.float64]

PI = np.pi
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
GAPS = (1e-12, 1e-9, 1e-6, 1e-4, 1e-3)
NEAR_ANGLE = 2.2  # rad
WEBS = (1.0, 1e-2, 1e-4, 1e-6)  # of the widest web, 0.5 mm
HOLES, PITCH, WEB = 20, 1.0, 0.002  # a plate of 20 x 20 holes with webs of 2 µm
PCURVE_OFF = 5e-3  # mm


def square_with_gaps(gap: float, builder: BatchBuilder) -> None:
    """A unit square whose sides end ``gap`` before its corners."""
    form = plane((0.0, 0.0), (1.0, 1.0))
    builder.surface(form, tolerance=gap)
    shrunk_polygon_loop(builder, form, SQUARE, gap)


def disc_with_near_hole(web: float, builder: BatchBuilder) -> None:
    """A unit disc with a hole of radius 1/2 that leaves ``web`` mm in a direction where neither circle has a vertex."""
    builder.surface(plane((-1.0, -1.0), (1.0, 1.0)))
    circle_loop(builder, (0.0, 0.0), 1.0)
    away = 0.5 - web
    circle_loop(builder, (away * np.cos(NEAR_ANGLE), away * np.sin(NEAR_ANGLE)), 0.5, ccw=False)


def wrong_way_loops(builder: BatchBuilder) -> None:
    """A plate of 4 x 4 with a hole of 2 x 2 and an island of 1 x 1 in it, all loops turned the wrong way."""
    rings = [np.array([[-h, -h], [h, -h], [h, h], [-h, h]]) for h in (2.0, 1.0, 0.5)]
    wrong = [rings[0][::-1], rings[1], rings[2][::-1]]
    add_polygon_trimmed(builder, plane((-2.0, -2.0), (2.0, 2.0)), wrong)


def plate_with_holes(builder: BatchBuilder) -> None:
    """20 x 20 mm, 400 holes that leave 2 µm between them, and 1 µm to the rim."""
    side = HOLES * PITCH
    form = plane((0.0, 0.0), (side, side))
    builder.surface(form)
    shrunk_polygon_loop(builder, form, side * SQUARE, 0.0)
    for i in range(HOLES):
        for j in range(HOLES):
            circle_loop(builder, ((i + 0.5) * PITCH, (j + 0.5) * PITCH), 0.5 * (PITCH - WEB), ccw=False)


def pcurve_off_its_edge(builder: BatchBuilder) -> None:
    """A half cylinder; the p-curve of one rim runs 5 µm beside its edge in the middle."""
    form = SurfaceForm.framed(SurfaceKind.CYLINDER, np.zeros(3), X, Y, Z, domain=(0.0, PI, -0.1, 1.0))
    builder.surface(form)
    corner = [builder.vertex(form.point(*uv)) for uv in ((0, 0), (PI, 0), (PI, 1), (0, 1.0))]
    off = CurveForm.nurbs(2, np.array([0, 0, 0, PI, PI, PI]), np.array([[0, 0], [PI / 2, -2 * PCURVE_OFF], [PI, 0.0]]))
    bottom = builder.edge(form.iso_v(0.0), corner[0], corner[1])
    right = builder.edge(form.iso_u(PI).over(0.0, 1.0), corner[1], corner[2])
    top = builder.edge(form.iso_v(1.0), corner[3], corner[2])
    left = builder.edge(form.iso_u(0.0).over(0.0, 1.0), corner[0], corner[3])
    builder.loop(
        [
            Coedge(bottom, off),
            Coedge(right, CurveForm.line((PI, 0.0), (PI, 1.0))),
            Coedge(top, CurveForm.line((0.0, 1.0), (PI, 1.0), 0.0, PI), reversed=True),
            Coedge(left, CurveForm.line((0.0, 0.0), (0.0, 1.0)), reversed=True),
        ]
    )


def thread_ribbon(builder: BatchBuilder, turns: int = 20, pitch: float = 0.05, width: float = 0.02) -> None:
    """A helical ribbon on a cylinder of radius 1: its rims climb 0.05 mm in a period of 2 pi, twenty times."""
    top = turns * pitch + width
    form = SurfaceForm.framed(SurfaceKind.CYLINDER, np.zeros(3), X, Y, Z, domain=(0.0, turns * TURN, 0.0, top))
    builder.surface(form)
    end = turns * TURN
    u = np.linspace(0.0, end, 32 * turns + 1)
    edges = []
    for start in (0.0, width):
        z = start + pitch * u / TURN
        points = np.stack([np.cos(u), np.sin(u), z], axis=1)
        first = np.stack([-np.sin(u), np.cos(u), np.full(len(u), pitch / TURN)], axis=1)
        second = np.stack([-np.cos(u), -np.sin(u), np.zeros(len(u))], axis=1)
        row, curve = hermite_edge(builder, u, points, first, second)
        edges.append((row, curve, CurveForm.line((0.0, start), (end, start + turns * pitch), 0.0, end)))
    (low, low_curve, low_p), (high, high_curve, high_p) = edges
    vertex = [len(builder._vertices) - 4 + k for k in range(4)]
    right = builder.edge(CurveForm.line(low_curve.end, high_curve.end), vertex[1], vertex[3])
    left = builder.edge(CurveForm.line(low_curve.start, high_curve.start), vertex[0], vertex[2])
    builder.loop(
        [
            Coedge(low, low_p),
            Coedge(right, CurveForm.line(low_p.end, high_p.end)),
            Coedge(high, high_p, reversed=True),
            Coedge(left, CurveForm.line(low_p.start, high_p.start), reversed=True),
        ]
    )


def _off_unit_cylinder(points: Array) -> Array:
    return np.abs(np.hypot(points[:, 0], points[:, 1]) - 1.0)


def _off_plane(points: Array) -> Array:
    return np.abs(points[:, 2])


def trimmed_cases() -> list[HardCase]:
    """All cases of this module."""
    gap_reasons = (FaceReason.NONE, FaceReason.FILE_GAP, FaceReason.LOOP_GAP_CLOSED)
    gaps = [
        HardCase(
            f"square_gaps_{gap:.0e}", partial(square_with_gaps, gap), area=1.0, euler=1, components=1,
            distance=_off_plane, floor=2.0 * gap, statuses=EXACT_OR_HEALED, reasons=gap_reasons, most_triangles=16,
            slack=4.0 * gap / ERRORS[-1] + 1e-9,
        )
        for gap in GAPS
    ]  # fmt: skip
    webs = [
        HardCase(
            f"near_hole_web_{0.5 * web:.0e}", partial(disc_with_near_hole, 0.5 * web), area=PI * 0.75, euler=0,
            components=1, distance=_off_plane,
        )
        for web in WEBS
    ]  # fmt: skip
    holes = HOLES * HOLES
    return [
        *gaps,
        *webs,
        HardCase(
            "wrong_way_hole_and_island", wrong_way_loops, area=13.0, euler=1, components=2, distance=_off_plane,
            slack=1e-9, most_triangles=16,
        ),
        HardCase(
            "plate_400_holes", plate_with_holes, area=(HOLES * PITCH) ** 2 - holes * PI * (0.5 * (PITCH - WEB)) ** 2,
            euler=1 - holes, components=1, distance=_off_plane, slack=holes * PI,
        ),
        HardCase(
            "pcurve_5um_off_its_edge", pcurve_off_its_edge, area=PI, euler=1, components=1, errors=(1e-4,),
            statuses=EXACT_OR_HEALED, reasons=(FaceReason.FILE_GAP,), floor=1.1 * PCURVE_OFF, slack=2e3,
            most_triangles=2000, far=False,
        ),
        HardCase(
            "thread_ribbon", thread_ribbon, area=20 * TURN * 0.02, euler=1, components=1, distance=_off_unit_cylinder,
            statuses=EXACT_OR_HEALED, reasons=gap_reasons, floor=1e-7,
        ),
    ]  # fmt: skip
