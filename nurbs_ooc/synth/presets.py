"""The models that there are, with the counts of the paper's.

Source: M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", table 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_ooc.synth.car_shape import C_CLASS, GOLF, CarShape
from nurbs_ooc.synth.materials import Colour
from nurbs_ooc.synth.model import ModelSize
from nurbs_ooc.synth.part_draft import STAY, turn

Array = npt.NDArray[np.float64]

SMALLEST, LARGEST = 200, 2_000_000
"""Surfaces of one car that ``scaled`` takes."""


@dataclass(frozen=True)
class Preset:
    """One model.

    Attributes:
        name: on the command line.
        shape, size: of each car.
        materials: how many there are.
        paint: linear colour of the body.
        cars: how often the car is placed.
    """

    name: str
    shape: CarShape
    size: ModelSize
    materials: int
    paint: Colour
    cars: int = 1

    def scaled(self, surfaces: int) -> Preset:
        """The same model with another number of surfaces and control points in proportion.

        Raises:
            UsageError: too few or too many, or not a multiple of the cars.
        """
        each, rest = divmod(surfaces, self.cars)
        if rest or not SMALLEST <= each <= LARGEST:
            of = f"a multiple of {self.cars}, " if self.cars > 1 else ""
            low, high = SMALLEST * self.cars, LARGEST * self.cars
            raise UsageError(f"--surfaces {surfaces}: {self.name} takes {of}{low} to {high}")
        points = round(each * self.size.control_points / self.size.surfaces)
        return replace(self, size=replace(self.size, surfaces=each, control_points=points))

    def places(self) -> list[tuple[str, Array]]:
        """Names and places of the cars: two rows, nose to nose."""
        if self.cars == 1:
            return [(self.name, STAY)]
        per_row = self.cars // 2
        return [
            (f"car {k + 1}", turn(2, np.pi * (k // per_row), *_bay(k % per_row, k // per_row, self.shape.length)))
            for k in range(self.cars)
        ]


def _bay(column: int, row: int, length: float) -> tuple[float, float, float]:
    """Where the nose of a parked car is: bays of 2.6 m, noses 1.4 m apart."""
    return -1400.0 * row, 2600.0 * column, 0.0 * length


PRESETS = {
    "golf": Preset("golf", GOLF, ModelSize(8_036, 324_358, 1, (16, 24), (0.07, 0.03)), 9, (0.02, 0.07, 0.26)),
    "c-class": Preset(
        "c-class", C_CLASS, ModelSize(67_571, 5_555_006, 2, (64, 160), (0.22, 0.14)), 24, (0.30, 0.31, 0.33)
    ),
    "parking-lot": Preset(
        "parking-lot", C_CLASS, ModelSize(67_571, 5_555_006, 2, (64, 160), (0.22, 0.14)), 24, (0.30, 0.31, 0.33), 16
    ),
}
