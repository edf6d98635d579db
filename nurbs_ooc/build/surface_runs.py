"""Cuts the surfaces of a scene into runs: the unit of work of the stages that go surface by surface.

A run is some whole parts, or a piece of a large part. The cut depends on the scene alone, so the files
of a run are found again when a build is resumed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import PartInfo
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build import tunables
from nurbs_ooc.geometry.soundness import sound_tables
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.geometry.tables import tables
from nurbs_ooc.tessellation.edge_uses import edge_uses, with_neighbours


@dataclass(frozen=True)
class PartSlice:
    """Some surfaces of a part.

    Attributes:
        part: its number.
        first_surface: id of the first of them.
        first_row, n_surfaces: rows in the part.
        n_part: surfaces of the whole part.
    """

    part: int
    first_surface: int
    first_row: int
    n_surfaces: int
    n_part: int

    def cut(self, n_pieces: int) -> list[PartSlice]:
        """The same surfaces in ``n_pieces``, or fewer where it has not so many."""
        n_pieces = min(n_pieces, self.n_surfaces)
        bounds = [self.n_surfaces * piece // n_pieces for piece in range(n_pieces + 1)]
        return [
            PartSlice(self.part, self.first_surface + low, self.first_row + low, high - low, self.n_part)
            for low, high in itertools.pairwise(bounds)
        ]

    @property
    def first_of_part(self) -> int:
        """Id of the part's first surface."""
        return self.first_surface - self.first_row

    @property
    def whole(self) -> bool:
        """Whether these are all of the part."""
        return self.n_surfaces == self.n_part


@dataclass(frozen=True)
class SurfaceRun:
    """Surfaces whose ids follow one another.

    Attributes:
        first_surface, n_surfaces: their ids.
        slices: where they lie.
    """

    first_surface: int
    n_surfaces: int
    slices: tuple[PartSlice, ...]

    @property
    def surfaces_of_parts(self) -> tuple[int, int]:
        """First id and number of the surfaces of all parts that it touches."""
        first = self.slices[0].first_of_part
        return first, self.slices[-1].first_of_part + self.slices[-1].n_part - first

    @property
    def name(self) -> str:
        """What its files are called."""
        return f"{self.first_surface:012d}"


def _slices(infos: Sequence[PartInfo]) -> list[PartSlice]:
    """All parts with surfaces in the order of surface ids, large ones in pieces."""
    order = sorted((i for i, info in enumerate(infos) if info.n_surfaces), key=lambda i: infos[i].first_surface)
    slices = []
    for part in order:
        first, n = infos[part].first_surface, infos[part].n_surfaces
        slices += PartSlice(part, first, 0, n, n).cut(max(1, n // tunables.SURFACES_PER_RUN))
    return slices


def surface_runs(infos: Sequence[PartInfo]) -> list[SurfaceRun]:
    """The runs of all surfaces, ascending."""
    runs: list[SurfaceRun] = []
    waiting: list[PartSlice] = []
    n_waiting = 0
    slices = _slices(infos)
    for number, piece in enumerate(slices):
        waiting.append(piece)
        n_waiting += piece.n_surfaces
        if n_waiting >= tunables.SURFACES_PER_RUN or number == len(slices) - 1:
            runs.append(SurfaceRun(waiting[0].first_surface, n_waiting, tuple(waiting)))
            waiting, n_waiting = [], 0
    return runs


def geometry_around(
    geometry: GeometryBatch, rows: npt.NDArray[np.int64]
) -> tuple[GeometryBatch, npt.NDArray[np.int64]]:
    """A part without what is far from some of its surfaces, and which of its rows are left.

    Kept are the surfaces that share an edge with one of ``rows`` and those that share an edge with one of
    these. The tessellation of ``rows`` stays as it is: it does the first ring too, and an edge is sampled
    as all surfaces beside it need.

    Args:
        geometry: the part.
        rows: ascending.
    """
    g = sound_tables(tables(geometry))
    uses = edge_uses(g)
    near = with_neighbours(g, uses, with_neighbours(g, uses, rows))
    return subset(geometry, near), near
