"""What fills a car: seats, dashboard, engine and gearbox, floor, wheel houses, exhaust, mirrors, wipers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.car_shape import CarShape
from nurbs_ooc.synth.outline import Outline
from nurbs_ooc.synth.part_draft import MIRRORED, STAY, PartDraft, chained, shift, turn
from nurbs_ooc.synth.patch_grid import Division
from nurbs_ooc.synth.shell import Looks, add_shell
from nurbs_ooc.synth.solid import SolidBuilder, Steps
from nurbs_ooc.synth.tube import add_tube

Array = npt.NDArray[np.float64]


def soft_block(
    size: tuple[float, float, float], patches: tuple[int, int], material: int, rng: np.random.Generator
) -> BulkBuilder:
    """A cushion of the given size, mm, around the origin: a closed shell with crowned, rounded sheets."""
    degree = int(rng.choice([3, 4, 5, 6]))
    columns, rows = (Division.even(k, degree + 3, degree) for k in patches)
    x, y = np.meshgrid(2.0 * columns.nodes() - 1.0, 2.0 * rows.nodes() - 1.0, indexing="ij")
    sheets = []
    for sign in (1.0, -1.0):
        z = sign * (1.0 - 0.25 * x**4 - 0.25 * y**4 + 0.03 * np.cos(6.0 * x))
        sheets.append(0.5 * np.stack([x * (1.0 - 0.06 * y**2), y * (1.0 - 0.06 * x**2), z], axis=2) * size)
    builder = BulkBuilder()
    rational = rng.random(patches) < 0.4
    add_shell(builder, sheets[0], sheets[1], columns, rows, Looks(rational, material, None, rng))
    return builder


def cabin(shape: CarShape, roles: dict[str, int], rng: np.random.Generator, fineness: int) -> list[PartDraft]:
    """Seats, dashboard, console, steering wheel, shelves."""
    parts = []
    p = 2 + fineness
    front, rear = shape.doors[0] + 640.0, shape.doors[1] + 560.0

    def add(name: str, size: tuple[float, float, float], role: str, places: list[Array], group: str = "seats") -> None:
        parts.append(PartDraft(name, ("interior", group), soft_block(size, (p, p), roles[role], rng), places))

    def both(place: Array) -> list[Array]:
        return [place, chained(MIRRORED, place)]

    cloth = "leather" if "leather" in roles else "fabric"
    add("front seat cushion", (520.0, 500.0, 150.0), cloth, both(shift(front, 360.0, 480.0)))
    add("front seat back", (620.0, 480.0, 140.0), cloth, both(turn(1, -1.25, front + 330.0, 360.0, 770.0)))
    add("head restraint", (170.0, 260.0, 100.0), cloth, both(turn(1, -1.3, front + 430.0, 360.0, 1140.0)))
    add("rear bench", (520.0, 1240.0, 150.0), cloth, [shift(rear, 0.0, 480.0)])
    add("rear bench back", (600.0, 1240.0, 130.0), cloth, [turn(1, -1.2, rear + 310.0, 0.0, 760.0)])
    add("dashboard", (420.0, 1330.0, 330.0), "plastic", [shift(shape.doors[0] + 60.0, 0.0, 800.0)], "controls")
    add("centre console", (900.0, 200.0, 300.0), "plastic", [shift(front - 60.0, 0.0, 460.0)], "controls")
    add("door card", (760.0, 60.0, 520.0), "plastic", both(shift(shape.doors[0] + 560.0, 770.0, 640.0)), "trim")
    add("rear shelf", (420.0, 1100.0, 30.0), "carpet", [shift(shape.doors[-1] + 420.0, 0.0, 930.0)], "trim")
    add("dashboard inlay", (20.0, 1180.0, 60.0), "wood", [shift(shape.doors[0] + 275.0, 0.0, 820.0)], "controls")
    middle = 0.5 * (shape.roof_edge[0][0] + shape.roof_edge[-1][0])
    add("headliner", (1000.0, 960.0, 16.0), "headliner", [shift(middle, 0.0, shape.roof_z - 45.0)], "trim")
    wheel = SolidBuilder(builder := BulkBuilder(), turn(1, -0.45, front - 330.0, 360.0, 900.0), roles["plastic"])
    wheel.revolved(Outline.rectangle(28.0, 28.0, 12.0, 180.0))
    wheel.plate(Outline.rectangle(330.0, 60.0, 20.0), -8.0, 8.0, [], [Steps(0, 0, ((60.0 / 2.2, 0.0), (26.0, 14.0)))])
    parts.append(PartDraft("steering wheel", ("interior", "controls"), builder))
    return parts


def drive(shape: CarShape, roles: dict[str, int], rng: np.random.Generator, fineness: int) -> list[PartDraft]:
    """Engine, gearbox, battery, radiator, exhaust, tank, floor and wheel houses."""
    parts = []
    p = 2 + fineness
    axle, rear = shape.wheelbase
    blocks = (
        ("engine block", (480.0, 560.0, 420.0), "cast iron", (axle - 120.0, -60.0, 520.0)),
        ("cylinder head", (420.0, 520.0, 130.0), "cast aluminium", (axle - 120.0, -60.0, 720.0)),
        ("engine cover", (430.0, 500.0, 40.0), "engine black", (axle - 120.0, -60.0, 785.0)),
        ("gearbox", (520.0, 420.0, 340.0), "cast aluminium", (axle + 80.0, 320.0, 400.0)),
        ("battery", (260.0, 175.0, 190.0), "engine black", (axle - 180.0, 480.0, 640.0)),
        ("radiator", (60.0, 640.0, 400.0), "engine black", (260.0, 0.0, 470.0)),
        ("air box", (280.0, 240.0, 220.0), "plastic", (axle - 60.0, -470.0, 640.0)),
        ("tank", (520.0, 1000.0, 220.0), "engine black", (rear - 480.0, 0.0, 330.0)),
        ("silencer", (520.0, 260.0, 160.0), "steel", (rear + 330.0, -300.0, 280.0)),
        ("spare wheel well", (620.0, 620.0, 200.0), "underbody", (rear + 320.0, 250.0, 340.0)),
    )
    for name, size, role, at in blocks:
        block = soft_block(size, (p, p), roles[role], rng)
        parts.append(PartDraft(name, ("drive",), block, [shift(*at)]))
    floor = SolidBuilder(builder := BulkBuilder(), material=roles["underbody"])
    length = rear - axle - 760.0
    holes = [
        Outline.circle(18.0, axle + 480.0 + 180.0 * i, 230.0 * j)
        for i in range(int(length / 180.0))
        for j in (-2, -1, 1, 2)
    ]
    floor.plate(Outline.rectangle(length, 1480.0, 40.0, 0.5 * (axle + rear)), 200.0, 206.0, holes)
    parts.append(PartDraft("floor", ("body in white",), builder))
    for name, low, high in (("front floor", 260.0, axle - 380.0), ("rear floor", rear + 380.0, shape.length - 160.0)):
        plate = SolidBuilder(builder := BulkBuilder(), material=roles["underbody"])
        plate.plate(Outline.rectangle(max(high - low, 80.0), 1300.0, 30.0, 0.5 * (low + high)), 232.0, 238.0)
        parts.append(PartDraft(name, ("body in white",), builder))
    parts += _wheel_houses(shape, roles)
    t = np.linspace(0.0, 1.0, 24)
    course = np.stack(
        [
            axle + 100.0 + t * (rear + 250.0 - axle - 100.0),
            -120.0 - 180.0 * t + 40.0 * np.sin(9.0 * t),
            235.0 + 25.0 * np.sin(7.0 * t),
        ],
        1,
    )
    add_tube(builder := BulkBuilder(), course, 25.0, 3, roles["steel"])
    parts.append(PartDraft("exhaust pipe", ("drive",), builder))
    end = shape.length - 70.0
    add_tube(
        builder := BulkBuilder(),
        np.linspace((rear + 500.0, -380.0, 260.0), (end, -420.0, 250.0), 6),
        27.0,
        3,
        roles["chrome"],
    )
    parts.append(PartDraft("tail pipe", ("drive",), builder))
    parts += _harness(shape, roles, rng, 6 * fineness)
    return parts


def _harness(shape: CarShape, roles: dict[str, int], rng: np.random.Generator, n: int) -> list[PartDraft]:
    """Cables and hoses of up to 2 m: few surfaces with thousands of control points."""
    parts = []
    for k in range(n):
        points = int(rng.integers(60, 330))
        length = float(rng.uniform(600.0, 1950.0))
        start = np.array(
            [rng.uniform(300.0, shape.length - length - 300.0), rng.uniform(-560.0, 560.0), rng.uniform(260.0, 420.0)]
        )
        t = np.linspace(0.0, 1.0, points)
        sway = rng.uniform(8.0, 30.0, 2)[:, None] * np.sin(
            rng.uniform(8.0, 40.0, 2)[:, None] * t + rng.uniform(0.0, 6.0, (2, 1))
        )
        course = start + np.stack([length * t, sway[0], sway[1]], axis=1)
        radius, degree = float(rng.uniform(3.0, 9.0)), int(rng.choice([2, 3, 5, 7]))
        add_tube(builder := BulkBuilder(), course, radius, degree, roles["copper" if k % 4 == 0 else "rubber"])
        parts.append(PartDraft(f"cable {k + 1}", ("electrics", "harness"), builder))
    return parts


def _wheel_houses(shape: CarShape, roles: dict[str, int]) -> list[PartDraft]:
    """Half drums over the wheels, closed shells."""
    columns, rows = Division.even(6, 6, 3), Division.even(2, 4, 3)
    angle, across = np.meshgrid(np.pi * (1.08 - 1.16 * columns.nodes()), rows.nodes(), indexing="ij")
    builder = BulkBuilder()
    sheets = [
        np.stack([radius * np.cos(angle), 845.0 - 285.0 * across, radius * np.sin(angle)], axis=2)
        for radius in (shape.wheel_radius + 46.0, shape.wheel_radius + 49.0)
    ]
    add_shell(builder, sheets[0], sheets[1], columns, rows, Looks(material=roles["underbody"]))
    places = [shift(x, 0.0, shape.wheel_radius) for x in shape.wheelbase]
    drum = PartDraft("wheel house", ("body in white",), builder, places + [chained(MIRRORED, p) for p in places])
    wall = SolidBuilder(builder := BulkBuilder(), turn(0, -0.5 * np.pi, 0.0, 556.0, 0.0), roles["underbody"])
    radius = shape.wheel_radius + 46.0
    wall.plate(Outline.circle(radius), -2.0, 2.0, [Outline.circle(60.0)])
    closing = PartDraft("wheel house wall", ("body in white",), builder, list(drum.places))
    return [drum, closing]


def fittings(shape: CarShape, roles: dict[str, int], rng: np.random.Generator, fineness: int) -> list[PartDraft]:
    """Door mirrors, wipers, aerial, badge."""
    parts = []
    p = 1 + fineness
    at = shape.doors[0] + 190.0
    mirror = soft_block((150.0, 230.0, 150.0), (p, p), roles["paint"], rng)
    place = turn(2, 0.12, at, 905.0, 1010.0)
    parts.append(PartDraft("door mirror", ("exterior", "mirrors"), mirror, [place, chained(MIRRORED, place)]))
    foot = soft_block((70.0, 120.0, 40.0), (1, 1), roles["plastic"], rng)
    place = shift(at - 10.0, 790.0, 965.0)
    parts.append(PartDraft("mirror foot", ("exterior", "mirrors"), foot, [place, chained(MIRRORED, place)]))
    pane = soft_block((6.0, 190.0, 115.0), (1, 1), roles["mirror glass"], rng)
    place = turn(2, 0.12, at + 74.0, 908.0, 1010.0)
    parts.append(PartDraft("mirror pane", ("exterior", "mirrors"), pane, [place, chained(MIRRORED, place)]))
    foot_x = shape.screen_foot[0][0]
    for name, y0, y1 in (("driver wiper", 450.0, -120.0), ("passenger wiper", -90.0, -560.0)):
        t = np.linspace(0.0, 1.0, 12)
        bow = 20.0 * np.sin(np.pi * t)
        y = y0 + t * (y1 - y0)
        x = foot_x + 28.0 + 120.0 * t * 0.5 + 75.0 * (np.abs(y) / 560.0) ** 2
        z = shape.belt(np.array([foot_x]))[0] + 8.0 + (x - foot_x) * 0.62 + bow * 0.3
        add_tube(builder := BulkBuilder(), np.stack([x, y, z], 1), 7.0, 3, roles["plastic"])
        parts.append(PartDraft(name, ("exterior", "wipers"), builder))
    course = np.linspace(
        (shape.roof_edge[-1][0] - 120.0, 0.0, shape.height - 20.0),
        (shape.roof_edge[-1][0] + 60.0, 0.0, shape.height + 240.0),
        5,
    )
    add_tube(builder := BulkBuilder(), course, 3.0, 2, roles["plastic"])
    parts.append(PartDraft("aerial", ("exterior", "trim"), builder))
    badge = SolidBuilder(
        builder := BulkBuilder(),
        turn(1, -0.5 * np.pi, -4.0, 0.0, 0.62 * shape.belt(np.array([0.0]))[0] + 110.0),
        roles["chrome"],
    )
    badge.revolved(Outline.rectangle(8.0, 8.0, 2.0, 46.0))
    badge.plate(Outline.rectangle(84.0, 10.0, 2.0), -3.0, 3.0)
    badge.plate(Outline.rectangle(10.0, 84.0, 2.0), -3.2, -3.1 + 5.0)
    parts.append(PartDraft("badge", ("exterior", "trim"), builder, [STAY]))
    return parts
