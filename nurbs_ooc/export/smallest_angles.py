"""How slender triangles are: the smallest angle of each, counted in bins so that memory does not follow the mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

LARGEST = 60.0  # degrees: no triangle's smallest angle is larger
BINS = 1200
CHUNK = 1 << 18  # triangles at a time


def smallest_angles(positions: npt.NDArray[np.float64], triangles: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """(n,) degrees: the smallest angle of each triangle, 0 where two of its corners are one point.

    Args:
        positions: (m, 3) of any unit.
        triangles: (n, 3) rows of ``positions``.
    """
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    sides = np.sort([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    # It lies opposite the shortest side: the law of cosines, over the area for small angles' sake.
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    angle = np.degrees(np.arctan2(twice_area, 0.5 * (sides[1] + sides[2] - sides[0])))
    return np.where(sides[0] > 0.0, angle, 0.0)


class AngleCount:
    """Smallest angles of all triangles of a file."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)
        self._least = np.inf

    def add(self, positions: npt.NDArray[np.float64], triangles: npt.NDArray[np.int64]) -> None:
        """Count some triangles, see ``smallest_angles``."""
        for first in range(0, len(triangles), CHUNK):
            angles = smallest_angles(positions, triangles[first : first + CHUNK])
            self._least = min(self._least, float(angles.min()))
            places = np.minimum((angles * (BINS / LARGEST)).astype(np.int64), BINS - 1)
            self._counts += np.bincount(places, minlength=BINS)

    def as_json(self) -> dict[str, float] | None:
        """``min``, ``p1`` (a hundredth of all are smaller) and ``median``, degrees; None of no triangles.

        The last two are off by one bin at most: a twentieth of a degree.
        """
        total = int(self._counts.sum())
        if total == 0:
            return None
        below = np.cumsum(self._counts)
        p1, median = ((int(np.searchsorted(below, share * total)) + 0.5) * LARGEST / BINS for share in (0.01, 0.5))
        return {"min": self._least, "p1": p1, "median": median}
