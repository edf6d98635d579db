"""What is seen of a car from outside: painted panels, glass, lamps, bumpers, as closed shells with shut lines.

Panels are intervals of the master shapes, drawn in by half a shut line all round. The left side is made;
the right side is its mirrored placement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.arched import Arch, add_arched_panel
from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.car_shape import CarShape, Masters
from nurbs_ooc.synth.part_draft import MIRRORED, STAY, PartDraft
from nurbs_ooc.synth.patch_grid import Division
from nurbs_ooc.synth.shell import Looks, add_shell, offset

Array = npt.NDArray[np.float64]
Surface = Callable[[Array, Array], Array]

SHUT_LINE = 4.0  # mm between panels
ARCH_CLEARANCE = 32.0  # mm between tyre and wheel arch


@dataclass(frozen=True)
class Cut:
    """An interval of a master shape's parameters."""

    s0: float
    s1: float
    t0: float = 0.0
    t1: float = 1.0


def drawn_in(master: Surface, cut: Cut, gap: float = 0.5 * SHUT_LINE) -> Surface:
    """The part of ``master`` inside ``cut`` and ``gap`` mm away from its borders, over the unit square."""
    middle = np.array([0.5 * (cut.s0 + cut.s1)]), np.array([0.5 * (cut.t0 + cut.t1)])
    ds, dt = 1e-3 * (cut.s1 - cut.s0), 1e-3 * (cut.t1 - cut.t0)

    def steps(s: Array, t: Array) -> float:
        """Millimetres that a small step covers."""
        return max(float(np.linalg.norm(np.ptp(master(s, t).reshape(2, 3), axis=0))), 1e-9)

    s0 = cut.s0 + gap * ds / steps(np.array([cut.s0, cut.s0 + ds]), middle[1])
    s1 = cut.s1 - gap * ds / steps(np.array([cut.s1 - ds, cut.s1]), middle[1])
    t0 = cut.t0 + gap * dt / steps(middle[0], np.array([cut.t0, cut.t0 + dt]))
    t1 = cut.t1 - gap * dt / steps(middle[0], np.array([cut.t1 - dt, cut.t1]))
    return lambda u, v: master(s0 + u * (s1 - s0), t0 + v * (t1 - t0))


class Exterior:
    """Makes the exterior's parts.

    Args:
        shape: the car.
        roles: material rows by role.
        fineness: patches along a panel's sides, relative to the small car's.
        rng: for degrees, weights and sizes.
    """

    def __init__(self, shape: CarShape, roles: dict[str, int], fineness: int, rng: np.random.Generator) -> None:
        self.shape, self.masters, self.roles = shape, Masters(shape), roles
        self.fineness, self.rng = fineness, rng
        self.parts: list[PartDraft] = []

    def panel(
        self, name: str, group: str, surface: Surface, patches: tuple[int, int], role: str | npt.NDArray[np.integer],
        *, both: bool = False, thickness: float = 1.2, lift: float = 0.0,
    ) -> None:  # fmt: skip
        """A closed shell under ``surface``, in k x l patches; ``role`` names its material, or gives rows (k, l)."""
        k, l = (max(1, p * self.fineness) for p in patches)  # noqa: E741
        material = (
            self.roles[role]
            if isinstance(role, str)
            else np.kron(role, np.ones((k // role.shape[0], l // role.shape[1]), int))
        )
        columns, rows = self._division(k), self._division(l)
        points = self._outward(surface)(columns.nodes(), rows.nodes())
        if lift:
            points = offset(points, lift)
        rational = self.rng.random((k, l)) < 0.3
        builder = BulkBuilder()
        looks = Looks(rational, material, None, self.rng)
        add_shell(builder, points, offset(points, -thickness), columns, rows, looks)
        self._add(name, group, builder, both)

    def _outward(self, surface: Surface) -> Surface:
        """``surface``, or its mirror image in u, so that u x v looks away from the car's middle."""
        steps = np.linspace(0.0, 1.0, 5)
        points = surface(steps, steps)
        normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1)).sum(axis=(0, 1))
        middle = np.array([0.5 * self.shape.length, 0.0, 0.45 * self.shape.height])
        if normal @ (points.mean(axis=(0, 1)) - middle) > 0.0:
            return surface
        return lambda u, v: surface(1.0 - u, v)

    def _division(self, k: int) -> Division:
        degree = int(self.rng.choice([3, 3, 4, 5, 5, 6, 7]))
        return Division.even(k, degree + int(self.rng.integers(2, 6)), degree)

    def _add(self, name: str, group: str, builder: BulkBuilder, both: bool) -> None:
        self.parts.append(PartDraft(name, ("exterior", group), builder, [STAY, MIRRORED] if both else [STAY]))

    def make(self) -> list[PartDraft]:
        """All parts."""
        self._sides()
        self._nose()
        self._tail()
        self._greenhouse()
        return self.parts

    def _sides(self) -> None:
        m, car = self.masters, self.shape
        doors = [m.s_at(x) for x in car.doors]
        front, rear = m.s_at(NOSE_END), m.s_at(car.length - TAIL_LENGTH)
        for name, cut, axle in (
            ("front wing", Cut(front, doors[0]), car.wheelbase[0]),
            ("rear wing", Cut(doors[-1], rear), car.wheelbase[1]),
        ):
            builder = BulkBuilder()
            arch = Arch(axle, car.wheel_radius, car.wheel_radius + ARCH_CLEARANCE)
            size = (20 + 4 * self.fineness, 12 + 2 * self.fineness)
            add_arched_panel(
                builder, self._outward(drawn_in(m.lower, cut)), size, (5, 5), arch, 1.2, self.roles["paint"]
            )
            self._add(name, "sides", builder, True)
        low = SILL_TOP
        for name, s0, s1 in (("front door", doors[0], doors[1]), ("rear door", doors[1], doors[2])):
            self.panel(name, "sides", drawn_in(m.lower, Cut(s0, s1, low)), (3, 3), "paint", both=True)
            strip = drawn_in(m.lower, Cut(s0, s1, 0.44, 0.485), 6.0)
            self.panel(f"{name} moulding", "trim", strip, (3, 1), "plastic", both=True, thickness=7.0, lift=8.5)
            reach = s1 - s0
            grip = drawn_in(m.lower, Cut(s1 - 0.24 * reach, s1 - 0.06 * reach, 0.735, 0.775), 0.0)
            self.panel(f"{name} handle", "trim", grip, (2, 1), "plastic", both=True, thickness=16.0, lift=22.0)
        self.panel("sill", "sides", drawn_in(m.lower, Cut(doors[0], doors[-1], 0.0, low)), (4, 1), "paint", both=True)

    def _nose(self) -> None:
        m = self.masters
        corner, side = m.s_at(NOSE_END), m.s_at(LAMP_INNER)
        cowl = m.s_at(self.shape.screen_foot[3][0] - 25.0)
        bumper = np.full((6, 3), self.roles["paint"])
        bumper[1:5, 1] = self.roles["plastic"]
        self.panel(
            "front bumper",
            "nose",
            drawn_in(m.lower, Cut(-corner, corner, 0.0, BUMPER_TOP)),
            (6, 3),
            bumper,
            thickness=3.0,
        )
        lamp = drawn_in(m.lower, Cut(side, corner, BUMPER_TOP, 0.97))
        self.panel("head lamp", "lamps", lamp, (2, 2), "clear lens", both=True, thickness=3.0)
        grille = drawn_in(m.lower, Cut(-side, side, BUMPER_TOP, 0.9), 2.0)
        self.panel("grille", "nose", grille, (4, 1), "plastic", thickness=3.0, lift=-14.0)
        for k in range(4):
            low = BUMPER_TOP + (0.9 - BUMPER_TOP) * (k + 0.32) / 4
            slat = drawn_in(m.lower, Cut(-side, side, low, low + 0.028), 0.5)
            self.panel(
                f"grille slat {k + 1}",
                "nose",
                slat,
                (3, 1),
                "chrome" if k == 3 else "plastic",
                thickness=10.0,
                lift=-3.0,
            )
        lip = drawn_in(m.lower, Cut(-side, side, 0.9, 1.0), 1.0)
        self.panel("bonnet lip", "nose", lip, (4, 1), "paint")
        plate = drawn_in(m.lower, Cut(-0.42 * side, 0.42 * side, 0.27, 0.43), 0.0)
        self.panel("front number plate", "nose", plate, (2, 1), "plate white", thickness=2.0, lift=6.0)

        def bonnet(u: Array, v: Array) -> Array:
            return m.bonnet(u, 2.0 * v - 1.0, (corner, cowl), 105.0)

        self.panel("bonnet", "nose", drawn_in(bonnet, Cut(0.0, 1.0)), (3, 4), "paint")
        foot = m.s_at(self.shape.screen_foot[3][0] + 20.0, glass=True, t=0.0)

        def scuttle(u: Array, v: Array) -> Array:
            rear = m.bonnet(np.array([1.0]), 2.0 * v - 1.0, (corner, cowl), 105.0)[0]
            screen = m.glass((2.0 * v - 1.0) * foot, np.array([0.02]))[:, 0]
            return np.asarray(rear + u[:, None, None] * (screen - rear) - (0.0, 0.0, 6.0))

        self.panel("scuttle", "nose", scuttle, (1, 4), "plastic", thickness=2.0)

    def _tail(self) -> None:
        m, car = self.masters, self.shape
        corner, side = m.s_at(car.length - TAIL_LENGTH), m.s_at(car.length - LAMP_INNER * 0.8)
        bumper = drawn_in(m.lower, Cut(corner, 2.0 - corner, 0.0, REAR_BUMPER_TOP))
        look = np.full((6, 3), self.roles["paint"])
        look[:, 0] = self.roles["plastic"]
        self.panel("rear bumper", "tail", bumper, (6, 3), look, thickness=3.0)
        lamp = drawn_in(m.lower, Cut(corner, side, REAR_BUMPER_TOP, 0.94))
        lens = np.array([[self.roles["red lens"], self.roles["amber lens"], self.roles["red lens"]]] * 2)
        self.panel("tail lamp", "lamps", lamp, (2, 3), lens, both=True, thickness=3.0)
        cap = drawn_in(m.lower, Cut(corner, side, 0.94, 1.0))
        self.panel("tail corner", "tail", cap, (2, 1), "paint", both=True)
        gate = drawn_in(m.lower, Cut(side, 2.0 - side, REAR_BUMPER_TOP, 1.0))
        self.panel("boot lid face" if car.boot else "tailgate", "tail", gate, (4, 3), "paint")
        plate = drawn_in(m.lower, Cut(1.0 - 0.4 * (1.0 - side), 1.0 + 0.4 * (1.0 - side), 0.6, 0.74), 0.0)
        self.panel("rear number plate", "tail", plate, (2, 1), "plate white", thickness=2.0, lift=5.0)
        if car.boot:
            deck = m.s_at(car.screen_foot[-4][0] + 60.0)

            def lid(u: Array, v: Array) -> Array:
                return m.boot(1.0 - u, 2.0 * v - 1.0, (corner, deck), 55.0)

            self.panel("boot lid", "tail", drawn_in(lid, Cut(0.0, 1.0)), (3, 4), "paint")

    def _greenhouse(self) -> None:
        m, car = self.masters, self.shape
        front, rear = m.pillars
        post = [m.s_at(x, glass=True, t=0.5) for x in car.doors[:-1]]
        last = rear - (0.055 if car.boot else 0.04)
        self.panel(
            "windscreen",
            "glass",
            drawn_in(m.glass, Cut(-front, front, 0.0, 1.0)),
            (4, 3),
            "glass",
            thickness=5.0,
            lift=-3.0,
        )
        self.panel("A pillar", "pillars", drawn_in(m.glass, Cut(front, front + 0.035), 1.0), (1, 3), "paint", both=True)
        for name, s0, s1 in (("front", front + 0.035, post[1] - 0.012), ("rear", post[1] + 0.012, last)):
            pane = drawn_in(m.glass, Cut(s0, s1, 0.03, 0.93), 3.0)
            self.panel(f"{name} side window", "glass", pane, (3, 2), "glass", both=True, thickness=4.0, lift=-4.0)
        self.panel(
            "B pillar",
            "pillars",
            drawn_in(m.glass, Cut(post[1] - 0.012, post[1] + 0.012, 0.03, 0.93), 0.5),
            (1, 2),
            "plastic",
            both=True,
        )
        self.panel("C pillar", "pillars", drawn_in(m.glass, Cut(last, rear + 0.012), 1.0), (1, 3), "paint", both=True)
        self.panel(
            "roof rail",
            "pillars",
            drawn_in(m.glass, Cut(front + 0.035, last, 0.93, 1.0), 0.5),
            (4, 1),
            "paint",
            both=True,
        )
        self.panel(
            "waist seal", "trim", drawn_in(m.glass, Cut(front + 0.035, last, 0.0, 0.03), 0.5), (4, 1), "seal", both=True
        )
        window = drawn_in(m.glass, Cut(rear + 0.012, 2.0 - rear - 0.012, 0.06, 1.0))
        self.panel("rear window", "glass", window, (4, 3), "glass", thickness=4.0, lift=-3.0)

        def roof(u: Array, v: Array) -> Array:
            return m.roof(u, 2.0 * v - 1.0)

        self.panel("roof", "roof", drawn_in(roof, Cut(0.0, 1.0), 1.0), (4, 4), "paint")
        start = m.s_at(car.screen_foot[3][0] - 25.0)
        end = m.s_at(car.screen_foot[-4][0] + 60.0) if car.boot else 1.0
        g0 = m.s_at(car.screen_foot[3][0] + 20.0, glass=True, t=0.0)
        g1 = m.s_at(car.screen_foot[-4][0] + 10.0, glass=True, t=0.0) if car.boot else 1.0

        def shelf(u: Array, v: Array) -> Array:
            body = m.lower(start + u * (end - start), np.array([1.0]))[:, 0]
            glass = m.glass(g0 + u * (g1 - g0), np.array([0.0]))[:, 0]
            return np.asarray(body[:, None] + v[:, None] * (glass - body)[:, None] + (0.0, 0.0, -2.0))

        self.panel("waist", "sides", shelf, (6, 1), "paint", both=True)


NOSE_END, LAMP_INNER, TAIL_LENGTH = 330.0, 62.0, 300.0
"""mm from the front: end of the bumper's and lamps' wrap, inner end of the lamps; from the rear: likewise."""
BUMPER_TOP, REAR_BUMPER_TOP, SILL_TOP = 0.56, 0.5, 0.12
"""Shares of the lower body's height."""
