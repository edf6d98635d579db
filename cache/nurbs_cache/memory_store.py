"""A store in memory, for tests and one-shot runs: the same tables, nothing on disk."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

from nurbs_cache.errors import CacheError
from nurbs_cache.raw_store import TABLES, Writing, check_table
from nurbs_cache.typed_store import TypedStore

R = TypeVar("R")


class MemoryStore(TypedStore):
    """Tables of bytes in dictionaries."""

    read_only = False

    def __init__(self, *, provenance: Mapping[str, object] | None = None) -> None:
        super().__init__()
        self._tables: dict[str, dict[bytes, bytes]] = {table: {} for table in TABLES}
        self._lock = threading.RLock()
        self._revision = 0
        self._closed = False
        self._initialise(dict(provenance or {}), overwrite=False)

    @property
    def name(self) -> str:
        """What messages call it."""
        return "store in memory"

    def find(self, table: str, key: bytes) -> bytes | None:
        """The value under ``key``, None if there is none."""
        return self._table(table).get(key)

    def scan(self, table: str, prefix: bytes = b"") -> Iterator[tuple[bytes, bytes]]:
        """All (key, value) of a prefix in key order; changes meanwhile may show."""
        for key in self.scan_keys(table):
            value = self.find(table, key) if key.startswith(prefix) else None
            if value is not None:
                yield key, value

    def scan_keys(self, table: str) -> Iterator[bytes]:
        """All keys in order."""
        with self._lock:
            keys = sorted(self._table(table))
        yield from keys

    def transact(self, change: Callable[[Writing], R]) -> R:
        """Run ``change`` in one transaction; see ``RawStore``."""
        with self._lock:
            writing = _MemoryWriting({table: self._table(table) for table in TABLES})
            result = change(writing)
            for (table, key), value in writing.changes.items():
                if value is None:
                    self._tables[table].pop(key, None)
                else:
                    self._tables[table][key] = value
            self._revision += bool(writing.changes)
            return result

    def revision(self) -> int:
        """Number of the last transaction."""
        return self._revision

    def stats(self) -> dict[str, int]:
        """Bytes per table."""
        with self._lock:
            return {name: sum(len(k) + len(v) for k, v in self._table(name).items()) for name in TABLES}

    def counts(self) -> dict[str, int]:
        """Number of keys per table."""
        with self._lock:
            return {name: len(self._table(name)) for name in TABLES}

    def release_pages(self) -> None:
        """Nothing: it all lives in memory."""

    def close(self) -> None:
        """Release it; closing twice is allowed."""
        self._closed = True

    def _table(self, table: str) -> dict[bytes, bytes]:
        if self._closed:
            raise CacheError(f"{self.name}: is closed")
        check_table(table)
        return self._tables[table]


class _MemoryWriting:
    """Changes on top of the stored tables."""

    def __init__(self, stored: dict[str, dict[bytes, bytes]]) -> None:
        self._stored = stored
        self.changes: dict[tuple[str, bytes], bytes | None] = {}

    def find(self, table: str, key: bytes) -> bytes | None:
        check_table(table)
        changed = self.changes.get((table, key), b"")
        return changed if (table, key) in self.changes else self._stored[table].get(key)

    def keys(self, table: str) -> list[bytes]:
        check_table(table)
        changed = {key: value is not None for (name, key), value in self.changes.items() if name == table}
        kept = {key for key in self._stored[table] if changed.get(key, True)}
        return sorted(kept | {key for key, stays in changed.items() if stays})

    def put(self, table: str, key: bytes, value: bytes) -> None:
        check_table(table)
        self.changes[table, key] = bytes(value)

    def delete(self, table: str, key: bytes) -> None:
        check_table(table)
        self.changes[table, key] = None

    def clear(self, table: str) -> None:
        for key in self.keys(table):
            self.delete(table, key)
