"""A car as its parts, with exact totals: structure first, then hardware, then pressings for the rest.

::

    target = structure + fasteners + brackets + pressings + labels
             `-- made at once --'  `-- made --'  `- planned -'  `- the last few surfaces and points

Totals count placed surfaces, as the papers do: a bolt that is placed forty times counts forty times.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nurbs_cache.errors import UsageError
from nurbs_ooc.synth.car_shape import CarShape
from nurbs_ooc.synth.exterior import Exterior
from nurbs_ooc.synth.hardware import brackets, fasteners
from nurbs_ooc.synth.interior import cabin, drive, fittings
from nurbs_ooc.synth.part_draft import PartDraft, shift
from nurbs_ooc.synth.pressings import Pressing, fitting_scale, labels, make_pressing, plan_pressing
from nurbs_ooc.synth.tally import Tally, total
from nurbs_ooc.synth.volumes import volumes
from nurbs_ooc.synth.wheels import wheels

STRUCTURE_SHARES = 0.55, 0.45
"""At most this much of the surfaces and of the control points is structure; only small models feel it."""
LABELS, LABEL_POINTS = 24, 48
"""Single plates that make the totals exact, and the control points kept for each."""
PRESSING_ROLES = ("steel", "plastic", "underbody", "cast aluminium", "zinc", "fabric", "engine black", "carpet")


@dataclass(frozen=True)
class ModelSize:
    """What a model is to add up to.

    Attributes:
        surfaces, control_points: placed.
        fineness: patches along a panel's side, relative to the small car's.
        shapes: different fasteners, different brackets.
        shares: of all surfaces, those of fasteners and brackets; few of them have holes, so a third with
            holes leaves them no more.
    """

    surfaces: int
    control_points: int
    fineness: int
    shapes: tuple[int, int]
    shares: tuple[float, float]


class CarModel:
    """Plans a car and gives out its parts.

    Args:
        shape: which car.
        size: its totals.
        roles: material rows by role.
        seed: equal seeds give equal bytes.
    """

    def __init__(self, shape: CarShape, size: ModelSize, roles: dict[str, int], seed: int) -> None:
        self._shape, self._roles = shape, roles
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)]
        self._boxes = volumes(shape)
        self._made = _fitting(self._structure(size, streams[0]), size)
        n, shapes = size.surfaces, size.shapes
        self._made += fasteners(int(size.shares[0] * n), shapes[0], self._boxes, roles, streams[1])
        self._made += brackets(int(size.shares[1] * n), shapes[1], self._boxes, roles, streams[2])
        self.made = total(Tally.of(d.builder.build()).times(len(d.places)) for d in self._made)
        self._pressings, self._scale = self._plan(size, streams[3])
        used = sum(p.n_surfaces for p in self._pressings)
        points = sum(p.n_points(self._scale) for p in self._pressings)
        self._left = (n - self.made.surfaces - used, size.control_points - self.made.control_points - points)
        if self._left[1] < 16 * self._left[0] + 16:
            raise UsageError(f"{n} surfaces with {size.control_points} control points: too few points for a car")

    def _structure(self, size: ModelSize, rng: np.random.Generator) -> list[PartDraft]:
        shape, roles, fineness = self._shape, self._roles, size.fineness
        parts = Exterior(shape, roles, fineness, rng).make()
        parts += wheels(shape, roles, 7 if fineness == 1 else 5)
        parts += fittings(shape, roles, rng, fineness)
        parts += cabin(shape, roles, rng, fineness)
        return parts + drive(shape, roles, rng, fineness)

    def _plan(self, size: ModelSize, rng: np.random.Generator) -> tuple[list[Pressing], float]:
        """Pressings for all surfaces but the labels' and for all points but those kept for them."""
        left = size.surfaces - self.made.surfaces - LABELS
        holed = max(size.surfaces / 3 - self.made.holed, 0.0)
        rational = max(size.surfaces / 3 - self.made.rational, 0.0)
        plans: list[Pressing] = []
        while left > 0:
            # Steer by what is missing: some 70 % of these surfaces can have holes and weights.
            open_ = 0.7 * left
            plan = plan_pressing(left, min(0.98, holed / open_), min(0.9, rational / open_), rng)
            sides = 2 if plan.closed else 1
            left -= plan.n_surfaces
            holed = max(holed - sides * int(plan.holes.sum()), 0.0)
            rational = max(rational - sides * int(plan.rational.sum()), 0.0)
            plans.append(plan)
        return plans, fitting_scale(plans, size.control_points - self.made.control_points - LABELS * LABEL_POINTS)

    def parts(self) -> Iterator[PartDraft]:
        """All parts; pressings are made as they are asked for."""
        yield from self._made
        for k, plan in enumerate(self._pressings):
            role = PRESSING_ROLES[k % len(PRESSING_ROLES)]
            builder, place, box = make_pressing(plan, self._scale, self._boxes, self._roles[role])
            yield PartDraft(f"{'shell' if plan.closed else 'sheet'} {k + 1}", ("fill", box.name), builder, [place])
        low = self._boxes[0].low
        for k, builder in enumerate(labels(*self._left, self._roles["plate white"])):
            place = shift(low[0] + 70.0 * (k % 6), low[1] + 50.0 * (k // 6), low[2] + 20.0)
            yield PartDraft(f"label {k + 1}", ("fill", "labels"), builder, [place])


def _fitting(parts: list[PartDraft], size: ModelSize) -> list[PartDraft]:
    """The parts, in order, that fit into the structure's share of a model: all but in small ones."""
    surfaces, points = (
        share * n for share, n in zip(STRUCTURE_SHARES, (size.surfaces, size.control_points), strict=True)
    )
    kept = []
    for part in parts:
        n, m = part.builder.n_surfaces * len(part.places), part.builder.n_control_points * len(part.places)
        if n <= surfaces and m <= points:
            kept.append(part)
            surfaces, points = surfaces - n, points - m
    return kept
