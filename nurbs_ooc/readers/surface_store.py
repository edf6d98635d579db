"""A surface store (``.nurbs``) or a cache read back as an assembly: parts and scene, nothing else of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import Material, Product
from nurbs_cache.store import Store
from nurbs_cache.typed_store import READ_AT_ONCE
from nurbs_ooc.readers.assembly import Part

DATA_FILE = "data.mdb"


def is_surface_store(path: Path) -> bool:
    """Whether ``path`` is a folder that holds a store; whether it is one of ours is found out by opening it."""
    return path.is_dir() and (path / DATA_FILE).exists()


class SurfaceStoreReader:
    """An ``AssemblyReader`` of a store.

    Args:
        path: the store's folder.

    Raises:
        CacheError: foreign, newer or truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file_unit = "millimetre"
        self.unit_mm = 1.0
        self._store = Store.open(path)
        self.products: list[Product] = self._store.get_products()
        self.materials: list[Material] = self._store.get_materials()
        self.occurrences: npt.NDArray[np.void] = self._store.get_occurrences()
        self._infos = self._store.part_infos()
        self.n_parts = len(self._infos)
        self.n_surfaces = sum(info.n_surfaces for info in self._infos)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the store."""
        self._store.close()

    def parts(self) -> Iterator[Part]:
        """The parts in index order, each loaded when it is asked for."""
        n_bytes = 0
        for index, info in enumerate(self._infos):
            geometry = self._store.get_part(index)
            n_bytes += geometry.values.nbytes
            if n_bytes > READ_AT_ONCE:
                self._store.release_pages()
                n_bytes = 0
            yield Part(index, info, geometry)
