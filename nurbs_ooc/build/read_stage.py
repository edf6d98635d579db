"""Stage 1: inputs become parts and one scene in the store.

Several inputs make one scene: parts, products and surface ids run on, equal materials become one. The
scene is stored again after each input and names those that are in it, so a killed build goes on with
the input that it was reading.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import DEFAULT_MATERIAL, Material, PartInfo, Product
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.readers.assembly import AssemblyReader, Part
from nurbs_ooc.readers.several import open_input

PART_SHIFT = np.uint64(32)  # edge id = part << 32 | row
ROW_MASK = np.uint64(0xFFFF_FFFF)

StoredPart = tuple[int, PartInfo, GeometryBatch]


class SceneMerger:
    """Collects the scenes of several inputs into one; the first one keeps its numbers.

    Args:
        store: whatever it holds of finished inputs is where this goes on.
    """

    def __init__(self, store: TypedStore) -> None:
        self.inputs: list[dict[str, Any]] = list(store.get_units().get("inputs", []))
        self.products: list[Product] = store.get_products()
        self.materials: list[Material] = store.get_materials()
        self.n_parts = sum(entry["parts"] for entry in self.inputs)
        self.n_surfaces = sum(info.n_surfaces for info in store.part_infos()[: self.n_parts])
        self._occurrences: list[npt.NDArray[np.void]] = [store.get_occurrences()]
        self._row_of = {material: row for row, material in enumerate(self.materials)}

    @property
    def occurrences(self) -> npt.NDArray[np.void]:
        """All occurrences so far."""
        return np.concatenate(self._occurrences)

    def add_part(self, part: Part, materials: Sequence[Material]) -> StoredPart:
        """A part of the current input with our numbers; ``materials`` are the input's own so far."""
        index = self.n_parts + part.index
        surfaces, edges = part.geometry.surfaces.copy(), part.geometry.edges.copy()
        surfaces["material"] = self._merged_rows(surfaces["material"], materials)
        edges["id"] = (np.uint64(index) << PART_SHIFT) | (edges["id"] & ROW_MASK)
        info = dataclasses.replace(part.info, first_surface=self.n_surfaces, n_surfaces=len(surfaces))
        self.n_surfaces += len(surfaces)
        return index, info, dataclasses.replace(part.geometry, surfaces=surfaces, edges=edges)

    def finish_input(self, reader: AssemblyReader) -> None:
        """Take over products, materials and occurrences of an input whose parts have all been added."""
        first_product = len(self.products)
        for product in reader.products:
            parent = product.parent + first_product if product.parent >= 0 else -1
            self.products.append(dataclasses.replace(product, parent=parent))
        occurrences = reader.occurrences.copy()
        occurrences["part"] += self.n_parts
        occurrences["product"] += first_product
        own = occurrences["material"] >= 0
        occurrences["material"][own] = self._merged_rows(occurrences["material"][own], reader.materials)
        self._occurrences.append(occurrences)
        self.n_parts += reader.n_parts
        units = {"file": reader.path.name, "file_unit": reader.file_unit, "unit_mm": reader.unit_mm}
        self.inputs.append({**units, "parts": reader.n_parts})

    def _merged_rows(self, rows: npt.NDArray[np.int32], materials: Sequence[Material]) -> npt.NDArray[np.int32]:
        """Our material row for each of the input's (-1: the default)."""
        for material in materials:
            self._row(material)
        used, inverse = np.unique(rows, return_inverse=True)
        ours = [self._row(materials[row] if row >= 0 else DEFAULT_MATERIAL) for row in used.tolist()]
        return np.array(ours, np.int32)[inverse]

    def _row(self, material: Material) -> int:
        if material not in self._row_of:
            self._row_of[material] = len(self.materials)
            self.materials.append(material)
        return self._row_of[material]


def read_inputs(inputs: Sequence[Path], store: TypedStore, advance: Callable[[int], None]) -> None:
    """Store the parts of all inputs and the scene; what is finished is not read again.

    Args:
        inputs: files or stores.
        store: where the parts go; those that are there already are not stored again.
        advance: told the number of surfaces of each part that was read.
    """
    merger = SceneMerger(store)
    for path in inputs[len(merger.inputs) :]:
        with open_input(path) as reader:
            store.put_parts(_new_parts(reader, merger, set(store.part_numbers()), advance))
            merger.finish_input(reader)
        units = {"stored": "mm", "inputs": merger.inputs}
        store.put_scene(merger.products, merger.materials, merger.occurrences, units)


def _new_parts(
    reader: AssemblyReader, merger: SceneMerger, stored: set[int], advance: Callable[[int], None]
) -> Iterator[StoredPart]:
    for part in reader.parts():
        entry = merger.add_part(part, reader.materials)
        if entry[0] not in stored:
            yield entry
        advance(len(part.geometry))
