"""The content of one node: all surfaces of its subtree at its error, simplified, with the ledger.

Surfaces smaller than the error become one point in the middle of their box with their average normal;
half the box's diagonal is charged as their chord error. The others come from the mesh pool. Everything
is then clustered and reduced to primitives (see ``cluster`` and ``primitives``).

Source: M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", 3.3, 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.ledger import Ledger
from nurbs_cache.tile import TileContent
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hlod.budget import NodeBudget
from nurbs_ooc.hlod.cluster import cluster_vertices
from nurbs_ooc.hlod.mesh_pool import MeshPool, place
from nurbs_ooc.hlod.primitives import simplify
from nurbs_ooc.hlod.soup import Soup

COARSENING = 2.0**0.5  # steps of a node's cell; a smaller one gains little, a larger one overshoots
FEWEST = 256  # primitives; eight cells, as a grid of huge cells has, make fewer


def diagonals(items: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
    """(n,) diagonals of the boxes of ``ITEM_DTYPE`` rows, mm."""
    return np.asarray(np.linalg.norm(items["aabb_max"] - items["aabb_min"], axis=1))


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Surfaces that are shown as one point each.

    Attributes:
        positions: (n, 3) float64, mm: the middles of their boxes.
        normals: (n, 3) float32: their average normals.
        reach: mm: half the largest diagonal of their boxes.
    """

    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    reach: float

    @classmethod
    def of_items(cls, items: npt.NDArray[np.void]) -> SurfacePoints:
        """From ``ITEM_DTYPE`` rows."""
        middles = 0.5 * items["aabb_min"] + 0.5 * items["aabb_max"]
        return cls(middles, items["normal"], 0.5 * float(diagonals(items).max(initial=0.0)))


@dataclass(frozen=True, eq=False)
class PlacedMeshes:
    """The items of a node that are larger than the error, with their meshes.

    Attributes:
        items: (n,) ``ITEM_DTYPE``.
        slots: (n,) ``SLOT_DTYPE``: the mesh of each; one without vertices becomes a point.
        occurrence: (n,) int64 row of each in the occurrences.
        errors: (n, 3) surface, trim and p-curve error of each, mm, assembly space.
    """

    items: npt.NDArray[np.void]
    slots: npt.NDArray[np.void]
    occurrence: npt.NDArray[np.int64]
    errors: npt.NDArray[np.float64]

    @classmethod
    def of(cls, items: npt.NDArray[np.void], slots: npt.NDArray[np.void], placements: Placements) -> PlacedMeshes:
        """From the items and their slots."""
        occurrence = items["occurrence"].astype(np.int64)
        return cls(items, slots, occurrence, slots["errors"] * placements.stretch[occurrence, None])

    def __getitem__(self, rows: slice | npt.NDArray[np.bool_]) -> PlacedMeshes:
        return PlacedMeshes(self.items[rows], self.slots[rows], self.occurrence[rows], self.errors[rows])


def node_content(
    meshes: PlacedMeshes,
    points: SurfacePoints,
    pool: MeshPool,
    placements: Placements,
    origin: npt.NDArray[np.float64],
    budget: NodeBudget,
    most: int,
) -> TileContent:
    """Assemble one node.

    Args:
        meshes: the items of the subtree that are larger than the error.
        points: the other items.
        pool: meshes in part space.
        placements: one row per occurrence.
        origin: (3,) corner of the clustering grid, mm.
        budget: of the node's level.
        most: triangles, lines and points together that the node may have; where the budget gives more, its
            clustering is coarsened until they fit, and what that costs is charged.
    """
    drawn = meshes.slots["n_vertices"] > 0
    parts = [points]
    if not drawn.all():
        parts.append(SurfacePoints.of_items(meshes.items[~drawn]))
        meshes = meshes[drawn]
    n_points = sum(len(part.positions) for part in parts)
    soup = place(pool, meshes.slots, placements, meshes.occurrence, n_points)
    _fill_points(soup, parts)
    simple, moved = reduced(soup, origin, budget, most)
    return TileContent(
        simple.positions,
        simple.normals,
        simple.triangles.view(np.uint32),
        simple.lines.view(np.uint32),
        simple.points.view(np.uint32),
        _ledger(meshes.errors, max(part.reach for part in parts), moved),
    )


def reduced(soup: Soup, origin: npt.NDArray[np.float64], budget: NodeBudget, most: int) -> tuple[Soup, float]:
    """Cluster and simplify until there are at most ``most`` primitives; also how far any moved, mm.

    A surface's primitives become fewer with the square of the cell: the first guess is usually the last. It ends,
    for all that is in cells larger than the whole is a handful of primitives.
    """
    factor = 1.0
    while True:
        tried = budget if factor == 1.0 else budget.coarser(factor)
        clusters = cluster_vertices(soup.positions, soup.normals, origin, tried.cell)
        simple, moved = simplify(soup, clusters, tried.small_area, tried.allowance)
        excess = (len(simple.triangles) + len(simple.lines) + len(simple.points)) / max(most, FEWEST)
        if excess <= 1.0:
            return simple, moved
        reached = factor
        while factor < reached * np.sqrt(excess):
            factor *= COARSENING


def _fill_points(soup: Soup, parts: list[SurfacePoints]) -> None:
    """Write points to the last vertices of a soup."""
    at = len(soup.positions) - sum(len(part.positions) for part in parts)
    for part in parts:
        end = at + len(part.positions)
        soup.positions[at:end], soup.normals[at:end] = part.positions, part.normals
        at = end


def _ledger(errors: npt.NDArray[np.float64], worst_point: float, moved: float) -> Ledger:
    """The terms of the surface whose error is largest, and how far its primitives moved at most.

    A maximum of each term by itself would add up terms of different surfaces to more than any has.

    Args:
        errors: (n, 3) surface, trim and p-curve error of each mesh, mm, assembly space.
        worst_point: mm: the largest distance of a surface to the point that stands for it.
        moved: mm.
    """
    totals = errors[:, 0] + errors[:, 1] + errors[:, 2]
    worst = int(totals.argmax()) if len(totals) else -1
    if worst < 0 or worst_point >= totals[worst]:
        return Ledger(surface=worst_point, cluster=moved)
    surface, trim, pcurve = errors[worst].tolist()
    return Ledger(surface, trim, pcurve, moved)
