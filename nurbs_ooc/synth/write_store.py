"""Writes a synthetic assembly as a surface store, part by part: memory holds one part at a time."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build.target import open_target, partial_path
from nurbs_ooc.synth.baked import Baker
from nurbs_ooc.synth.materials import material_list
from nurbs_ooc.synth.model import CarModel
from nurbs_ooc.synth.part_draft import PartDraft
from nurbs_ooc.synth.presets import Preset
from nurbs_ooc.synth.product_tree import ProductTree
from nurbs_ooc.synth.tally import Tally

StoredPart = tuple[int, PartInfo, GeometryBatch]
ID_SHIFT = np.uint64(32)  # an edge's id is part << 32 | row


@dataclass
class _Numbers:
    """Running numbers while parts are given out."""

    parts: int = 0
    surfaces: int = 0
    placed: Tally = field(default_factory=Tally)

    def next(self, name: str, geometry: GeometryBatch) -> StoredPart:
        index, first = self.parts, self.surfaces
        edges = geometry.edges.copy()
        edges["id"] = (np.uint64(index) << ID_SHIFT) | (edges["id"] & np.uint64(0xFFFF_FFFF))
        self.parts, self.surfaces = index + 1, first + len(geometry)
        return index, PartInfo(name, len(geometry), first), dataclasses.replace(geometry, edges=edges)


def write_synthetic(
    preset: Preset, seed: int, path: Path, *, unshared: bool, force: bool, advance: Callable[[int], None]
) -> dict[str, Any]:
    """Write a model.

    Args:
        preset: which, and how large.
        seed: equal presets and seeds give equal content.
        path: the store to make (a folder, ``.nurbs``).
        unshared: every placement becomes a part of its own, with its own surfaces, as in a file without
            occurrences.
        force: replace what is there.
        advance: told the placed surfaces of each part.

    Returns:
        Counts: ``surfaces`` and ``control_points`` are placed ones, ``stored_surfaces`` those of the parts.

    Raises:
        UsageError, CacheError: something is there, or it cannot be written.
    """
    materials, roles = material_list(preset.materials, preset.paint)
    model = CarModel(preset.shape, preset.size, roles, seed)
    tree = ProductTree(preset.name, preset.places())
    numbers = _Numbers()
    plan = {"synthetic": {"model": preset.name, "seed": seed, "unshared": unshared, "surfaces": preset.size.surfaces}}
    with _all_or_nothing(path, plan, force) as store:
        parts = _unshared(model, tree, numbers) if unshared else _shared(model, tree, numbers)
        store.put_parts(_counted(parts, advance))
        units = {"stored": "mm", "synthetic": preset.name, "seed": seed}
        store.put_scene(tree.products, materials, tree.occurrences(), units)
    return {
        "surfaces": numbers.placed.surfaces,
        "control_points": numbers.placed.control_points,
        "rational": numbers.placed.rational,
        "with_holes": numbers.placed.holed,
        "stored_surfaces": numbers.surfaces,
        "parts": numbers.parts,
        "occurrences": len(tree.occurrences()),
        "products": len(tree.products),
        "materials": len(materials),
    }


@contextmanager
def _all_or_nothing(path: Path, plan: dict[str, Any], force: bool) -> Iterator[Store]:
    """The store to write; nothing is left of it when the block fails."""
    ours = False
    try:
        with open_target(path, plan, resume=False, force=force) as store:
            ours = True
            yield store
    except BaseException:
        if ours:
            shutil.rmtree(partial_path(path), ignore_errors=True)
        raise


def _counted(parts: Iterator[StoredPart], advance: Callable[[int], None]) -> Iterator[StoredPart]:
    for part in parts:
        yield part
        advance(len(part[2]))


def _made(model: CarModel, n_cars: int, numbers: _Numbers) -> Iterator[tuple[PartDraft, GeometryBatch]]:
    """Parts with their geometry, counted as often as they will be placed."""
    for draft in model.parts():
        geometry = draft.builder.build(draft.name)
        numbers.placed = numbers.placed.plus(Tally.of(geometry).times(len(draft.places) * n_cars))
        yield draft, geometry


def _shared(model: CarModel, tree: ProductTree, numbers: _Numbers) -> Iterator[StoredPart]:
    """Each part once."""
    for draft, geometry in _made(model, len(tree.cars), numbers):
        for car in range(len(tree.cars)):
            for place in draft.places:
                tree.place(numbers.parts, draft.name, car, draft.group, place)
        yield numbers.next(draft.name, geometry)


def _unshared(model: CarModel, tree: ProductTree, numbers: _Numbers) -> Iterator[StoredPart]:
    """Each placement by itself, moved to where it is."""
    for draft, geometry in _made(model, len(tree.cars), numbers):
        baker = Baker(geometry)
        for car in range(len(tree.cars)):
            for place in draft.places:
                whole = tree.place(numbers.parts, draft.name, car, draft.group, place, baked=True)
                yield numbers.next(draft.name, baker.moved(whole))
