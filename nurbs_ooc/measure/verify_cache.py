"""Attack every promise of a cache: tiles of nodes, surfaces' levels of detail, boxes and the order of errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import PartInfo
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.tile import decode_tile
from nurbs_ooc.measure.attack_tile import DrawnTile, PlacedSurfaces, TileFinding, attack_tile
from nurbs_ooc.measure.sampled_part import SampledParts
from nurbs_ooc.measure.violation import Violation

REGION_SHARE = 0.02  # of the smallest promise on a part: how straight its boundary segments are
COARSEST = 1.0  # mm, for parts that no tile shows
BOX_SLACK = 1e-9  # of a box's size and place: what rounding may leave outside
SHOWN = 10  # rows of the table of worst ratios

Rows = npt.NDArray[np.void]


class VerifiedStore(Protocol):
    """What the attack reads of a store."""

    def get_part(self, index: int) -> GeometryBatch:
        """Geometry of a part."""

    def part_infos(self) -> list[PartInfo]:
        """All parts' infos."""

    def get_occurrences(self) -> Rows:
        """Placed parts."""

    def get_nodes(self) -> Rows:
        """The tree."""

    def get_items(self) -> Rows:
        """The placed surfaces."""

    def get_tile(self, tile_hash: str) -> bytes:
        """Bytes of a tile."""

    def get_lods(self, surface_id: int) -> Rows:
        """Levels of detail of a surface."""

    def locate_surface(self, surface_id: int) -> tuple[int, int]:
        """Part and row of a surface."""


@dataclass(frozen=True)
class Measured:
    """One tile's outcome, mm."""

    where: str
    level: int
    surface_to_tile: float
    tile_to_surface: float
    certified: float

    @property
    def ratio(self) -> float:
        """Measured over certified."""
        return max(self.surface_to_tile, self.tile_to_surface) / self.certified if self.certified > 0 else 0.0


@dataclass(eq=False)
class CacheReport:
    """What an attack on a whole cache found.

    Attributes:
        nodes, lods: tiles attacked; unbuilt: nodes that have no tile yet.
        samples: distances measured.
        skipped_surfaces: placed surfaces that nobody can evaluate, over all tiles.
        undecided: drawn points that seemed too far without a proof.
        measured: every tile.
        violations: empty if every promise held.
    """

    nodes: int = 0
    lods: int = 0
    unbuilt: int = 0
    samples: int = 0
    skipped_surfaces: int = 0
    undecided: int = 0
    measured: list[Measured] = field(default_factory=list)
    violations: list[Violation] = field(default_factory=list)

    def worst(self, n: int = SHOWN) -> list[Measured]:
        """The tiles nearest to their promise, worst first."""
        return sorted(self.measured, key=lambda m: -m.ratio)[:n]

    def as_json(self) -> dict[str, Any]:
        """The report as plain numbers."""
        worst = self.worst()
        return {
            "nodes": self.nodes,
            "lods": self.lods,
            "nodes_without_tile": self.unbuilt,
            "samples": self.samples,
            "skipped_surfaces": self.skipped_surfaces,
            "undecided": self.undecided,
            "worst_measured_over_certified": worst[0].ratio if worst else 0.0,
            "worst": [
                {
                    "where": m.where,
                    "level": m.level,
                    "surface_to_tile_mm": m.surface_to_tile,
                    "tile_to_surface_mm": m.tile_to_surface,
                    "certified_mm": m.certified,
                    "ratio": m.ratio,
                }
                for m in worst
            ],
            "violations": [v.as_json() for v in self.violations],
        }


def verify_cache(
    store: VerifiedStore, samples: int = 64, seed: int = 0, advance: Callable[[int], None] | None = None
) -> CacheReport:
    """Attack all tiles of a store.

    Args:
        store: LMDB or in memory.
        samples: per placed surface and tile, before climbing.
        seed: the same seed finds the same.
        advance: called with 1 after every node and every surface; there are ``n_steps(store)``.
    """
    return _CacheAttack(store, samples, seed, advance or (lambda _: None)).run()


def n_steps(store: VerifiedStore) -> int:
    """How often ``verify_cache`` will call ``advance``."""
    return len(store.get_nodes()) + sum(info.n_surfaces for info in store.part_infos())


class _CacheAttack:
    def __init__(self, store: VerifiedStore, samples: int, seed: int, advance: Callable[[int], None]) -> None:
        self.store, self.seed, self.advance = store, seed, advance
        self.nodes, self.items, self.occurrences = store.get_nodes(), store.get_items(), store.get_occurrences()
        self.infos = store.part_infos()
        self.first_surface = np.array([info.first_surface for info in self.infos], np.int64)
        self.item_part = self.occurrences["part"][self.items["occurrence"]].astype(np.int64)
        self.item_row = self.items["surface"].astype(np.int64) - self.first_surface[self.item_part]
        self.parts = SampledParts(store, self._tolerances(), samples, seed)
        self.report = CacheReport()

    def run(self) -> CacheReport:
        for row in range(len(self.nodes)):
            self._node(row)
            self.advance(1)
        for part, info in enumerate(self.infos):
            for row in range(info.n_surfaces):
                self._lods(part, row, info.first_surface + row)
                self.advance(1)
        return self.report

    def _tolerances(self) -> npt.NDArray[np.float64]:
        """Per part, a share of the smallest error that any tile promises on it, in its own space."""
        smallest = np.full(len(self.infos), np.inf)
        for node in self.nodes[self.nodes["tile_hash"] != b""]:
            own = slice(node["first_item"], node["first_item"] + node["n_items"])
            scale = np.maximum(self.items["scale"][own], 1e-12)
            np.minimum.at(smallest, self.item_part[own], node["geometric_error"] / scale)
        for part, info in enumerate(self.infos):
            for row in range(info.n_surfaces):
                lods = self.store.get_lods(info.first_surface + row)
                smallest[part] = min(smallest[part], lods["geometric_error"].min(initial=np.inf))
        smallest = np.where(np.isfinite(smallest), smallest, COARSEST)
        tolerances: npt.NDArray[np.float64] = REGION_SHARE * np.maximum(smallest, 1e-9)
        return tolerances

    def _node(self, row: int) -> None:
        node = self.nodes[row]
        where = f"node {row} {bytes(node['key']).decode()}"
        error = float(node["geometric_error"])
        parent = int(node["parent"])
        if parent >= 0 and error > float(self.nodes["geometric_error"][parent]):
            over = float(self.nodes["geometric_error"][parent])
            self.report.violations.append(Violation(where, row, "below a child", error, over))
        if not node["tile_hash"]:
            self.report.unbuilt += 1
            return
        own = np.arange(node["first_item"], node["first_item"] + node["n_items"])
        transform = self.occurrences["transform"][self.items["occurrence"][own]]
        placed = PlacedSurfaces(self.item_part[own], self.item_row[own], transform)
        self._check_box(where, row, placed)
        self._tile(where, row, int(node["level"]), bytes(node["tile_hash"]).decode(), placed, error)
        self.report.nodes += 1

    def _lods(self, part: int, row: int, surface: int) -> None:
        for lod in self.store.get_lods(surface):
            identity = np.eye(3, 4)[None]
            placed = PlacedSurfaces(np.array([part]), np.array([row]), identity)
            where, name = f"surface {surface} level {lod['level']}", bytes(lod["tile_hash"]).decode()
            self._tile(where, surface, int(lod["level"]), name, placed, float(lod["geometric_error"]))
            self.report.lods += 1

    def _tile(self, where: str, row: int, level: int, name: str, placed: PlacedSurfaces, error: float) -> None:
        decoded = decode_tile(self.store.get_tile(name))
        if decoded.ledger.total > error:
            self.report.violations.append(Violation(where, row, "below its ledger", decoded.ledger.total, error))
        tile = DrawnTile(
            np.asarray(decoded.origin, float) + np.asarray(decoded.positions, float),
            np.asarray(decoded.triangles, np.int64).reshape(-1, 3),
            np.asarray(decoded.lines, np.int64).reshape(-1, 2),
            np.asarray(decoded.points, np.int64).ravel(),
        )
        self._count(attack_tile(self.parts, placed, tile, error, where, row, self.seed), where, level, error)

    def _count(self, found: TileFinding, where: str, level: int, error: float) -> None:
        report = self.report
        report.samples += found.n_samples
        report.skipped_surfaces += found.skipped_surfaces
        report.undecided += found.undecided
        report.violations.extend(found.violations)
        report.measured.append(Measured(where, level, found.surface_to_tile, found.tile_to_surface, error))

    def _check_box(self, where: str, row: int, placed: PlacedSurfaces) -> None:
        """Samples of the surfaces a node holds itself must lie in its box (the others are in its children's)."""
        node = self.nodes[row]
        low, high = node["aabb_min"], node["aabb_max"]
        slack = BOX_SLACK * float(np.maximum(np.abs(low), np.abs(high)).max())
        for i in range(min(len(placed), int(node["n_direct"]))):
            sampled = self.parts[int(placed.part[i])]
            face = sampled.face_of_row[placed.row[i]]
            own = (
                sampled.samples.points[sampled.first[face] : sampled.first[face + 1]] if face >= 0 else np.empty((0, 3))
            )
            p = own @ placed.transform[i][:, :3].T + placed.transform[i][:, 3]
            out = np.maximum(low - p, p - high).max(initial=0.0)
            if out > slack:
                self.report.violations.append(Violation(where, row, "out of its box", float(out), 0.0))
