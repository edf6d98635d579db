"""Attack every promise of a cache: tiles of nodes, surfaces' levels of detail, boxes and the order of errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError, MissingRecordError
from nurbs_cache.keys import parse_surface_key
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.tile import decode_tile, tile_counts, tile_hash, tile_ledger
from nurbs_ooc.measure.attack_plan import DEFAULT_SAMPLES, TileSize, efforts
from nurbs_ooc.measure.attack_tile import attack_tile
from nurbs_ooc.measure.check_tree import check_tree, node_name
from nurbs_ooc.measure.drawn_tile import DrawnTile, RecentTiles
from nurbs_ooc.measure.part_source import PartSource
from nurbs_ooc.measure.tile_task import Effort, PlacedSurfaces, TileFinding, TileTask
from nurbs_ooc.measure.violation import Violation

SHOWN = 10  # rows of the table of worst ratios
PER_TILE = ("lost", "damaged", "below its ledger")  # what every job of a tile finds

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

    def scan_keys(self, table: str) -> Iterator[bytes]:
        """Keys of a table."""

    def get_lods(self, surface_id: int) -> Rows:
        """Levels of detail of a surface."""

    def locate_surface(self, surface_id: int) -> tuple[int, int]:
        """Part and row of a surface."""


@dataclass(frozen=True)
class _Tile:
    """One stored tile and what it promises."""

    where: str
    row: int  # of the node, or the surface's id
    level: int
    name: str  # its hash
    error: float  # mm
    size: TileSize
    items: slice | None  # of the node, None for a level of detail


@dataclass
class Measured:
    """One tile's outcome, mm; ``limit`` is what is certified and what float64 may add."""

    where: str
    level: int
    certified: float
    limit: float = 0.0
    surface_to_tile: float = 0.0
    tile_to_surface: float = 0.0

    @property
    def ratio(self) -> float:
        """Measured over certified, rounding granted."""
        return max(self.surface_to_tile, self.tile_to_surface) / self.limit if self.limit > 0 else 0.0

    def as_json(self) -> dict[str, Any]:
        """The numbers as a report has them."""
        return {
            "where": self.where,
            "level": self.level,
            "surface_to_tile_mm": self.surface_to_tile,
            "tile_to_surface_mm": self.tile_to_surface,
            "certified_mm": self.certified,
            "ratio": self.ratio,
        }


@dataclass(eq=False)
class CacheReport:
    """What an attack on a whole cache found.

    Attributes:
        nodes, lods: tiles attacked; unbuilt: nodes that have no tile yet.
        samples: distances measured.
        sampled_surfaces: pairs of a tile and a surface that were sampled; placed_surfaces: how many there are.
        skipped_surfaces: pairs whose surface nobody can evaluate.
        undecided: drawn points that seemed too far without a proof.
        measured: every tile.
        violations: empty if every promise held.
    """

    nodes: int = 0
    lods: int = 0
    unbuilt: int = 0
    samples: int = 0
    sampled_surfaces: int = 0
    placed_surfaces: int = 0
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
            "sampled_surfaces": self.sampled_surfaces,
            "placed_surfaces": self.placed_surfaces,
            "skipped_surfaces": self.skipped_surfaces,
            "undecided": self.undecided,
            "worst_measured_over_certified": worst[0].ratio if worst else 0.0,
            "worst": [m.as_json() for m in worst],
            "violations": [v.as_json() for v in self.violations],
        }


class CacheAttack:
    """An attack that is planned when this is made and carried out by ``run``.

    Args:
        store: LMDB or in memory.
        samples: points measured before climbing, over all tiles; see ``attack_plan``.
        seed: the same seed finds the same, whatever the number of workers.
        workers: threads.
    """

    def __init__(self, store: VerifiedStore, samples: int = DEFAULT_SAMPLES, seed: int = 0, workers: int = 1) -> None:
        self._store, self._workers = store, workers
        self._nodes, self._items, self._occurrences = store.get_nodes(), store.get_items(), store.get_occurrences()
        self._infos = store.part_infos()
        self._first_surface = np.array([info.first_surface for info in self._infos], np.int64)
        self._parts = PartSource(store)
        self._recent = RecentTiles(self._drawn, workers + 1)
        self._tiles = [*self._node_tiles(), *self._lod_tiles()]
        self._efforts = efforts([tile.size for tile in self._tiles], samples, seed)

    @property
    def n_jobs(self) -> int:
        """How often ``run`` will call ``advance``."""
        return sum(map(len, self._efforts))

    def run(self, advance: Callable[[int], None] = lambda _: None) -> CacheReport:
        """Attack everything; ``advance`` is called with 1 after every job."""
        report = CacheReport(violations=check_tree(self._nodes, self._items, self._occurrences, self._infos))
        report.nodes = sum(tile.items is not None for tile in self._tiles)
        report.lods = len(self._tiles) - report.nodes
        report.unbuilt = len(self._nodes) - report.nodes
        report.placed_surfaces = sum(tile.size.surfaces for tile in self._tiles)
        report.sampled_surfaces = sum(
            len(np.unique(np.concatenate([e.surfaces for e in own]))) for own in self._efforts
        )
        jobs = [(tile, effort) for tile, own in zip(self._tiles, self._efforts, strict=True) for effort in own]
        pool = ThreadPoolExecutor(self._workers)
        try:
            for (tile, _), found in zip(jobs, pool.map(lambda job: self._attack(*job), jobs), strict=True):
                _count(report, tile, found)
                advance(1)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)  # jobs are short, and they read the store
        return report

    def _node_tiles(self) -> Iterator[_Tile]:
        for row in np.flatnonzero(self._nodes["tile_hash"] != b"").tolist():
            n = self._nodes[row]
            own = slice(int(n["first_item"]), int(n["first_item"] + n["n_items"]))
            name, error = bytes(n["tile_hash"]).decode(), float(n["geometric_error"])
            size = TileSize(int(n["n_items"]), self._n_primitives(name))
            yield _Tile(node_name(self._nodes, row), row, int(n["level"]), name, error, size, own)

    def _lod_tiles(self) -> Iterator[_Tile]:
        for surface in map(parse_surface_key, self._store.scan_keys("lods")):
            for lod in self._store.get_lods(surface):
                where, name = f"surface {surface} level {lod['level']}", bytes(lod["tile_hash"]).decode()
                size = TileSize(1, self._n_primitives(name))
                yield _Tile(where, surface, int(lod["level"]), name, float(lod["geometric_error"]), size, None)

    def _n_primitives(self, name: str) -> int:
        """From the tile itself, whatever tables say; 0 if it is damaged, which its job will report."""
        try:
            return sum(tile_counts(self._store.get_tile(name))[1:])
        except (CorruptRecordError, MissingRecordError):
            return 0

    def _placed(self, tile: _Tile) -> PlacedSurfaces:
        if tile.items is None:
            only = [np.array([x]) for x in self._store.locate_surface(tile.row)]
            everywhere = np.array([[-np.inf] * 3 + [np.inf] * 3])
            return PlacedSurfaces(only[0], only[1], np.array([0]), np.eye(3, 4)[None], everywhere)
        own = self._items[tile.items]
        occurrence = own["occurrence"].astype(np.int64)
        part = self._occurrences["part"][occurrence].astype(np.int64)
        row = own["surface"].astype(np.int64) - self._first_surface[part]
        boxes = np.concatenate([own["aabb_min"], own["aabb_max"]], 1)
        return PlacedSurfaces(part, row, occurrence, self._occurrences["transform"], boxes)

    def _drawn(self, name: str) -> DrawnTile:
        """A tile of the store.

        Raises:
            CorruptRecordError: it is damaged, or another one under this name.
            MissingRecordError: there is none.
        """
        data = self._store.get_tile(name)
        if tile_hash(data) != name:
            raise CorruptRecordError("the tile is not the one its name says")
        tile = decode_tile(data)
        return DrawnTile(
            np.asarray(tile.origin, float) + np.asarray(tile.positions, float),
            np.asarray(tile.triangles, np.int64).reshape(-1, 3),
            np.asarray(tile.lines, np.int64).reshape(-1, 2),
            np.asarray(tile.points, np.int64).ravel(),
        )

    def _attack(self, tile: _Tile, effort: Effort) -> TileFinding:
        """One job, in any thread."""
        try:
            drawn = self._recent[tile.name]
            ledger = tile_ledger(self._store.get_tile(tile.name)).total
        except (CorruptRecordError, MissingRecordError) as error:
            return TileFinding(violations=[Violation(f"{tile.where}: {error}", tile.row, "damaged")])
        box = None
        if tile.items is not None:
            node = self._nodes[tile.row]
            box = np.concatenate([node["aabb_min"], node["aabb_max"]])
        task = TileTask(self._parts, self._placed(tile), drawn, tile.error, tile.where, tile.row)
        found = attack_tile(task, effort, box)
        if ledger > tile.error:
            task.broken("below its ledger", ledger)
        return found


def _count(report: CacheReport, tile: _Tile, found: TileFinding) -> None:
    """Add a job's outcome; jobs of one tile come one after the other, and say what they have in common once."""
    if not report.measured or report.measured[-1].where != tile.where:
        report.measured.append(Measured(tile.where, tile.level, tile.error))
    measured = report.measured[-1]
    measured.limit = max(measured.limit, found.limit)
    measured.surface_to_tile = max(measured.surface_to_tile, found.surface_to_tile)
    measured.tile_to_surface = max(measured.tile_to_surface, found.tile_to_surface)
    report.samples += found.n_samples
    report.skipped_surfaces += found.skipped_surfaces
    report.undecided += found.undecided
    known = {(v.where, v.kind) for v in report.violations if v.row == tile.row}
    report.violations.extend(v for v in found.violations if v.kind not in PER_TILE or (v.where, v.kind) not in known)


def verify_cache(store: VerifiedStore, samples: int = DEFAULT_SAMPLES, seed: int = 0, workers: int = 1) -> CacheReport:
    """Attack all tiles of a store in one call; arguments as for ``CacheAttack``."""
    return CacheAttack(store, samples, seed, workers).run()
