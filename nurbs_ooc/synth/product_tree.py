"""The product tree and the occurrences of a model, grown as its parts are placed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Product
from nurbs_ooc.synth.part_draft import STAY, chained

Array = npt.NDArray[np.float64]


class ProductTree:
    """Root, cars, groups of parts, placed parts.

    Args:
        name: of the root.
        cars: names and places (3, 4) of the cars under it; an only car at its own place is the root itself.
    """

    def __init__(self, name: str, cars: list[tuple[str, Array]]) -> None:
        self.products = [Product(name, -1, _numbers(STAY))]
        self._groups: dict[tuple[int, tuple[str, ...]], int] = {}
        self._rows: list[tuple[int, int, Array]] = []
        self.cars = [place for _, place in cars]
        for k, (car, place) in enumerate(cars):
            if len(cars) > 1:
                self.products.append(Product(car, 0, _numbers(place)))
                self._groups[k, ()] = len(self.products) - 1
            else:
                self._groups[k, ()] = 0

    def place(
        self, part: int, name: str, car: int, group: tuple[str, ...], place: Array, *, baked: bool = False
    ) -> Array:
        """Add one placement; returns where it is in the assembly. ``baked``: the part lies there already."""
        whole = chained(self.cars[car], place)
        parent = self._group(car, group)
        self.products.append(Product(name, parent, _numbers(_inverse(self.cars[car]) if baked else place)))
        self._rows.append((part, len(self.products) - 1, STAY if baked else whole))
        return whole

    def _group(self, car: int, group: tuple[str, ...]) -> int:
        if (car, group) not in self._groups:
            parent = self._group(car, group[:-1])
            self.products.append(Product(group[-1], parent, _numbers(STAY)))
            self._groups[car, group] = len(self.products) - 1
        return self._groups[car, group]

    def occurrences(self) -> npt.NDArray[np.void]:
        """``OCCURRENCE_DTYPE`` of all placements."""
        table = np.zeros(len(self._rows), OCCURRENCE_DTYPE)
        for row, (part, product, place) in zip(table, self._rows, strict=True):
            row["part"], row["product"], row["material"], row["transform"] = part, product, -1, place
        return table


def _numbers(place: Array) -> tuple[float, ...]:
    return tuple(place.reshape(-1).tolist())


def _inverse(place: Array) -> Array:
    """Of a rigid placement."""
    back = place[:, :3].T
    return np.concatenate([back, -(back @ place[:, 3:])], axis=1)
