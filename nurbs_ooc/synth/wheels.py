"""Road wheels, brakes and axles: tyres and rims of revolution, discs with windows and holes, studs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.car_shape import CarShape
from nurbs_ooc.synth.fasteners import fastener
from nurbs_ooc.synth.outline import Outline
from nurbs_ooc.synth.part_draft import PartDraft, chained, turn
from nurbs_ooc.synth.solid import SolidBuilder, Steps
from nurbs_ooc.synth.tube import add_tube

Array = npt.NDArray[np.float64]

TYRE_WIDTH, RIM_RADIUS = 195.0, 203.0  # mm: 195/65 R15


def wheel_places(shape: CarShape) -> list[Array]:
    """Four placements of something whose axis is z and whose outside looks along z."""
    front, rear = shape.wheelbase
    left, right = turn(0, -0.5 * np.pi), chained(turn(2, np.pi), turn(0, -0.5 * np.pi))
    places = []
    for x in (front, rear):
        for place, side in ((left, 1.0), (right, -1.0)):
            moved = place.copy()
            moved[:, 3] = (x, side * shape.track, shape.wheel_radius)
            places.append(moved)
    return places


def _window(n: int, spoke: float) -> Outline:
    """The opening between two of n spokes."""
    inner, outer = 74.0, 168.0
    half = np.pi / n
    corners = []
    for radius, share in ((inner, 0.9), (outer, 1.0)):
        angle = half * share - 0.5 * spoke / radius
        corners.append((radius * np.cos(angle), radius * np.sin(angle)))
    (xi, yi), (xo, yo) = corners
    return Outline.polygon(
        np.array([(xi, -yi), (xo, -yo), (xo + 9.0, 0.0), (xo, yo), (xi, yi)]), np.array([6.0, 14.0, 60.0, 14.0, 6.0])
    )


def _turned(outline: Outline, angle: float) -> Outline:
    c, s = np.cos(angle), np.sin(angle)
    spin = np.array([[c, s], [-s, c]])
    return Outline(tuple(type(p)(p.points @ spin, p.weights, p.knots) for p in outline.pieces))


def wheels(shape: CarShape, roles: dict[str, int], spokes: int) -> list[PartDraft]:
    """Tyres, rims, brake discs, callipers, wheel bolts and valves, each made once and placed at every wheel."""
    places, group = wheel_places(shape), ("chassis", "wheels")
    parts = []
    tyre = SolidBuilder(builder := BulkBuilder(), material=roles["rubber"])
    height = shape.wheel_radius - RIM_RADIUS
    tyre.revolved(Outline.rectangle(height, TYRE_WIDTH, 40.0, RIM_RADIUS + 0.5 * height))
    for z in (-60.0, -22.0, 22.0, 60.0):  # tread ribs
        tyre.revolved(Outline.rectangle(3.0, 24.0, 1.0, shape.wheel_radius + 1.0, z * 0.9))
    parts.append(PartDraft("tyre", group, builder, places))
    rim = SolidBuilder(builder := BulkBuilder(), material=roles["alloy"])
    rim.revolved(Outline.rectangle(14.0, 180.0, 5.0, RIM_RADIUS - 8.0))
    rim.revolved(Outline.rectangle(12.0, 10.0, 3.0, RIM_RADIUS + 3.0, 92.0))
    windows = [_turned(_window(spokes, 34.0), 2.0 * np.pi * k / spokes) for k in range(spokes)]
    turns = 2.0 * np.pi * (np.arange(5) + 0.5) / 5.0
    lugs = [Outline.circle(7.5, 50.0 * np.cos(a), 50.0 * np.sin(a)) for a in turns]
    cap = Steps(0.0, 0.0, ((32.0, 0.0), (32.0, 6.0), (27.0, 11.0), (12.0, 13.0)))
    rim.plate(Outline.circle(RIM_RADIUS - 12.0), 48.0, 72.0, [*windows, *lugs], [cap])
    parts.append(PartDraft("rim", group, builder, places))
    disc = SolidBuilder(builder := BulkBuilder(), material=roles["cast iron"])
    around = 2.0 * np.pi * np.arange(24) / 24.0
    cooling = [
        Outline.circle(4.0, (100.0 + 16.0 * (k % 3)) * np.cos(a), (100.0 + 16.0 * (k % 3)) * np.sin(a))
        for k, a in enumerate(around)
    ]
    disc.plate(Outline.circle(142.0), 0.0, 22.0, cooling, [Steps(0, 0, ((78.0, 0.0), (76.0, 20.0), (60.0, 22.0)))])
    parts.append(PartDraft("brake disc", ("chassis", "brakes"), builder, places))
    calliper = SolidBuilder(builder := BulkBuilder(), material=roles["cast aluminium"])
    angle = np.linspace(-0.5, 0.5, 5)
    shell = np.concatenate(
        [158.0 * np.stack([np.cos(angle), np.sin(angle)], 1), 96.0 * np.stack([np.cos(angle), np.sin(angle)], 1)[::-1]]
    )
    pistons = [Steps(125.0, y, ((20.0, 0.0), (20.0, 8.0), (16.0, 10.0)), top=False) for y in (-26.0, 26.0)]
    calliper.plate(Outline.polygon(shell, 6.0), -26.0, 44.0, [], pistons)
    parts.append(PartDraft("brake calliper", ("chassis", "brakes"), builder, places))
    bolt = fastener(1 + 8 * 4, roles["steel"])[1]
    seats = [chained(place, turn(2, 0.0, 50.0 * np.cos(a), 50.0 * np.sin(a), 73.0)) for place in places for a in turns]
    parts.append(PartDraft("wheel bolt", group, bolt, seats))
    add_tube(builder := BulkBuilder(), np.linspace((175.0, 0.0, 70.0), (150.0, 0.0, 100.0), 4), 4.0, 3, roles["rubber"])
    parts.append(PartDraft("valve", group, builder, places))
    for name, x in (("front axle", shape.wheelbase[0]), ("rear axle", shape.wheelbase[1])):
        y = shape.track - 60.0
        course = np.stack(
            [np.full(9, x), np.linspace(-y, y, 9), shape.wheel_radius + 40.0 * np.cos(np.linspace(-np.pi, np.pi, 9))], 1
        )
        add_tube(builder := BulkBuilder(), course, 24.0, 3, roles["steel"])
        parts.append(PartDraft(name, ("chassis", "axles"), builder))
    return parts
