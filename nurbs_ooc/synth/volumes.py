"""Where small parts go: boxes inside the car in which nothing shows through the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.car_shape import CarShape

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Volume:
    """A box, mm.

    Attributes:
        name: what is there; the product that its parts belong to.
        low, high: its corners.
        share: of the parts.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    share: float

    @property
    def size(self) -> Array:
        """(3,) mm."""
        return np.array(self.high) - np.array(self.low)


def volumes(shape: CarShape) -> list[Volume]:
    """The boxes of a car."""
    front, rear = shape.wheelbase
    first, last, end = shape.doors[0], shape.doors[-1], shape.length
    return [
        Volume("engine bay", (260.0, -480.0, 300.0), (first - 180.0, 480.0, 700.0), 0.30),
        Volume("front structure", (front + 400.0, -650.0, 230.0), (first + 60.0, 650.0, 760.0), 0.06),
        Volume("dashboard", (first - 60.0, -620.0, 560.0), (first + 240.0, 620.0, 900.0), 0.14),
        Volume("cabin floor", (first + 100.0, -680.0, 215.0), (last, 680.0, 420.0), 0.18),
        Volume("left doors", (first + 60.0, 700.0, 300.0), (last - 60.0, 790.0, 820.0), 0.08),
        Volume("right doors", (first + 60.0, -790.0, 300.0), (last - 60.0, -700.0, 820.0), 0.08),
        Volume("rear structure", (rear - 360.0, -540.0, 260.0), (rear + 200.0, 540.0, 620.0), 0.08),
        Volume("boot", (rear - 100.0, -540.0, 300.0), (end - 260.0, 540.0, 820.0), 0.08),
    ]


def pick(boxes: list[Volume], rng: np.random.Generator) -> Volume:
    """One of them, by share."""
    shares = np.array([box.share for box in boxes])
    return boxes[int(rng.choice(len(boxes), p=shares / shares.sum()))]


def upright(rng: np.random.Generator) -> Array:
    """(3, 3) one of the 24 rotations that keep the axes."""
    order = rng.permutation(3)
    signs = rng.choice([-1.0, 1.0], 3)
    turned = np.zeros((3, 3))
    turned[np.arange(3), order] = signs
    if np.linalg.det(turned) < 0.0:
        turned[:, 0] *= -1.0
    return turned
