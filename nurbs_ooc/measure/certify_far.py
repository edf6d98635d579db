"""Prove that a point is farther from a trimmed face than a limit.

Cells of the parameter box are discarded when their centre is farther than the limit plus the cell's
reach; and when their centre is outside the loops and the boundary, whose distance is known, cannot pass
through them. The others are quartered. If cells remain that are small beside the limit, nothing is proven
and the point gets the benefit of the doubt.

The reach is the cell's half size times the largest tangents met at nine points of it, times ``CAUTION``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.trim_region import TrimRegion

CAUTION = 1.5
FIRST_CELLS = 24  # per direction, before anything is discarded
SMALL = 1e-3  # of the limit: a cell of this reach that remains settles it
MAX_CELLS = 100_000


def nowhere_near(region: TrimRegion, face: int, p: npt.NDArray[np.float64], limit: float, to_boundary: float) -> bool:
    """True if no point of a face is within ``limit`` of a point; False if that is not proven.

    Args:
        region: has the face.
        face: its index in there.
        p: (3,) mm.
        limit: mm.
        to_boundary: mm; distance of ``p`` to the face's boundary curves.
    """
    low, high = region.bounds[face, :2], region.bounds[face, 2:]
    half = (high - low) / (2 * FIRST_CELLS)
    steps = (2 * np.arange(FIRST_CELLS) + 1)[:, None] * half + low
    centre = np.stack(np.meshgrid(steps[:, 0], steps[:, 1], indexing="ij"), -1).reshape(-1, 2)
    while len(centre):
        distance, reach = _distance_and_reach(region, face, p, centre, half)
        live = np.flatnonzero(distance - reach <= limit)
        cut_off = (distance + reach < to_boundary)[live] & ~region.contains(face, centre[live])
        live = live[~cut_off]
        centre, reach = centre[live], reach[live]
        if (reach <= SMALL * limit).any() or len(centre) > MAX_CELLS:
            return False
        half = half / 2
        centre = np.concatenate([centre + np.array([i, j]) * half for i in (-1, 1) for j in (-1, 1)])
    return True


def _distance_and_reach(
    region: TrimRegion,
    face: int,
    p: npt.NDArray[np.float64],
    centre: npt.NDArray[np.float64],
    half: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    speed = np.zeros((len(centre), 2))
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            d = region.placed.derivatives(face, centre + np.array([i, j]) * half)
            speed = np.maximum(speed, np.linalg.norm(d[:, 1:], axis=2))
            if i == 0 and j == 0:
                distance = np.linalg.norm(d[:, 0] - p, axis=1)
    return distance, CAUTION * speed @ half
