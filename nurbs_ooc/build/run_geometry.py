"""The surfaces of a run, and what stands beside them, as one batch.

Most parts of an assembly have a few dozen surfaces, and what a call of the tessellator costs by itself is the
same for a dozen as for a thousand: so all parts of a run go through it together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.surface_runs import PartSlice, geometry_around
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.tessellation.tessellate import smallest_error

Ids = npt.NDArray[np.int64]


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
    def load(cls, store: TypedStore, slices: Sequence[PartSlice], surfaces: Ids) -> RunGeometry:
        """Read what the meshes of some surfaces depend on.

        Args:
            store: has the parts.
            slices: where the surfaces lie, ascending.
            surfaces: ids in these slices, ascending, at least one.
        """
        parts, ids, smallest = [], [], []
        for piece in slices:
            low, high = np.searchsorted(surfaces, [piece.first_surface, piece.first_surface + piece.n_surfaces])
            if low == high:
                continue
            part = store.get_part(piece.part)
            kept = np.arange(len(part))
            error = smallest_error(part)
            if 2 * (high - low) < len(part):
                part, kept = geometry_around(part, surfaces[low:high] - piece.first_of_part)
            parts.append(part)
            ids.append(piece.first_of_part + kept)
            smallest.append(np.full(len(part), error))
        return cls(join_parts(parts), np.concatenate(ids), np.concatenate(smallest))

    def rows_of(self, surfaces: Ids) -> Ids:
        """Rows of those ``surfaces`` that are here, ascending."""
        rows = np.searchsorted(self.surfaces, surfaces)
        here = self.surfaces[np.minimum(rows, len(self.surfaces) - 1)] == surfaces
        return rows[here]
