"""Files of tessellations, one for each run of surfaces, and reading back the few that a node needs.

Layout, little-endian::

     0   8  magic "NFRAGS01"         16   .  slots: SLOT_DTYPE, ascending keys, first_word counted from the words
     8   4  number of slots           .   .  words of the meshes
    12   4  crc32 of the slots

Every mesh has its own checksum, so that reading one proves nothing else and costs nothing else.
"""

from __future__ import annotations

import itertools
import os
import struct
import zlib
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_ooc.build.mesh_demand import SURFACE_MASK, Keys, key_surfaces
from nurbs_ooc.build.spill import new_file
from nurbs_ooc.build.surface_runs import SurfaceRun
from nurbs_ooc.hlod.mesh_pool import SLOT_DTYPE, MeshPool, slot_words

MAGIC = b"NFRAGS01"
_HEAD = struct.Struct("<8sII")
WORD = 8  # bytes
TABLES_KEPT = 64  # slot tables of files that were read last; some 0.3 MB each


def write_fragments(path: Path, pools: Sequence[MeshPool]) -> npt.NDArray[np.void]:
    """Write meshes, their keys ascending through all ``pools``; returns the slots.

    Raises:
        CacheError: it cannot be written.
    """
    slots = np.concatenate([np.zeros(0, SLOT_DTYPE), *(pool.slots for pool in pools)])
    slots["first_word"] += np.repeat(
        np.cumsum([0, *(len(pool.words) for pool in pools)])[:-1], [len(pool) for pool in pools]
    )
    table = slots.tobytes()
    with new_file(path) as file:
        file.write(_HEAD.pack(MAGIC, len(slots), zlib.crc32(table)))
        file.write(table)
        for pool in pools:
            file.write(pool.words.data)
    return slots


def read_slots(path: Path) -> npt.NDArray[np.void]:
    """The slots of a file.

    Raises:
        CorruptRecordError: damaged or foreign.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
        magic, count, checksum = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0, 0)
        table = file.read(count * SLOT_DTYPE.itemsize)
    if magic != MAGIC or len(table) != count * SLOT_DTYPE.itemsize or zlib.crc32(table) != checksum:
        raise _damaged(path, "its table of meshes")
    return np.frombuffer(table, SLOT_DTYPE)


def checked_slots(path: Path) -> npt.NDArray[np.void]:
    """The slots of a file, after every mesh in it has been compared with its checksum.

    Raises:
        CorruptRecordError: damaged or foreign.
    """
    slots = read_slots(path)
    with path.open("rb") as file:
        file.seek(_HEAD.size + slots.nbytes)
        for slot, size in zip(slots, slot_words(slots).tolist(), strict=True):
            if zlib.crc32(file.read(size * WORD)) != slot["checksum"]:
                raise _damaged(path, f"the mesh of surface {key_surfaces(slot['key'])}")
    return slots


def _damaged(path: Path, what: str) -> CorruptRecordError:
    return CorruptRecordError(f"{path}: damaged: {what} does not match its checksum; --resume makes it anew")


class FragmentShelf:
    """Finds meshes in the files of a folder.

    Args:
        folder: of the files.
        runs: the runs of all surfaces, ascending.
    """

    def __init__(self, folder: Path, runs: Sequence[SurfaceRun]) -> None:
        self._folder = folder
        self._runs = runs
        self._first = np.array([run.first_surface for run in runs], np.uint64)
        self._tables: OrderedDict[int, npt.NDArray[np.void]] = OrderedDict()

    def path_of(self, run: SurfaceRun) -> Path:
        """The file of a run."""
        return self._folder / f"{run.name}.meshes"

    def pool(self, keys: Keys) -> MeshPool:
        """The meshes ``keys`` (ascending); slot ``i`` is that of ``keys[i]``.

        Raises:
            CorruptRecordError: a file or a mesh in it is damaged or missing.
        """
        run_of = np.searchsorted(self._first, keys & SURFACE_MASK, side="right") - 1
        slots = np.zeros(len(keys), SLOT_DTYPE)
        for run in np.unique(run_of).tolist():
            wanted = np.flatnonzero(run_of == run)
            table = self._table(run)
            at = np.searchsorted(table["key"], keys[wanted])
            found = table[np.minimum(at, len(table) - 1)]
            if (found["key"] != keys[wanted]).any():
                raise CorruptRecordError(f"{self.path_of(self._runs[run])}: lacks meshes that its run needs")
            slots[wanted] = found
        return self._load(run_of, slots)

    def _table(self, run: int) -> npt.NDArray[np.void]:
        """Slots of a file, ``first_word`` counted from the start of the file."""
        if run in self._tables:
            self._tables.move_to_end(run)
            return self._tables[run]
        path = self.path_of(self._runs[run])
        try:
            table = read_slots(path).copy()
        except OSError as error:
            raise CorruptRecordError(f"{path}: cannot be read: {error.strerror}") from error
        table["first_word"] += (_HEAD.size + table.nbytes) // WORD
        self._tables[run] = table
        while len(self._tables) > TABLES_KEPT:
            self._tables.popitem(last=False)
        return table

    def _load(self, run_of: npt.NDArray[np.int64], slots: npt.NDArray[np.void]) -> MeshPool:
        """Read the words of ``slots``, neighbours in a file in one go."""
        sizes = slot_words(slots)
        starts = np.cumsum(sizes) - sizes
        words = np.empty(int(sizes.sum()), np.uint64)
        follows = (np.diff(run_of) == 0) & (slots["first_word"][1:] == slots["first_word"][:-1] + sizes[:-1])
        cuts = [0, *(np.flatnonzero(~follows) + 1).tolist(), len(slots)]
        descriptors: dict[int, int] = {}
        try:
            for low, high in itertools.pairwise(cuts):
                if low == high:
                    continue
                run = int(run_of[low])
                if run not in descriptors:
                    descriptors[run] = os.open(self.path_of(self._runs[run]), os.O_RDONLY)
                target = words[starts[low] : starts[high - 1] + sizes[high - 1]]
                n_read = os.preadv(descriptors[run], [target.data], int(slots["first_word"][low]) * WORD)
                if n_read != target.nbytes:
                    raise _damaged(self.path_of(self._runs[run]), "its length")
        finally:
            for descriptor in descriptors.values():
                os.close(descriptor)
        slots["first_word"] = starts
        for i, (start, size, checksum) in enumerate(
            zip(starts.tolist(), sizes.tolist(), slots["checksum"].tolist(), strict=True)
        ):
            if zlib.crc32(words[start : start + size].data) != checksum:
                raise _damaged(
                    self.path_of(self._runs[int(run_of[i])]), f"the mesh of surface {key_surfaces(slots['key'])[i]}"
                )
        return MeshPool(slots, words)
