"""A store on disk: one folder with one LMDB file, many readers, one writer."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Self, TypeVar

import lmdb

from nurbs_cache.environment import FIRST_MAP_BYTES, Environment, created, shared
from nurbs_cache.errors import CacheError
from nurbs_cache.raw_store import TABLES, Writing
from nurbs_cache.typed_store import TypedStore

R = TypeVar("R")

_SCAN_ENTRIES = 4096  # per read transaction of a scan, so that no scan holds old pages for long
_SCAN_BYTES = 8 << 20


class Store(TypedStore):
    """An LMDB store; make one with ``create`` or ``open``, close it or use it in a ``with``."""

    def __init__(self, path: Path, environment: Environment, *, read_only: bool) -> None:
        super().__init__()
        self.path = path
        self.read_only = read_only
        self._environment = environment
        self._closed = False

    @classmethod
    def create(
        cls,
        path: Path | str,
        *,
        provenance: Mapping[str, object] | None = None,
        overwrite: bool = False,
        map_bytes: int = FIRST_MAP_BYTES,
    ) -> Self:
        """Make a store at ``path`` (a folder that does not exist, is empty or holds a store) and write to it.

        Args:
            provenance: what is worth knowing of how it was made, as JSON; not part of the content hash.
            overwrite: empty the store that is there; otherwise it is refused.
            map_bytes: first size of the map; it grows by itself.

        Raises:
            CacheError: a store or something foreign is there, another process writes to it, or it cannot be made.
        """
        folder = Path(path)
        store = cls(folder, created(folder, map_bytes=map_bytes), read_only=False)
        try:
            store._initialise(dict(provenance or {}), overwrite=overwrite)
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def open(cls, path: Path | str, *, read_only: bool = True) -> Self:
        """Open an existing store, while others read or write it.

        Raises:
            CacheError: missing, foreign, truncated, of another schema; or, for writing, another writer has it.
        """
        folder = Path(path)
        environment = shared(folder)
        try:
            if not read_only:
                environment.lock_for_writing()
            store = cls(folder, environment, read_only=read_only)
        except BaseException:
            environment.release()
            raise
        try:
            store._check_schema()
        except BaseException:
            store.close()
            raise
        return store

    @property
    def name(self) -> str:
        """What messages call it."""
        return str(self.path)

    def find(self, table: str, key: bytes) -> bytes | None:
        """The value under ``key``, None if there is none."""
        environment = self._live()
        handle = environment.table(table)
        with environment.reading() as transaction:
            value = transaction.get(key, db=handle)
            return None if value is None else bytes(value)

    def scan(self, table: str, prefix: bytes = b"") -> Iterator[tuple[bytes, bytes]]:
        """All (key, value) of a prefix in key order; changes meanwhile may show."""
        start: bytes | None = prefix
        while start is not None:
            batch, start = self._scan_batch(table, prefix, start)
            yield from batch

    def scan_keys(self, table: str) -> Iterator[bytes]:
        """All keys in order."""
        environment = self._live()
        with environment.reading() as transaction:
            cursor = transaction.cursor(environment.table(table))
            keys = [bytes(key) for key in cursor.iternext(keys=True, values=False)]
        yield from keys

    def transact(self, change: Callable[[Writing], R]) -> R:
        """Run ``change`` in one transaction; see ``RawStore``."""
        if self.read_only:
            raise CacheError(f"{self.path}: is open for reading only")
        environment = self._live()
        return environment.write(lambda transaction: change(_LmdbWriting(environment, transaction)))

    def revision(self) -> int:
        """Number of the last transaction."""
        return int(self._live().env.info()["last_txnid"])

    def stats(self) -> dict[str, int]:
        """Bytes per table."""
        environment = self._live()
        sizes = {}
        with environment.reading() as transaction:
            for table in TABLES:
                stat = transaction.stat(environment.table(table))
                pages = stat["branch_pages"] + stat["leaf_pages"] + stat["overflow_pages"]
                sizes[table] = int(pages * stat["psize"])
        return sizes

    def counts(self) -> dict[str, int]:
        """Number of keys per table."""
        environment = self._live()
        with environment.reading() as transaction:
            return {table: int(transaction.stat(environment.table(table))["entries"]) for table in TABLES}

    def release_pages(self) -> None:
        """See ``RawStore``: the file is mapped, and pages once read count as this process's memory."""
        self._live().release_pages()

    def close(self) -> None:
        """Release it; closing twice is allowed."""
        if self._closed:
            return
        self._closed = True
        if self._environment.pid != os.getpid():
            return  # a copy in a forked child: the parent's to close
        if not self.read_only:
            self._environment.unlock()
        self._environment.release()

    def _scan_batch(self, table: str, prefix: bytes, start: bytes) -> tuple[list[tuple[bytes, bytes]], bytes | None]:
        """Some entries from ``start`` on, and where to go on (None: at the end)."""
        environment = self._live()
        batch: list[tuple[bytes, bytes]] = []
        n_bytes = 0
        with environment.reading() as transaction:
            cursor = transaction.cursor(environment.table(table))
            found = cursor.set_range(start) if start else cursor.first()
            if not found:
                return batch, None
            for raw_key, raw_value in cursor:
                key = bytes(raw_key)
                if not key.startswith(prefix):
                    return batch, None
                batch.append((key, bytes(raw_value)))
                n_bytes += len(raw_value)
                if len(batch) >= _SCAN_ENTRIES or n_bytes >= _SCAN_BYTES:
                    return batch, key + b"\0"
        return batch, None

    def _live(self) -> Environment:
        """The environment; after a fork, the child's own."""
        if self._closed:
            raise CacheError(f"{self.path}: is closed")
        if self._environment.pid != os.getpid():
            self._environment = shared(self.path)
            self.read_only = True
        return self._environment


class _LmdbWriting:
    """A write transaction as ``Writing``."""

    def __init__(self, environment: Environment, transaction: lmdb.Transaction) -> None:
        self._environment = environment
        self._transaction = transaction

    def find(self, table: str, key: bytes) -> bytes | None:
        value = self._transaction.get(key, db=self._environment.table(table))
        return None if value is None else bytes(value)

    def keys(self, table: str) -> list[bytes]:
        cursor = self._transaction.cursor(self._environment.table(table))
        return [bytes(key) for key in cursor.iternext(keys=True, values=False)]

    def put(self, table: str, key: bytes, value: bytes) -> None:
        self._transaction.put(key, value, db=self._environment.table(table))

    def delete(self, table: str, key: bytes) -> None:
        self._transaction.delete(key, db=self._environment.table(table))

    def clear(self, table: str) -> None:
        self._transaction.drop(self._environment.table(table), delete=False)
