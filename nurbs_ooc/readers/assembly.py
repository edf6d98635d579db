"""What every reader gives: the product tree, materials, placements, and the parts one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import Material, PartInfo, Product
from nurbs_cache.surface_record import GeometryBatch


@dataclass(frozen=True, eq=False)
class Part:
    """One stored body of the assembly, in its own space, mm.

    Attributes:
        index: row in the scene's parts.
        info: name and surface ids.
        geometry: its faces; ``material`` points into the reader's materials.
    """

    index: int
    info: PartInfo
    geometry: GeometryBatch


class AssemblyReader(Protocol):
    """An open input file; a context manager.

    Attributes:
        path: the file as the user named it.
        file_unit: the length unit the file declares, or "millimetre (assumed)".
        unit_mm: that unit in mm. Everything given out is already in mm.
        products: the product tree, parents before their children.
        materials: row 0 is for surfaces without a colour. May grow while parts are read.
        occurrences: ``OCCURRENCE_DTYPE``, the placed parts.
        n_parts: parts known so far; final once ``parts`` is exhausted.
        n_surfaces: surfaces of all parts (each part once); None until all are known.
    """

    path: Path
    file_unit: str
    unit_mm: float
    products: list[Product]
    materials: list[Material]

    @property
    def occurrences(self) -> npt.NDArray[np.void]:
        """See the class."""
        ...

    @property
    def n_parts(self) -> int:
        """See the class."""
        ...

    @property
    def n_surfaces(self) -> int | None:
        """See the class."""
        ...

    def parts(self) -> Iterator[Part]:
        """All parts in order of their index, once; nothing of a part is kept after it was given out."""
        ...

    def close(self) -> None:
        """Release what is held for the file."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
