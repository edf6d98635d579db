"""The trees of a build in memory: what each node needs, and how the nodes are cut into jobs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.mesh_demand import MeshDemand, mesh_keys
from nurbs_ooc.build.surface_demand import SurfaceDemand
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hierarchy.runs import run_rows
from nurbs_ooc.hlod.budget import NodeBudget
from nurbs_ooc.hlod.node import SurfacePoints, diagonals

Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class NodeNeeds:
    """What the tiles of some nodes of one level show, short enough to be sent.

    Attributes:
        nodes: (n,) ``NODE_DTYPE``.
        items: ``ITEM_DTYPE``, those larger than the error, node by node.
        first_item: (n + 1,) where each node's begin.
        positions, normals: of the others, which become points, node by node; see ``SurfacePoints``.
        first_point: (n + 1,) where each node's begin.
        reach: (n,) mm, of each node's points.
    """

    nodes: npt.NDArray[np.void]
    items: npt.NDArray[np.void]
    first_item: Rows
    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    first_point: Rows
    reach: npt.NDArray[np.float64]

    def rows_of(self, node: int) -> slice:
        """Rows of a node's items."""
        return slice(int(self.first_item[node]), int(self.first_item[node + 1]))

    def points_of(self, node: int) -> SurfacePoints:
        """A node's points."""
        own = slice(int(self.first_point[node]), int(self.first_point[node + 1]))
        return SurfacePoints(self.positions[own], self.normals[own], float(self.reach[node]))


@dataclass(frozen=True, eq=False)
class Forest:
    """The tables that tiles are made from.

    Attributes:
        nodes, items: as stored.
        placements: one row per occurrence.
    """

    nodes: npt.NDArray[np.void]
    items: npt.NDArray[np.void]
    placements: Placements

    @classmethod
    def load(cls, store: TypedStore) -> Forest:
        """Read the tables of a store whose trees are built."""
        placements = Placements.of_transforms(store.get_occurrences()["transform"])
        return cls(store.get_nodes(), store.get_items(), placements)

    def needs(self, rows: Rows) -> NodeNeeds:
        """What the tiles of nodes of one level show."""
        nodes = self.nodes[rows]
        budget = NodeBudget.of_level(int(nodes["level"][0]), tunables.SHARES)
        items = run_rows(nodes["first_item"], nodes["n_items"])
        node_of = np.repeat(np.arange(len(nodes)), nodes["n_items"])
        meshed = self._diagonals[items] > budget.point_diagonal
        as_points = items[~meshed]
        reach = np.zeros(len(nodes))
        np.maximum.at(reach, node_of[~meshed], 0.5 * self._diagonals[as_points])
        return NodeNeeds(
            nodes,
            self.items[items[meshed]],
            np.searchsorted(node_of[meshed], np.arange(len(nodes) + 1)),
            0.5 * self.items["aabb_min"][as_points] + 0.5 * self.items["aabb_max"][as_points],
            self.items["normal"][as_points],
            np.searchsorted(node_of[~meshed], np.arange(len(nodes) + 1)),
            reach,
        )

    def items_of(self, surface_id: int) -> Rows:
        """Rows of the items of a surface, ascending."""
        low, high = np.searchsorted(
            self.items["surface"], np.array([surface_id, surface_id + 1], np.uint64), sorter=self._by_surface
        )
        return self._by_surface[low:high]

    def replace(self, rows: Rows, items: npt.NDArray[np.void], node_rows: Rows, nodes: npt.NDArray[np.void]) -> None:
        """Other boxes of some items, and what follows for their nodes; surfaces and places stay."""
        self.items[rows], self.nodes[node_rows] = items, nodes
        self._diagonals[rows] = diagonals(items)
        self.__dict__.pop("demand", None)

    @cached_property
    def _by_surface(self) -> Rows:
        return np.argsort(self.items["surface"], kind="stable")

    @cached_property
    def surface_demand(self) -> SurfaceDemand:
        """What all nodes need, for those who ask for some surfaces only."""
        return SurfaceDemand(self.nodes, self.items, self.placements.stretch, self._by_surface)

    @cached_property
    def _diagonals(self) -> npt.NDArray[np.float64]:
        return diagonals(self.items)

    @cached_property
    def demand(self) -> MeshDemand:
        """The meshes that the tiles of all nodes need."""
        return self.demand_of(np.arange(len(self.nodes)))

    def demand_of(self, rows: Rows) -> MeshDemand:
        """The meshes that the tiles of nodes need."""
        needed = [np.zeros(0, np.uint64)]
        for level, here in by_level(self.nodes, rows):
            budget = NodeBudget.of_level(level, tunables.SHARES)
            items = run_rows(self.nodes["first_item"][here], self.nodes["n_items"][here])
            items = items[self._diagonals[items] > budget.point_diagonal]
            scale = self.placements.stretch[self.items["occurrence"][items]]
            needed.append(
                np.unique(mesh_keys(self.items["surface"][items], budget.surface_levels(self._diagonals[items], scale)))
            )
        return MeshDemand(np.unique(np.concatenate(needed)))

    def jobs(self, rows: Rows) -> Iterator[Rows]:
        """Cut nodes into jobs of one level each, coarse levels first, of bounded numbers of meshes and items."""
        for level, here in by_level(self.nodes, rows):
            budget = NodeBudget.of_level(level, tunables.SHARES)
            n_items = self.nodes["n_items"][here]
            meshed = self._diagonals[run_rows(self.nodes["first_item"][here], n_items)] > budget.point_diagonal
            n_meshed = np.bincount(np.repeat(np.arange(len(here)), n_items)[meshed], minlength=len(here))
            shares = np.maximum(n_meshed / tunables.MESHES_PER_JOB, n_items / tunables.ITEMS_PER_JOB)
            total = np.concatenate([[0.0], np.cumsum(shares)])
            low = 0
            while low < len(here):
                high = max(low + 1, int(np.searchsorted(total, total[low] + 1.0, side="right")) - 1)
                yield here[low:high]
                low = high


def by_level(nodes: npt.NDArray[np.void], rows: Rows) -> Iterator[tuple[int, Rows]]:
    """Each level among ``rows``, coarse ones first, with its rows, ascending."""
    levels = nodes["level"][rows]
    for level in np.unique(levels)[::-1].tolist():
        yield level, np.sort(rows[levels == level])
