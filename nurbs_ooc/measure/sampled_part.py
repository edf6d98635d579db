"""Parts of a store with samples on their surfaces: drawn once, used against every tile that shows them."""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.measure.exact_surface import points
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.foot_point import FootFinder
from nurbs_ooc.measure.trim_region import TrimRegion

UNUSABLE = [int(r) for r in (FaceReason.NOT_FINITE, FaceReason.BAD_WEIGHTS, FaceReason.BAD_KNOTS)]
KEPT_PARTS = 64  # parts with their samples in memory at once


class PartSource(Protocol):
    """What is needed of a store."""

    def get_part(self, index: int) -> GeometryBatch:
        """Geometry of a part."""


class SampledPart:
    """One part and samples of all its usable surfaces.

    Args:
        geometry: the part.
        tolerance: mm; how straight the boundary segments are.
        per_face: samples a surface.
        seed: of the samples.

    Attributes:
        region: the usable surfaces' trimmed regions.
        samples: of all of them; ``first[f]:first[f + 1]`` are those of face f.
        face_of_row: index in the region by row of the part, -1 for surfaces nobody can evaluate.
    """

    def __init__(self, geometry: GeometryBatch, tolerance: float, per_face: int, seed: int) -> None:
        self.geometry, self.tolerance = geometry, tolerance
        usable = np.flatnonzero(~np.isin(geometry.surfaces["reason"], UNUSABLE))
        self.region = TrimRegion(geometry, usable, tolerance)
        self.samples = sample_faces(self.region, per_face, seed)
        self.first = np.searchsorted(self.samples.face, np.arange(len(usable) + 1))
        self.face_of_row = np.full(len(geometry), -1, np.int64)
        self.face_of_row[usable] = np.arange(len(usable))

    @cached_property
    def finder(self) -> FootFinder:
        """Finds feet on the part's surfaces."""
        return FootFinder(self.region, self.samples)

    def points(self, face: npt.NDArray[np.int64], uv: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(n, 3) exact points of faces (indices in the region), part space."""
        return points(self.geometry, self.region.faces[face], uv)


class SampledParts:
    """The parts of a store, sampled when first asked for; the ones used last stay in memory.

    Args:
        store: where the parts are.
        tolerance: (n_parts,) mm, see ``SampledPart``.
        per_face: samples a surface.
        seed: each part's samples follow from it and the part's index alone.
    """

    def __init__(self, store: PartSource, tolerance: npt.NDArray[np.float64], per_face: int, seed: int) -> None:
        self._store, self._tolerance, self._per_face, self._seed = store, tolerance, per_face, seed
        self._kept: OrderedDict[int, SampledPart] = OrderedDict()

    def __getitem__(self, part: int) -> SampledPart:
        if part not in self._kept:
            seed = self._seed * 1_000_003 + part
            geometry = self._store.get_part(part)
            self._kept[part] = SampledPart(geometry, float(self._tolerance[part]), self._per_face, seed)
            while len(self._kept) > KEPT_PARTS:
                self._kept.popitem(last=False)
        self._kept.move_to_end(part)
        return self._kept[part]
