"""Which meshes the nodes need of some surfaces, worked out when asked: for those who build a few nodes of many."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.build import tunables
from nurbs_ooc.build.mesh_demand import Keys, MeshDemand, mesh_keys
from nurbs_ooc.hlod.budget import NodeBudget
from nurbs_ooc.hlod.node import diagonals


class SurfaceDemand(MeshDemand):
    """The same answers as the demand of all nodes; each costs what the asked surfaces' items and ancestors do.

    Args:
        nodes, items: the tables as stored; changes to them show.
        stretch: of each occurrence.
        by_surface: (n,) rows of the items, ascending surface ids.
    """

    def __init__(
        self,
        nodes: npt.NDArray[np.void],
        items: npt.NDArray[np.void],
        stretch: npt.NDArray[np.float64],
        by_surface: npt.NDArray[np.int64],
    ) -> None:
        super().__init__(np.zeros(0, np.uint64))
        self._nodes, self._items, self._stretch, self._by_surface = nodes, items, stretch, by_surface
        self._ids = items["surface"][by_surface]

    def of_surfaces(self, first: int, count: int) -> Keys:
        """The keys of the surfaces ``first`` to ``first + count``, ascending."""
        low, high = np.searchsorted(self._ids, np.array([first, first + count], np.uint64))
        rows = self._by_surface[low:high]
        surfaces, node = self._items["surface"][rows], self._items["node"][rows]
        diagonal, scale = diagonals(self._items[rows]), self._stretch[self._items["occurrence"][rows]]
        found = [np.zeros(0, np.uint64)]
        while len(node):
            levels = self._nodes["level"][node]
            for level in np.unique(levels).tolist():
                budget = NodeBudget.of_level(level, tunables.SHARES)
                here = (levels == level) & (diagonal > budget.point_diagonal)
                found.append(mesh_keys(surfaces[here], budget.surface_levels(diagonal[here], scale[here])))
            node = self._nodes["parent"][node]
            inner = node >= 0
            node, surfaces, diagonal, scale = node[inner], surfaces[inner], diagonal[inner], scale[inner]
        return np.unique(np.concatenate(found))
