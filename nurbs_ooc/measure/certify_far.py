"""Prove that a point is farther from a trimmed face than a limit.

Cells of the parameter box are discarded when their centre is farther than the limit plus the cell's
reach; and when their centre is outside the loops and the boundary, whose distance is known, cannot pass
through them. The others are quartered. If cells remain that are small beside the limit, nothing is proven
and the point gets the benefit of the doubt.

The reach is the cell's half size times the largest tangents met at nine points of it, times ``CAUTION``. So
that no cell hides a place where the surface races, the first ones end at the knots of spans that are shorter,
and where weights are far apart their ratio counts too.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, SurfaceKind
from nurbs_ooc.measure.trim_region import TrimRegion

Floats = npt.NDArray[np.float64]

CAUTION = 1.5
FAR_APART = 16.0  # weights
FIRST_CELLS = 24  # per direction, before anything is discarded
SMALL = 1e-3  # of the limit: a cell of this reach that remains settles it
MAX_CELLS = 100_000


class FarProof:
    """Proofs for points and the faces of a region; a face's first cells are measured when they are first needed.

    Args:
        region: has the faces.
    """

    def __init__(self, region: TrimRegion) -> None:
        self._region = region
        self._first: dict[int, tuple[Floats, Floats, Floats, Floats]] = {}

    def nowhere_near(self, face: int, p: Floats, limit: float, to_boundary: float) -> bool:
        """True if no point of a face is within ``limit`` of a point; False if that is not proven.

        Args:
            face: its index in the region.
            p: (3,) mm.
            limit: mm.
            to_boundary: mm; distance of ``p`` to the face's boundary curves.
        """
        region = self._region
        caution = CAUTION * _weight_ratio(region, face)
        if face not in self._first:
            centre, half = _first_cells(region, face)
            self._first[face] = (centre, half, *_middle_and_reach(region, face, centre, half))
        centre, half, middle, reach = self._first[face]
        while len(centre):
            distance, reach = np.linalg.norm(middle - p, axis=1), reach * caution
            live = np.flatnonzero(distance - reach <= limit)
            cut_off = (distance + reach < to_boundary)[live] & ~region.contains(face, centre[live])
            live = live[~cut_off]
            centre, half, reach = centre[live], half[live], reach[live]
            if (reach <= SMALL * limit).any() or len(centre) > MAX_CELLS:
                return False
            half = half / 2
            centre = np.concatenate([centre + np.array([i, j]) * half for i in (-1, 1) for j in (-1, 1)])
            half = np.tile(half, (4, 1))
            middle, reach = _middle_and_reach(region, face, centre, half)
        return True


def _middle_and_reach(region: TrimRegion, face: int, centre: Floats, half: Floats) -> tuple[Floats, Floats]:
    """(n, 3) the points in the middle of cells, and (n,) how far others may be from there, by nine tangents, mm."""
    speed = np.zeros((len(centre), 2))
    middle = np.zeros((len(centre), 3))
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            d = region.placed.derivatives(face, centre + np.array([i, j]) * half)
            speed = np.maximum(speed, np.linalg.norm(d[:, 1:], axis=2))
            if i == 0 and j == 0:
                middle = d[:, 0]
    return middle, (speed * half).sum(axis=1)


def _knots(region: TrimRegion, face: int) -> list[Floats]:
    """Knots of a face's surface in u and in v, of its profile if it sweeps one."""
    g = region.placed.geometry
    s = g.surfaces[region.placed.rows[face]]
    none = np.zeros(0)
    if s["kind"] == SurfaceKind.NURBS:
        first, count = (s["knots_u"], s["knots_v"]), (s["n_u"] + s["degree_u"] + 1, s["n_v"] + s["degree_v"] + 1)
        return [g.values[first[k] : first[k] + count[k]] for k in range(2)]
    if s["profile"] < 0 or g.curves[s["profile"]]["kind"] != CurveKind.NURBS:
        return [none, none]
    c = g.curves[s["profile"]]
    knots = g.values[c["knots"] : c["knots"] + c["n"] + c["degree"] + 1]
    return [knots, none] if s["kind"] == SurfaceKind.EXTRUSION else [none, knots]


def _first_cells(region: TrimRegion, face: int) -> tuple[Floats, Floats]:
    """(n, 2) centres and half sizes of cells that cover a face's parameter box."""
    centres, halves = [], []
    for k, knots in enumerate(_knots(region, face)):
        low, high = region.bounds[face, k], region.bounds[face, 2 + k]
        even = np.linspace(low, high, FIRST_CELLS + 1)
        inner = np.unique(np.concatenate([[low, high], knots[(knots > low) & (knots < high)]]))
        short = np.diff(inner) < 0.5 * (high - low) / FIRST_CELLS
        ends = np.unique(np.concatenate([even, inner[:-1][short], inner[1:][short]]))
        centres.append(0.5 * (ends[1:] + ends[:-1]))
        halves.append(0.5 * np.diff(ends))
    pairs = [np.stack(np.meshgrid(*x, indexing="ij"), -1).reshape(-1, 2) for x in (centres, halves)]
    return pairs[0], pairs[1]


def _weight_ratio(region: TrimRegion, face: int) -> float:
    """Largest over smallest weight of a face's surface if that is more than conics have, else 1."""
    g = region.placed.geometry
    s = g.surfaces[region.placed.rows[face]]
    if s["kind"] != SurfaceKind.NURBS or not s["rational"]:
        return 1.0
    weights = g.values[s["points"] + 3 : s["points"] + 4 * s["n_u"] * s["n_v"] : 4]
    ratio = float(weights.max() / weights.min())
    return ratio if ratio > FAR_APART else 1.0
