"""How the error budget of a node is shared between its sources.

A node of level L may show an error of ε = 2**L mm. It is drawn when ε projects to half a pixel, so a
pixel is 2 ε wide there::

    ε = tessellation + clustering and points + quantisation
      =     ε / 2    +          rest         +   ε / 100

The tessellation's share is a power of two, so that its meshes lie on the ladder and are shared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

PIXEL = 2.0  # errors: a node is drawn while its error is at most half a pixel
SMALL_AREA_PX = 3.0  # pixels: triangles up to it may become points (paper 004, 3.4)
HALF_DIAGONAL = np.sqrt(3.0) / 2.0  # of a unit cell: the furthest that clustering moves a vertex
SAME_LEVEL = 1e-6  # levels: a scale this close to a power of two counts as one (rotations are never exact)


@dataclass(frozen=True)
class Shares:
    """Fractions of a node's error budget.

    Attributes:
        tessellation_levels: how many levels finer than the node its surfaces are tessellated.
        quantisation: kept for the tile's encoding.
        point_diagonal: surfaces whose box diagonal is at most this become one point.
        coarsest_mesh: levels that a mesh's error stays below the diagonal of its surface.
    """

    tessellation_levels: int
    quantisation: float
    point_diagonal: float
    coarsest_mesh: int


@dataclass(frozen=True)
class NodeBudget:
    """The budget of one level in millimetres.

    Attributes:
        error: the whole, 2**level.
        tessellation_level: ladder level of the chord error in assembly space.
        coarsest_mesh: levels that the chord error stays below the diagonal of the surface.
        point_diagonal: surfaces with at most this box diagonal become one point.
        allowance: the furthest that clustering and points may move a primitive.
        cell: edge of a clustering cell whose half diagonal is the allowance.
        small_area: mm²; larger triangles never become points.
    """

    error: float
    tessellation_level: int
    coarsest_mesh: int
    point_diagonal: float
    allowance: float
    cell: float
    small_area: float

    @classmethod
    def of_level(cls, level: int, shares: Shares) -> NodeBudget:
        """Share out 2**level mm."""
        error = 2.0**level
        allowance = error * (1.0 - 2.0**-shares.tessellation_levels - shares.quantisation)
        return cls(
            error,
            level - shares.tessellation_levels,
            shares.coarsest_mesh,
            error * shares.point_diagonal,
            allowance,
            allowance / HALF_DIAGONAL,
            SMALL_AREA_PX * (PIXEL * error) ** 2,
        )

    def coarser(self, factor: float) -> NodeBudget:
        """Clustering that moves primitives ``factor`` times as far; the tessellation stays."""
        return replace(
            self,
            error=self.error * factor,
            allowance=self.allowance * factor,
            cell=self.cell * factor,
            small_area=self.small_area * factor**2,
        )

    def surface_levels(
        self, diagonal: npt.NDArray[np.floating], scale: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.int64]:
        """Ladder levels in surface space of placed surfaces that become meshes.

        Args:
            diagonal: of their boxes, mm, > 0.
            scale: by how much the placement stretches lengths, > 0.
        """
        coarsest = np.floor(np.log2(diagonal)) - self.coarsest_mesh
        return np.floor(np.minimum(self.tessellation_level, coarsest) - np.log2(scale) + SAME_LEVEL).astype(np.int64)
