"""The surfaces of a run, and what stands beside them, as one batch.

Most parts of an assembly have a few dozen surfaces, and what a call of the tessellator costs by itself is the
same for a dozen as for a thousand: so all parts of a run go through it together, unless they are very large.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.surface_runs import PartSlice, geometry_around
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.tessellation.tessellate import smallest_error

Ids = npt.NDArray[np.int64]

Loaded = list[tuple[PartSlice, GeometryBatch]]


def part_batches(store: TypedStore, slices: Sequence[PartSlice]) -> Iterator[Loaded]:
    """Slices with their parts, whole as stored, so many at a time that ``tunables.BATCH_BYTES`` bound the slices.

    Args:
        store: has the parts.
        slices: those of a run; one that is too large by itself comes in pieces.
    """
    batch: Loaded = []
    n_bytes = 0.0
    for piece in slices:
        part = store.get_part(piece.part)
        own = part.values.nbytes * piece.n_surfaces / piece.n_part
        cuts = piece.cut(math.ceil(own / tunables.BATCH_BYTES) or 1)
        for cut in cuts:
            if batch and n_bytes + own / len(cuts) > tunables.BATCH_BYTES:
                yield batch
                batch, n_bytes = [], 0.0
            batch.append((cut, part))
            n_bytes += own / len(cuts)
    if batch:
        yield batch


@dataclass(frozen=True, eq=False)
class RunGeometry:
    """Surfaces of one or more parts.

    Attributes:
        geometry: their records, part after part.
        surfaces: (n,) the id of each, ascending.
        smallest: (n,) mm, the smallest chord error that the coordinates of each one's part can keep.
    """

    geometry: GeometryBatch
    surfaces: Ids
    smallest: npt.NDArray[np.float64]

    @classmethod
    def batches(cls, store: TypedStore, slices: Sequence[PartSlice], surfaces: Ids) -> Iterator[tuple[Self, Ids]]:
        """Read what the meshes of some surfaces depend on.

        Args:
            store: has the parts.
            slices: where the surfaces lie, ascending.
            surfaces: ids in these slices, ascending.

        Yields:
            Some of the surfaces with those beside them, and their ids.
        """
        asked = [piece for piece in slices if len(_among(surfaces, piece))]
        for loaded in part_batches(store, asked):
            near = [(piece, part, _among(surfaces, piece)) for piece, part in loaded]
            near = [entry for entry in near if len(entry[2])]
            if near:
                yield cls._of(near), np.concatenate([own for *_, own in near])

    @classmethod
    def _of(cls, wanted: Sequence[tuple[PartSlice, GeometryBatch, Ids]]) -> Self:
        parts, ids, smallest = [], [], []
        for piece, part, surfaces in wanted:
            near, kept = part, np.arange(len(part))
            if 4 * len(surfaces) < 3 * len(part):
                near, kept = geometry_around(part, surfaces - piece.first_of_part)
            parts.append(near)
            ids.append(piece.first_of_part + kept)
            smallest.append(np.full(len(near), smallest_error(part)))
        return cls(join_parts(parts), np.concatenate(ids), np.concatenate(smallest))

    def rows_of(self, surfaces: Ids) -> Ids:
        """Rows of those ``surfaces`` that are here, ascending."""
        rows = np.searchsorted(self.surfaces, surfaces)
        here = self.surfaces[np.minimum(rows, len(self.surfaces) - 1)] == surfaces
        return rows[here]


def _among(surfaces: Ids, piece: PartSlice) -> Ids:
    """Those of the ascending ids ``surfaces`` that lie in a slice."""
    low, high = np.searchsorted(surfaces, [piece.first_surface, piece.first_surface + piece.n_surfaces])
    return surfaces[low:high]
