"""What a model's parts add up to, as placed, and what is still missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nurbs_cache.surface_record import GeometryBatch


@dataclass
class Tally:
    """Counts of placed trimmed surfaces.

    Attributes:
        surfaces, control_points: as often as they are placed.
        rational: surfaces with weights.
        holed: surfaces with more than one loop.
    """

    surfaces: int = 0
    control_points: int = 0
    rational: int = 0
    holed: int = 0

    @classmethod
    def of(cls, geometry: GeometryBatch) -> Tally:
        """Of a part placed once."""
        s = geometry.surfaces
        points = int((s["n_u"].astype(np.int64) * s["n_v"]).sum())
        return cls(len(s), points, int(s["rational"].sum()), int((s["n_loops"] > 1).sum()))

    def times(self, n: int) -> Tally:
        """Of ``n`` placements."""
        return Tally(n * self.surfaces, n * self.control_points, n * self.rational, n * self.holed)

    def plus(self, other: Tally) -> Tally:
        """Of both."""
        return Tally(
            self.surfaces + other.surfaces,
            self.control_points + other.control_points,
            self.rational + other.rational,
            self.holed + other.holed,
        )


def total(tallies: Iterable[Tally]) -> Tally:
    """Of all."""
    result = Tally()
    for tally in tallies:
        result = result.plus(tally)
    return result
