"""What every store can do with bytes: ordered tables of keys and values, changed in transactions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, Self, TypeVar

from nurbs_cache.errors import CacheError, MissingRecordError

R = TypeVar("R")

# name -> what its keys and values are; FORMAT.md describes every byte
TABLES: dict[str, str] = {
    "meta": "name -> magic, schema, units, provenance, edits",
    "parts": "part -> geometry batch",
    "part_infos": "part -> name, number of surfaces, first surface id",
    "scene": "name -> products, materials, occurrences",
    "tree": "name -> number of nodes and items, parameters",
    "nodes": "page -> rows of the node table",
    "items": "page -> rows of the item table",
    "tiles": "hash -> tile",
    "lods": "surface id -> its levels of detail",
    "faces": "page -> rows of the face report",
}


class Writing(Protocol):
    """A transaction that is being written; nothing is visible to others before it ends."""

    def find(self, table: str, key: bytes) -> bytes | None:
        """The value under ``key`` as this transaction has it, None if there is none."""
        ...

    def keys(self, table: str) -> list[bytes]:
        """All keys in order."""
        ...

    def put(self, table: str, key: bytes, value: bytes) -> None:
        """Store ``value`` under ``key``."""
        ...

    def delete(self, table: str, key: bytes) -> None:
        """Remove ``key``; an absent one is ignored."""
        ...

    def clear(self, table: str) -> None:
        """Remove all keys."""
        ...


class RawStore(ABC):
    """Tables of bytes. Reading is safe from many threads; writing is one transaction at a time."""

    read_only: bool

    @property
    @abstractmethod
    def name(self) -> str:
        """What messages call this store: its path."""

    @abstractmethod
    def find(self, table: str, key: bytes) -> bytes | None:
        """The value under ``key``, None if there is none."""

    @abstractmethod
    def scan(self, table: str, prefix: bytes = b"") -> Iterator[tuple[bytes, bytes]]:
        """All (key, value) whose key starts with ``prefix``, in key order; changes meanwhile may show."""

    @abstractmethod
    def scan_keys(self, table: str) -> Iterator[bytes]:
        """All keys in order."""

    @abstractmethod
    def transact(self, change: Callable[[Writing], R]) -> R:
        """Run ``change`` in one transaction: all of it is stored, or nothing.

        ``change`` may be run again from the start, so it must not consume an iterator.
        """

    @abstractmethod
    def revision(self) -> int:
        """A number that grows with every transaction stored by anyone."""

    @abstractmethod
    def stats(self) -> dict[str, int]:
        """Bytes per table, as they occupy space."""

    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Number of keys per table."""

    @abstractmethod
    def release_pages(self) -> None:
        """Give back memory that holds what was read; for loops that read a whole table once."""

    @abstractmethod
    def close(self) -> None:
        """Release the store; closing twice is allowed."""

    def get(self, table: str, key: bytes) -> bytes:
        """The value under ``key``.

        Raises:
            MissingRecordError: nothing is stored under it.
        """
        value = self.find(table, key)
        if value is None:
            raise MissingRecordError(f"{self.name}: nothing under {key.hex() or 'the empty key'} in table {table}")
        return value

    def put_many(self, table: str, pairs: Iterable[tuple[bytes, bytes]]) -> None:
        """Store all (key, value) in one transaction; later ones replace earlier ones."""
        taken = list(pairs)

        def change(writing: Writing) -> None:
            for key, value in taken:
                writing.put(table, key, value)

        self.transact(change)

    def delete_many(self, table: str, keys: Iterable[bytes]) -> None:
        """Delete keys in one transaction; absent ones are ignored."""
        taken = list(keys)

        def change(writing: Writing) -> None:
            for key in taken:
                writing.delete(table, key)

        self.transact(change)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def check_table(table: str) -> None:
    """Refuse a table that no store has."""
    if table not in TABLES:
        raise CacheError(f"there is no table {table!r}, only {', '.join(TABLES)}")
