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


def node_content(
    items: npt.NDArray[np.void],
    slots: npt.NDArray[np.int64],
    points: SurfacePoints,
    pool: MeshPool,
    placements: Placements,
    origin: npt.NDArray[np.float64],
    budget: NodeBudget,
) -> TileContent:
    """Assemble one node.

    Args:
        items: (n,) ``ITEM_DTYPE``: the items of the subtree that are larger than the error.
        slots: (n,) the mesh of each in the pool; a mesh without vertices becomes a point.
        points: the other items.
        pool: meshes in part space.
        placements: one row per occurrence.
        origin: (3,) corner of the clustering grid, mm.
        budget: of the node's level.
    """
    drawn = pool.slots["n_vertices"][slots] > 0
    mesh_slots, occurrence = slots[drawn], items["occurrence"][drawn].astype(np.int64)
    without_mesh = SurfacePoints.of_items(items[~drawn])
    soup = _with_points(place(pool, mesh_slots, placements, occurrence), points, without_mesh)
    clusters = cluster_vertices(soup.positions, soup.normals, origin, budget.cell)
    simple, moved = simplify(soup, clusters, budget.small_area, budget.allowance)
    errors = pool.slots["errors"][mesh_slots] * placements.stretch[occurrence, None]
    ledger = _ledger(errors, max(points.reach, without_mesh.reach), moved)
    return TileContent(
        simple.positions,
        simple.normals,
        simple.triangles.astype(np.uint32),
        simple.lines.astype(np.uint32),
        simple.points.astype(np.uint32),
        ledger,
    )


def _with_points(soup: Soup, *points: SurfacePoints) -> Soup:
    """Append points to a soup."""
    n, n_points = len(soup.positions), sum(len(part.positions) for part in points)
    return Soup(
        np.concatenate([soup.positions, *(part.positions for part in points)]),
        np.concatenate([soup.normals, *(part.normals for part in points)]),
        soup.triangles,
        soup.lines,
        np.concatenate([soup.points, np.arange(n, n + n_points, dtype=np.int32)]),
    )


def _ledger(errors: npt.NDArray[np.float64], worst_point: float, moved: float) -> Ledger:
    """The terms of the surface whose error is largest, and how far its primitives moved at most.

    A maximum of each term by itself would add up terms of different surfaces to more than any has.

    Args:
        errors: (n, 3) surface, trim and p-curve error of each mesh, mm, assembly space.
        worst_point: mm: the largest distance of a surface to the point that stands for it.
        moved: mm.
    """
    if not len(errors) or worst_point >= errors.sum(axis=1).max():
        return Ledger(surface=worst_point, cluster=moved)
    surface, trim, pcurve = errors[errors.sum(axis=1).argmax()].tolist()
    return Ledger(surface, trim, pcurve, moved)
