"""Prove that a point is farther from a trimmed face than a limit.

Cells of the parameter box are discarded when their centre is farther than the limit plus the cell's
reach, else quartered; a cell that has become small beside the limit is discarded only if it lies wholly
outside the trimming loops. If cells remain, nothing is proven and the point gets the benefit of the doubt.

The reach is the cell's half size times the largest tangents met at nine points of it, times ``CAUTION``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.exact_surface import derivatives
from nurbs_ooc.measure.trim_region import TrimRegion

CAUTION = 1.5
FIRST_CELLS = 24  # per direction, before anything is discarded
SMALL = 0.02  # of the limit: cells of this reach are not quartered any more
MAX_CELLS = 100_000


def nowhere_near(region: TrimRegion, face: int, p: npt.NDArray[np.float64], limit: float) -> bool:
    """True if no point of the face (index in ``region``) is within ``limit`` mm of ``p``; False if not proven."""
    low, high = region.bounds[face, :2], region.bounds[face, 2:]
    half = (high - low) / (2 * FIRST_CELLS)
    steps = (2 * np.arange(FIRST_CELLS) + 1)[:, None] * half + low
    centre = np.stack(np.meshgrid(steps[:, 0], steps[:, 1], indexing="ij"), -1).reshape(-1, 2)
    while len(centre):
        distance, reach = _distance_and_reach(region, face, p, centre, half)
        live = distance - reach <= limit
        centre, reach = centre[live], reach[live]
        if not len(centre):
            return True
        small = reach <= SMALL * limit
        if _touches_face(region, face, centre[small], half):
            return False
        centre = centre[~small]
        if len(centre) > MAX_CELLS:
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
            d = derivatives(region.geometry, region.faces[face], centre + np.array([i, j]) * half)
            speed = np.maximum(speed, np.linalg.norm(d[:, 1:], axis=2))
            if i == 0 and j == 0:
                distance = np.linalg.norm(d[:, 0] - p, axis=1)
    return distance, CAUTION * speed @ half


def _touches_face(
    region: TrimRegion, face: int, centre: npt.NDArray[np.float64], half: npt.NDArray[np.float64]
) -> bool:
    """Does any of the cells hold a point of the face: its centre, or a piece of a loop's box?"""
    if not len(centre):
        return False
    if region.contains(face, centre).any():
        return True
    own = region.segments[region.start[face] : region.start[face + 1]]
    low = np.minimum(own["uv0"], own["uv1"])
    high = np.maximum(own["uv0"], own["uv1"])
    return any(((low <= c + half) & (high >= c - half)).all(1).any() for c in centre)
