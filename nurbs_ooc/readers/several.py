"""Several input files as one assembly: the rows and ids of each are shifted behind those before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_ooc.readers import open_assembly
from nurbs_ooc.readers.assembly import AssemblyReader, Part
from nurbs_ooc.readers.surface_store import SurfaceStoreReader, is_surface_store

EDGE_PART_SHIFT = np.uint64(32)  # an edge's id is part << 32 | row


def open_inputs(paths: Sequence[Path]) -> AssemblyReader:
    """Open STEP and IGES files and surface stores; more than one become one assembly with as many roots.

    Raises:
        InputFileError: a file is missing or not what it says.
        CacheError: a store is foreign, newer or truncated.
    """
    readers: list[AssemblyReader] = []
    try:
        readers.extend(open_input(path) for path in paths)
    except BaseException:
        for reader in readers:
            reader.close()
        raise
    return readers[0] if len(readers) == 1 else SeveralAssemblies(readers)


def open_input(path: Path) -> AssemblyReader:
    """Open one STEP or IGES file or surface store.

    Raises:
        InputFileError: missing, or nothing that is known.
        CacheError: a store that cannot be read.
    """
    return SurfaceStoreReader(path) if is_surface_store(path) else open_assembly(path)


class SeveralAssemblies:
    """An ``AssemblyReader`` that runs through others one after the other.

    Products, materials and occurrences are those of the inputs read so far and of the one being read: what an
    input will add to the lists is known only when it has been read.
    """

    def __init__(self, readers: Sequence[AssemblyReader]) -> None:
        self._readers = readers
        self._begun = 1
        self.path: Path = readers[0].path
        self.file_unit: str = readers[0].file_unit
        self.unit_mm: float = readers[0].unit_mm
        self.products: list[Product] = []
        self.materials: list[Material] = []
        self._refresh()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all inputs."""
        for reader in self._readers:
            reader.close()

    @property
    def n_parts(self) -> int:
        """Parts known so far."""
        return sum(reader.n_parts for reader in self._readers)

    @property
    def n_surfaces(self) -> int | None:
        """Surfaces of all inputs, None while one does not know."""
        total = 0
        for reader in self._readers:
            if reader.n_surfaces is None:
                return None
            total += reader.n_surfaces
        return total

    @property
    def occurrences(self) -> npt.NDArray[np.void]:
        """The placed parts, with shifted part, product and material."""
        tables = [np.zeros(0, OCCURRENCE_DTYPE)]
        part = product = material = 0
        for reader in self._readers[: self._begun]:
            table = reader.occurrences.copy()
            table["part"] += part
            table["product"] += product
            table["material"][table["material"] >= 0] += material
            tables.append(table)
            part += reader.n_parts
            product += len(reader.products)
            material += len(reader.materials)
        return np.concatenate(tables)

    def parts(self) -> Iterator[Part]:
        """The parts of the first input, then those of the next."""
        first_part = first_surface = first_material = 0
        for number, reader in enumerate(self._readers, start=1):
            self._begun = number
            n_surfaces = 0
            for part in reader.parts():
                self._refresh()
                n_surfaces += part.info.n_surfaces
                info = replace(part.info, first_surface=part.info.first_surface + first_surface)
                yield _shifted(part, info, first_part, first_material)
            self._refresh()
            first_part += reader.n_parts
            first_surface += n_surfaces
            first_material += len(reader.materials)

    def _refresh(self) -> None:
        """Bring the lists up to what the inputs know by now."""
        self.products, self.materials = [], []
        for reader in self._readers[: self._begun]:
            first = len(self.products)
            self.products += [p if p.parent < 0 else replace(p, parent=p.parent + first) for p in reader.products]
            self.materials += reader.materials


def _shifted(part: Part, info: PartInfo, first_part: int, first_material: int) -> Part:
    """``part`` as the assembly of all inputs numbers it."""
    surfaces, edges = part.geometry.surfaces.copy(), part.geometry.edges.copy()
    surfaces["material"] += first_material
    edges["id"] += np.uint64(first_part) << EDGE_PART_SHIFT
    return Part(part.index + first_part, info, replace(part.geometry, surfaces=surfaces, edges=edges))
