"""What the workers of a build share: the store to read from, the folder for intermediate files, the cut into runs.

A ``Workshop`` is small and can be sent to another process; a ``Bench`` is one process's open view of it.
"""

from __future__ import annotations

import uuid
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nurbs_cache.store import Store
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.fragments import FragmentShelf
from nurbs_ooc.build.surface_runs import SurfaceRun, surface_runs
from nurbs_ooc.hierarchy.placements import Placements


@dataclass(frozen=True)
class Workshop:
    """Where the jobs of a build find their files.

    Attributes:
        store: folder of the store that is being built; workers only read it.
        spill: folder of the intermediate files.
        codec: entropy coder of the tiles.
        build: a name that no other build has, so that a worker that stays does not go on with an older store.
    """

    store: Path
    spill: Path
    codec: str
    build: str = field(default_factory=lambda: uuid.uuid4().hex)


class Bench:
    """A process's view of a workshop; its tables are read when they are first asked for.

    Args:
        shop: what to open.
        store: the store, if it is open already.
    """

    def __init__(self, shop: Workshop, store: TypedStore | None = None) -> None:
        self.shop = shop
        self.store: TypedStore = Store.open(shop.store) if store is None else store

    @cached_property
    def runs(self) -> list[SurfaceRun]:
        """The runs of surfaces that jobs and intermediate files are cut into."""
        return surface_runs(self.store.part_infos())

    @cached_property
    def occurrences(self) -> npt.NDArray[np.void]:
        """The occurrences of the scene."""
        return self.store.get_occurrences()

    @cached_property
    def _by_part(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Rows of the occurrences sorted by part, and where each part's begin."""
        rows = np.argsort(self.occurrences["part"], kind="stable")
        n_parts = len(self.store.part_infos())
        return rows, np.searchsorted(self.occurrences["part"][rows], np.arange(n_parts + 1))

    def occurrences_of(self, part: int) -> npt.NDArray[np.int64]:
        """Rows of the occurrences that place a part, ascending."""
        rows, first = self._by_part
        return rows[first[part] : first[part + 1]]

    @cached_property
    def placements(self) -> Placements:
        """How the occurrences place meshes."""
        return Placements.of_transforms(self.occurrences["transform"])

    @cached_property
    def shelf(self) -> FragmentShelf:
        """The meshes that are done, by run."""
        return FragmentShelf(self.shop.spill, self.runs)

    def rest(self) -> None:
        """Give back the memory of the store's pages that were read."""
        self.store.release_pages()

    def close(self) -> None:
        """Close the store."""
        self.store.close()


_bench: Bench | None = None


def opened(shop: Workshop) -> Bench:
    """This process's bench; one is open at a time."""
    global _bench
    if _bench is None or _bench.shop != shop:
        leave()
        _bench = Bench(shop)
    return _bench


def leave() -> None:
    """Close this process's bench."""
    global _bench
    if _bench is not None:
        _bench.close()
        _bench = None
