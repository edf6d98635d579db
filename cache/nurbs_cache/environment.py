"""One LMDB environment per file and process: shared by all stores on it, growing by itself.

LMDB asks for three things that this module takes care of:

* A process opens a file once; a second opening breaks the locks of the first. ``shared`` hands out
  the one environment of a file and counts its users.
* The map may change its size only while no transaction of this process is active. Every transaction
  therefore passes a gate; growing closes the gate, waits, resizes, opens it.
* An environment must not be used after a fork. Stores notice by the process id and open it anew.

Only one process may write. That lock is a POSIX record lock on ``writer.lock``, which the kernel
drops when the process ends, however it ends.
"""

from __future__ import annotations

import fcntl
import os
import resource
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import lmdb

from nurbs_cache.errors import CacheError
from nurbs_cache.lmdb_layout import check_whole
from nurbs_cache.raw_store import TABLES

R = TypeVar("R")

DATA_FILE = "data.mdb"
WRITER_FILE = "writer.lock"
FIRST_MAP_BYTES = 1 << 30  # address space, not disk; doubles when full
MAX_READERS = 1024  # read transactions at once, over all processes; 64 bytes each
FULL_DISK_BYTES = 1 << 20  # less than this is full: a failed write has taken what there was
_TRIES = 4  # a writer may be in the middle of a commit when a file is first looked at
_PAUSE_S = 0.02

_registry: dict[tuple[int, int], Environment] = {}
_registry_lock = threading.RLock()
_left_by_fork: list[Environment] = []  # the parent's environments, kept from being finalised


class Environment:
    """An open LMDB environment with the tables of a store; use ``shared``."""

    def __init__(self, path: Path, *, create: bool, map_bytes: int) -> None:
        self.path = path
        self.pid = os.getpid()
        self.users = 0
        self._writer: int | None = None  # descriptor of the locked file
        self._active = 0
        self._gate = threading.Condition()
        self._closed_gate = False
        self._writing = threading.Lock()
        self.env = _open_lmdb(path, create=create, map_bytes=map_bytes)
        try:
            _refuse_foreign(self.env, path)
            self._tables = {name: self.env.open_db(name.encode(), create=create) for name in TABLES}
        except lmdb.Error as error:
            self.env.close()
            raise CacheError(f"{path}: an LMDB file, but not a nurbs-ooc cache: {error}") from error
        except CacheError:
            self.env.close()
            raise
        self.identity = _identity(path)

    @contextmanager
    def reading(self) -> Iterator[lmdb.Transaction]:
        """A read transaction; its buffers end with it."""
        with self._passing():
            transaction = self._begin(write=False)
            try:
                yield transaction
            except lmdb.Error as error:
                raise CacheError(f"{self.path}: cannot be read: {error}") from error
            finally:
                transaction.abort()

    def write(self, change: Callable[[lmdb.Transaction], R]) -> R:
        """Run ``change`` in a write transaction; when the map is full, grow it and run it again."""
        with self._writing:
            while True:
                try:
                    with self._passing():
                        return self._write_once(change)
                except lmdb.MapFullError:
                    self._resize(2 * self.env.info()["map_size"])
                except lmdb.Error as error:
                    raise CacheError(f"{self.path}: cannot be written: {_why(error, self.path)}") from error

    def table(self, name: str) -> lmdb._Database:
        """Handle of a table."""
        try:
            return self._tables[name]
        except KeyError:
            raise CacheError(f"{self.path}: there is no table {name!r}, only {', '.join(TABLES)}") from None

    def lock_for_writing(self) -> None:
        """Become the one writer.

        Raises:
            CacheError: somebody else is.
        """
        with _registry_lock:
            if self._writer is not None:
                raise CacheError(f"{self.path}: is already open for writing in this process")
            self._writer = lock_writer(self.path)

    def take_lock(self, descriptor: int) -> None:
        """Keep a lock that ``lock_writer`` has given."""
        self._writer = descriptor

    def unlock(self) -> None:
        """Stop being the writer; what was written is on the disk afterwards."""
        with _registry_lock:
            if self._writer is not None:
                self.env.sync(True)
                os.close(self._writer)
                self._writer = None

    @property
    def is_writer(self) -> bool:
        """Whether this process holds the writer's lock on it."""
        return self._writer is not None

    def release_pages(self) -> None:
        """Take the pages that were read out of this process's memory; setting the map's size maps it anew."""
        self._resize(self.env.info()["map_size"])

    def release(self) -> None:
        """Give back what ``shared`` gave."""
        with _registry_lock:
            self.users -= 1
            if self.users == 0:
                _registry.pop(self.identity, None)
                with self._closing():
                    self.env.close()

    def _write_once(self, change: Callable[[lmdb.Transaction], R]) -> R:
        transaction = self._begin(write=True)
        try:
            result = change(transaction)
            transaction.commit()
        except BaseException:
            transaction.abort()
            raise
        return result

    def _begin(self, *, write: bool) -> lmdb.Transaction:
        """Begin; a map that another process has outgrown is first adopted at its new size."""
        for _ in range(_TRIES):
            try:
                return self.env.begin(write=write, buffers=True)
            except lmdb.MapResizedError:
                self._leave()
                try:
                    self._resize(0)
                finally:
                    self._enter()
        raise CacheError(f"{self.path}: another process keeps resizing it")

    @contextmanager
    def _passing(self) -> Iterator[None]:
        self._enter()
        try:
            yield
        finally:
            self._leave()

    def _enter(self) -> None:
        with self._gate:
            while self._closed_gate:
                self._gate.wait()
            self._active += 1

    def _leave(self) -> None:
        with self._gate:
            self._active -= 1
            self._gate.notify_all()

    @contextmanager
    def _closing(self) -> Iterator[None]:
        """Close the gate and wait until no transaction of this process is active."""
        with self._gate:
            while self._closed_gate:
                self._gate.wait()
            self._closed_gate = True
            while self._active:
                self._gate.wait()
        try:
            yield
        finally:
            with self._gate:
                self._closed_gate = False
                self._gate.notify_all()

    def _resize(self, n_bytes: int) -> None:
        with self._closing():
            self.env.set_mapsize(n_bytes)


def shared(path: Path) -> Environment:
    """The environment of an existing file, one user more.

    Raises:
        CacheError: no cache there, truncated, foreign or unreadable.
    """
    data = path / DATA_FILE
    if not path.is_dir() or not data.is_file():
        raise CacheError(
            f"{path}: {'no ' + DATA_FILE + ' in it, so it is' if path.is_dir() else 'is'} not a nurbs-ooc cache"
        )
    with _registry_lock:
        environment = _registry.get(_identity(path))
        if environment is None:
            _check_whole_patiently(data)
            _close_left_by_fork(_identity(path))
            environment = Environment(path, create=False, map_bytes=0)
            _registry[environment.identity] = environment
        environment.users += 1
        return environment


def created(path: Path, *, map_bytes: int = FIRST_MAP_BYTES) -> Environment:
    """The environment of a new or empty cache at ``path``, locked for writing, one user.

    Raises:
        CacheError: something else is there, somebody writes to it, or it cannot be made.
    """
    _make_folder(path)
    with _registry_lock:
        if (path / DATA_FILE).exists() and _identity(path) in _registry:
            environment = shared(path)
            environment.lock_for_writing()
            return environment
        lock = lock_writer(path)
        try:
            if (path / DATA_FILE).exists():
                check_whole(path / DATA_FILE)
            environment = Environment(path, create=True, map_bytes=map_bytes)
        except BaseException:
            os.close(lock)
            raise
        environment.take_lock(lock)
        environment.users = 1
        _registry[environment.identity] = environment
        return environment


def lock_writer(path: Path) -> int:
    """Lock ``writer.lock`` in ``path``; the lock lives as long as the descriptor.

    Raises:
        CacheError: another process holds it, or the folder cannot be written.
    """
    try:
        descriptor = os.open(path / WRITER_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise CacheError(f"{path}: cannot be opened for writing: {error.strerror}") from error
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
    except OSError as error:
        holder = os.pread(descriptor, 32, 0).decode("ascii", "replace").strip()
        os.close(descriptor)
        if isinstance(error, BlockingIOError | PermissionError):
            raise CacheError(f"{path}: process {holder} is writing to it; wait for it or stop it") from error
        raise CacheError(f"{path}: cannot be locked for writing: {error.strerror}") from error
    return descriptor


def _open_lmdb(path: Path, *, create: bool, map_bytes: int) -> lmdb.Environment:
    """Open with write access where we have it, so that a writer of this process can share it."""
    writable = create or (os.access(path / DATA_FILE, os.W_OK) and os.access(path, os.W_OK))
    options: dict[str, Any] = {
        "max_dbs": len(TABLES),
        "max_readers": MAX_READERS,
        "metasync": False,  # a power cut may take back the last transaction, never half of one
        "meminit": False,
    }
    try:
        if writable:
            return lmdb.open(str(path), map_size=map_bytes, readahead=True, create=create, **options)
        return lmdb.open(str(path), map_size=map_bytes, readonly=True, lock=False, create=False, **options)
    except lmdb.Error as error:
        raise CacheError(f"{path}: cannot be opened: {error}") from error


def _why(error: lmdb.Error, path: Path) -> str:
    """LMDB calls a full disk and a limit on the size of files an input/output error."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if shutil.disk_usage(path).free < FULL_DISK_BYTES:
        return "its disk is full"
    if limit not in (resource.RLIM_INFINITY, -1):
        return f"{error}; this process may write files of {limit} bytes at most"
    return str(error)


def _refuse_foreign(env: lmdb.Environment, path: Path) -> None:
    """Refuse an LMDB file with anything but our tables, before a table of ours is made in it."""
    with env.begin() as transaction:
        for key in transaction.cursor().iternext(keys=True, values=False):
            if bytes(key) not in {name.encode() for name in TABLES}:
                raise CacheError(f"{path}: an LMDB file, but not a nurbs-ooc cache: it holds {bytes(key)[:40]!r}")


def _check_whole_patiently(data: Path) -> None:
    for attempt in range(_TRIES):
        try:
            check_whole(data)
            return
        except CacheError:
            if attempt == _TRIES - 1:
                raise
            time.sleep(_PAUSE_S)


def _make_folder(path: Path) -> None:
    """Make the folder of a new cache; one that holds anything but a cache is refused."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        entries = {entry.name for entry in path.iterdir()}
    except OSError as error:
        raise CacheError(f"{path}: cannot be made: {error.strerror}") from error
    foreign = sorted(entries - {DATA_FILE, "lock.mdb", WRITER_FILE})
    if foreign:
        raise CacheError(f"{path}: not empty and not a nurbs-ooc cache: it holds {foreign[0]!r}")


def _identity(path: Path) -> tuple[int, int]:
    """Device and inode of the data file: another file under the same name is another environment."""
    status = (path / DATA_FILE).stat()
    return status.st_dev, status.st_ino


def _close_left_by_fork(identity: tuple[int, int]) -> None:
    """Close the copy that a fork left here: LMDB opens a file once, and a closed copy is the parent's no less."""
    for environment in [left for left in _left_by_fork if left.identity == identity]:
        environment.env.close()
        _left_by_fork.remove(environment)


def _forget_after_fork() -> None:
    """In a forked child: the parent's environments and locks are not ours."""
    global _registry_lock
    _left_by_fork.extend(_registry.values())
    _registry.clear()
    _registry_lock = threading.RLock()


os.register_at_fork(after_in_child=_forget_after_fork)
