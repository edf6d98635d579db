"""One attack on a tile, prepared: what it draws, the surfaces it stands for, and which of them can be evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.measure.drawn_tile import DrawnTile
from nurbs_ooc.measure.gathered import gathered
from nurbs_ooc.measure.near_boxes import NearBoxes
from nurbs_ooc.measure.part_source import PartSource
from nurbs_ooc.measure.trim_region import TrimRegion
from nurbs_ooc.measure.violation import Violation

UNUSABLE = [int(r) for r in (FaceReason.NOT_FINITE, FaceReason.BAD_WEIGHTS, FaceReason.BAD_KNOTS)]
STRAIGHT = 0.02  # of a promise: boundary pieces straight within it are not cut finer
FINEST = 1e-9  # of the largest coordinate: no boundary piece is cut finer
ROUNDING = 64 * np.finfo(float).eps  # of the largest coordinate: what float64 itself may add

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PlacedSurfaces:
    """The surfaces a tile stands for.

    Attributes:
        part, row: (n,) the part and the row in it.
        occurrence: (n,) the placement of each, a row of
        transforms: (m, 3, 4) into the tile's space.
        boxes: (n, 6) low and high corner there, mm; where a surface is sought.
    """

    part: Indices
    row: Indices
    occurrence: Indices
    transforms: Floats
    boxes: Floats

    def __len__(self) -> int:
        return len(self.part)


@dataclass(frozen=True)
class Effort:
    """How much of a tile one attack takes on.

    Attributes:
        surfaces: (k,) the surfaces to sample.
        per_surface: samples of each.
        share: which one of how many equal shares of the triangles, lines and points to measure back.
        drawn: points of it.
        seed: of both.
    """

    surfaces: Indices
    per_surface: int
    share: tuple[int, int]
    drawn: int
    seed: tuple[int, ...]


@dataclass(eq=False)
class TileFinding:
    """What the attack on one tile measured (mm) and what it broke; ``limit`` is the promise with rounding."""

    limit: float = 0.0
    n_samples: int = 0
    surface_to_tile: float = 0.0
    tile_to_surface: float = 0.0
    undecided: int = 0
    skipped_surfaces: int = 0
    violations: list[Violation] = field(default_factory=list)


class TileTask:
    """What both directions need.

    Args:
        parts: the store's parts.
        items: every surface the tile stands for.
        tile: what it draws.
        promised: mm; the error it promises.
        where: names the tile in violations.
        row: likewise.

    Attributes:
        limit: the promise with what rounding may add.
        finding: filled by the directions.
        near: finds items by their boxes.
        region: the surfaces chosen by ``prepare``; ``item_of[f]`` is face f's item, ``face_of`` leads back, -1 for
            items that were not chosen or cannot be evaluated (``unusable``).
    """

    region: TrimRegion

    def __init__(
        self, parts: PartSource, items: PlacedSurfaces, tile: DrawnTile, promised: float, where: str, row: int
    ) -> None:
        self.parts, self.items, self.tile, self.promised = parts, items, tile, promised
        self.where, self.row = where, row
        self.finding = TileFinding()
        self.near = NearBoxes(items.boxes)
        self.size = float(np.abs(tile.positions).max(initial=0.0))
        self.limit = self.finding.limit = promised + ROUNDING * self.size
        self.item_of = np.zeros(0, np.int64)
        self.face_of = np.full(len(items), -1)
        self.unusable = np.zeros(len(items), np.bool_)

    def prepare(self, wanted: Indices) -> None:
        """Make the region of those of the ``wanted`` items (ascending) that can be evaluated."""
        items = self.items
        parts = {int(part): self.parts[int(part)] for part in np.unique(items.part[wanted])}
        reason = np.zeros(len(wanted), np.int64)
        for part, geometry in parts.items():
            own = items.part[wanted] == part
            reason[own] = geometry.surfaces["reason"][items.row[wanted[own]]]
        self.unusable[wanted] = np.isin(reason, UNUSABLE)
        self.item_of = wanted[~self.unusable[wanted]]
        self.face_of[self.item_of] = np.arange(len(self.item_of))
        geometry = gathered(parts, items.part[self.item_of], items.row[self.item_of])
        tolerance = max(STRAIGHT * self.promised, FINEST * self.size)
        transforms = items.transforms[items.occurrence[self.item_of]]
        self.region = TrimRegion(geometry, np.arange(len(self.item_of)), tolerance, transforms)

    def broken(
        self,
        kind: str,
        value: float,
        p: Floats | None = None,
        face: int = -1,
        uv: Floats | None = None,
        limit: float | None = None,
    ) -> None:
        """Record a violation, at a point and on a face where there are such."""
        where, at, place = self.where, None, None
        if face >= 0 and uv is not None:
            item = self.item_of[face]
            part, row = int(self.items.part[item]), int(self.items.row[item])
            where = f"{where}, part {part} face {row} {self.parts.name(part, row)}".rstrip()
            at = (float(uv[0]), float(uv[1]))
        if p is not None:
            place = (float(p[0]), float(p[1]), float(p[2]))
        promised = self.promised if limit is None else limit
        self.finding.violations.append(Violation(where, self.row, kind, value, promised, at, place))
