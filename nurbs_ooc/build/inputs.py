"""Everything that a build can read: files through the readers, and surface stores."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy.typing as npt

from nurbs_cache.errors import InputFileError
from nurbs_cache.scene_record import Material, Product
from nurbs_cache.store import Store
from nurbs_ooc.readers import open_assembly
from nurbs_ooc.readers.assembly import AssemblyReader, Part

HASH_BLOCK = 1 << 20  # bytes


class StoreReader:
    """A surface store (``.nurbs``) or a cache as an ``AssemblyReader``: its parts and its scene."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._store = Store.open(path)
        units = self._store.get_units()
        self.file_unit: str = str(units.get("file_unit", "mm"))
        self.unit_mm: float = float(units.get("unit_mm", 1.0))
        self.products: list[Product] = self._store.get_products()
        self.materials: list[Material] = self._store.get_materials()
        self.occurrences: npt.NDArray[Any] = self._store.get_occurrences()
        self._infos = self._store.part_infos()
        self.n_parts = len(self._infos)
        self.n_surfaces: int | None = sum(info.n_surfaces for info in self._infos)

    def parts(self) -> Iterator[Part]:
        """The stored parts in the order of their index."""
        for index, info in enumerate(self._infos):
            yield Part(index, info, self._store.get_part(index))

    def close(self) -> None:
        """Release the store."""
        self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def is_store(path: Path) -> bool:
    """Whether ``path`` is the folder of a store."""
    return (path / "data.mdb").is_file()


def open_input(path: Path) -> AssemblyReader:
    """Open a file or a store for reading.

    Raises:
        InputFileError: missing, or nothing that is known.
        CacheError: a store that cannot be read.
    """
    return StoreReader(path) if is_store(path) else open_assembly(path)


def fingerprint(path: Path) -> dict[str, Any]:
    """Name and digest of an input: enough to know it again.

    Raises:
        InputFileError: it cannot be read.
    """
    if is_store(path):
        with Store.open(path) as store:
            return {"name": path.name, "digest": store.content_hash()}
    digest = hashlib.blake2b(digest_size=16)
    try:
        with path.open("rb") as file:
            while block := file.read(HASH_BLOCK):
                digest.update(block)
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror}") from error
    return {"name": path.name, "digest": digest.hexdigest()}
