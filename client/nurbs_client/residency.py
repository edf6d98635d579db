"""What is in the graphics memory: one state per tile, a budget in bytes, and what may go when it is full.

::

    ABSENT --want--> WANTED --arrive--> RESIDENT --evict--> ABSENT
                        |`--fail--> FAILED
                        `--forget--> ABSENT

A wanted tile is queued or being loaded; only the loader knows which.

Eviction starts above the high watermark and stops below the low one, least recently kept first. Kept
are the tiles that are drawn, those of their parents and of their children (Guthe 2004, 4.2), so that
a small movement of the viewer never waits. Where even what is drawn does not fit, the caller raises
the error target (``BudgetGovernor``) and says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from nurbs_client import selection
from nurbs_client.scene import Scene
from nurbs_client.selection import LEVEL_BIAS, MAX_LEVEL, MIN_LEVEL, Selection
from nurbs_client.tile_mesh import TileMesh

HIGH_WATERMARK, LOW_WATERMARK = 0.95, 0.80  # parts of the budget: evict in gulps, not a tile at a time


class TileKey(NamedTuple):
    """A node's tile (``surface`` -1), or a surface's LOD at a ladder level (``node`` -1)."""

    node: int
    surface: int  # row in ``Scene.surface_ids``
    level: int

    @classmethod
    def of_node(cls, row: int) -> TileKey:
        """The tile of the node in this row."""
        return cls(row, -1, 0)

    @classmethod
    def of_lod(cls, surface: int, level: int) -> TileKey:
        """A surface's LOD within 2**level mm of its own space."""
        return cls(-1, surface, level)


class TileState(IntEnum):
    """Where a tile is."""

    ABSENT = 0
    WANTED = 1
    RESIDENT = 2
    FAILED = 3


@dataclass
class Entry:
    """A tile that is known.

    Attributes:
        n_bytes: of graphics memory while resident.
        error: mm in the tile's own space, of what is drawn.
        slot: the renderer's, while resident.
        mesh: of a LOD, kept for measuring how near its surface comes.
        kept: number of the frame that last drew it; half a frame less for its parents and children.
    """

    state: TileState
    n_bytes: int = 0
    error: float = 0.0
    slot: int = -1
    mesh: TileMesh | None = None
    kept: float = -1.0
    reason: str = ""


@dataclass
class ResidencyTable:
    """States of all tiles, and the arrays that the selection reads."""

    scene: Scene
    budget_bytes: int
    release: Callable[[int], None] = lambda _: None
    entries: dict[TileKey, Entry] = field(default_factory=dict)
    used_bytes: int = 0
    n_resident: int = 0
    n_evicted: int = 0

    def __post_init__(self) -> None:
        self.node = np.zeros(len(self.scene.nodes), np.uint8)
        self.node_error = np.zeros(len(self.scene.nodes))  # mm, of the resident tiles' own ledgers
        self.node_slot = np.full(len(self.scene.nodes), -1, np.int64)
        self.lod_mask = np.zeros(len(self.scene.surface_ids), np.int64)
        self.own_mm_per_px = np.zeros(len(self.scene.items))
        self._serving: dict[tuple[int, int], TileKey] = {}

    @property
    def snapshot(self) -> selection.Residency:
        """The arrays as the selection takes them (not copied)."""
        return selection.Residency(self.node, self.lod_mask, self.own_mm_per_px)

    @property
    def has_room(self) -> bool:
        """Whether tiles that nothing shows yet may come in."""
        return self.used_bytes < LOW_WATERMARK * self.budget_bytes

    def state(self, key: TileKey) -> TileState:
        """Where the tile is now."""
        entry = self.entries.get(key)
        return entry.state if entry else TileState.ABSENT

    def want(self, key: TileKey) -> bool:
        """Ask for a tile; False if it is under way, there, or known to be broken."""
        if self.state(key) not in (TileState.ABSENT, TileState.WANTED):
            return False
        self.entries[key] = Entry(TileState.WANTED)
        return True

    def forget(self, key: TileKey) -> None:
        """The request no longer matters and nobody works on it."""
        if self.state(key) == TileState.WANTED:
            del self.entries[key]

    def arrive(self, key: TileKey, slot: int, mesh: TileMesh) -> None:
        """The tile is in graphics memory now."""
        entry = Entry(TileState.RESIDENT, mesh.n_bytes, mesh.error, slot, mesh if key.surface >= 0 else None)
        self.entries[key] = entry
        self.used_bytes += entry.n_bytes
        self.n_resident += 1
        if key.node >= 0:
            self.node[key.node] = selection.RESIDENT
            self.node_slot[key.node] = slot
            self.node_error[key.node] = mesh.error
            # The table's error decides what is drawn, whatever has been loaded; unless it was too hopeful.
            errors = self.scene.node_arrays.error
            errors[key.node] = max(errors[key.node], mesh.error)
        else:
            self._serve(key, entry.error)

    def fail(self, key: TileKey, reason: str) -> None:
        """The tile cannot be had; it is not asked for again."""
        self.entries[key] = Entry(TileState.FAILED, reason=reason)
        if key.node >= 0:
            self.node[key.node] = selection.BROKEN

    def _serve(self, key: TileKey, error: float) -> None:
        """Offer a LOD for every level it is good enough for: a plane's coarsest is also its finest."""
        finest = key.level
        if error > 0:
            finest = max(min(key.level, math.ceil(math.log2(error))), MIN_LEVEL)
        for level in range(finest, key.level + 1):
            serving = self._serving.get((key.surface, level))
            if serving is None or serving.level < key.level:
                self._serving[key.surface, level] = key
            self.lod_mask[key.surface] |= np.int64(1 << (level + LEVEL_BIAS))

    def finest_level(self, surface: int) -> int | None:
        """The finest level that one of the surface's resident LODs serves."""
        mask = int(self.lod_mask[surface])
        return (mask & -mask).bit_length() - 1 - LEVEL_BIAS if mask else None

    def lod_entry(self, surface: int, level: int) -> tuple[TileKey, Entry]:
        """The resident LOD that serves a level set in ``lod_mask``: the coarsest that is good enough."""
        key = self._serving[surface, level]
        return key, self.entries[key]

    def keep(self, keys: Iterable[TileKey], frame: float) -> int:
        """Protect resident tiles from eviction before frame ``frame``; returns their bytes."""
        total = 0
        for key in keys:
            entry = self.entries.get(key)
            if entry:
                entry.kept = max(entry.kept, frame)
                total += entry.n_bytes
        return total

    def shrink(self, frame: int) -> int:
        """Evict what frame ``frame`` does not draw, once the high watermark is passed; returns the bytes."""
        if self.used_bytes <= HIGH_WATERMARK * self.budget_bytes:
            return 0
        resident = [(e.kept, k) for k, e in self.entries.items() if e.state == TileState.RESIDENT and e.kept < frame]
        before = self.used_bytes
        for _, key in sorted(resident):
            if self.used_bytes <= LOW_WATERMARK * self.budget_bytes:
                break
            self._evict(key)
        return before - self.used_bytes

    def _evict(self, key: TileKey) -> None:
        entry = self.entries.pop(key)
        self.used_bytes -= entry.n_bytes
        self.n_resident -= 1
        self.n_evicted += 1
        self.release(entry.slot)
        if key.node >= 0:
            self.node[key.node] = 0
            self.node_slot[key.node] = -1
            return
        self.lod_mask[key.surface] = 0
        levels = range(MIN_LEVEL, MAX_LEVEL + 1)
        others = [k for k in (TileKey.of_lod(key.surface, level) for level in levels) if k in self.entries]
        for level in levels:
            self._serving.pop((key.surface, level), None)
        for other in others:
            if self.entries[other].state == TileState.RESIDENT:
                self._serve(other, self.entries[other].error)


def drawn_lods(scene: Scene, chosen: Selection, table: ResidencyTable) -> list[tuple[TileKey, Entry]]:
    """The LODs that a selection draws, one per item."""
    surfaces = scene.item_arrays.surface[chosen.items].tolist()
    return [table.lod_entry(s, level) for s, level in zip(surfaces, chosen.item_levels.tolist(), strict=True)]


def nearby_tiles(scene: Scene, chosen: Selection) -> set[TileKey]:
    """The tiles of the parents and of the children of what a selection draws."""
    nodes = scene.node_arrays
    holders = np.unique(scene.items["node"][chosen.items])
    parents = np.concatenate([nodes.parent[chosen.nodes], holders, nodes.parent[holders]])
    ranges = [np.arange(nodes.first_child[r], nodes.first_child[r] + nodes.n_children[r]) for r in chosen.nodes]
    rows = np.unique(np.concatenate([parents, *ranges]))
    return {TileKey.of_node(row) for row in rows[rows >= 0].tolist()}


@dataclass
class BudgetGovernor:
    """Raises the error target while what has to be resident does not fit, and takes it back later.

    Attributes:
        target_px: asked for, pixels; effective_px: in use.
        budget_bytes: of graphics memory.
        was_raised: whether the picture has ever been coarser than asked for, because of the budget.
    """

    target_px: float
    budget_bytes: int
    effective_px: float = 0.0
    was_raised: bool = False

    RAISE = 1.25  # a step of the target: about a third fewer triangles
    LOWER = 1.06  # taken back more slowly, so that it does not swing

    def __post_init__(self) -> None:
        self.effective_px = max(self.effective_px, self.target_px)

    def update(self, needed_bytes: int) -> bool:
        """Take in what drawn and wanted tiles need; True if the target was raised: select again."""
        if needed_bytes > HIGH_WATERMARK * self.budget_bytes:
            self.effective_px *= self.RAISE
            self.was_raised = True
            return True
        if needed_bytes < 0.5 * self.budget_bytes:
            self.effective_px = max(self.target_px, self.effective_px / self.LOWER)
        return False
