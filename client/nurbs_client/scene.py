"""The scene as the client sees it: the tree's tables, unpacked once into plain arrays for the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CacheError
from nurbs_cache.scene_record import Material

FINEST_LEVELS = 18
"""LODs are not asked for below 2**-18 of a surface's longest edge, 4 micrometres on a metre: a sphere has half a
million triangles there, and who touches a surface with the eye would ask for more without end."""

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


class NodeArrays(NamedTuple):
    """The node table's columns that decide what is drawn; see ``NODE_DTYPE`` for their meaning."""

    aabb_min: Floats  # (n, 3)
    aabb_max: Floats  # (n, 3)
    error: Floats  # (n,) mm; raised if a tile turns out to be worse
    parent: Ints
    first_child: Ints
    n_children: Ints
    first_item: Ints
    n_direct: Ints
    level: Ints


class ItemArrays(NamedTuple):
    """The item table's columns that decide what is drawn."""

    aabb_min: Floats  # (n, 3)
    aabb_max: Floats  # (n, 3)
    scale: Floats  # (n,) largest stretch of the occurrence's transform
    finest: Ints  # (n,) ladder level below which the surface is not refined
    surface: Ints  # (n,) row in ``Scene.surface_ids``: items that place the same surface share it


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything but the tiles.

    Attributes:
        nodes: (n_nodes,) ``NODE_DTYPE``; items: (n_items,) ``ITEM_DTYPE``.
        transforms: (n_occurrences, 3, 4) part to assembly, mm.
        colours: (n_materials, 3) float32, linear 0 to 1.
        roots: rows of the nodes without a parent.
        surface_ids: sorted ids of all surfaces that are placed.
    """

    nodes: npt.NDArray[np.void]
    items: npt.NDArray[np.void]
    transforms: Floats
    colours: npt.NDArray[np.float32]
    roots: Ints
    surface_ids: npt.NDArray[np.uint64]
    node_arrays: NodeArrays
    item_arrays: ItemArrays

    @property
    def aabb(self) -> tuple[Floats, Floats]:
        """Corners of the box of everything, mm."""
        return self.node_arrays.aabb_min[self.roots].min(axis=0), self.node_arrays.aabb_max[self.roots].max(axis=0)

    @property
    def diagonal(self) -> float:
        """Length of that box's diagonal, mm."""
        low, high = self.aabb
        return float(np.linalg.norm(high - low))


def make_scene(
    nodes: npt.NDArray[np.void],
    items: npt.NDArray[np.void],
    occurrences: npt.NDArray[np.void],
    materials: list[Material],
) -> Scene:
    """Check the tables' references and unpack them.

    Raises:
        CacheError: the scene is empty, or a row points outside of its table.
    """
    roots = np.flatnonzero(nodes["parent"] < 0).astype(np.int32)
    if len(roots) == 0:
        raise CacheError("the scene has no nodes: nothing to draw")
    _check_references(nodes, items, len(occurrences))
    surface_ids, surface_rows = np.unique(items["surface"], return_inverse=True)
    colours = np.array([m.rgba[:3] for m in materials] or [(0.55, 0.57, 0.60)], dtype=np.float32)
    return Scene(
        nodes=nodes,
        items=items,
        transforms=np.ascontiguousarray(occurrences["transform"], dtype=np.float64).reshape(-1, 3, 4),
        colours=colours,
        roots=roots,
        surface_ids=surface_ids,
        node_arrays=_node_arrays(nodes),
        item_arrays=_item_arrays(items, surface_rows.astype(np.int32)),
    )


def _item_arrays(items: npt.NDArray[np.void], surface_rows: Ints) -> ItemArrays:
    scale = np.maximum(items["scale"].astype(np.float64), 1e-300)
    edges = (items["aabb_max"] - items["aabb_min"]).max(axis=1) / scale
    finest = np.floor(np.log2(np.maximum(edges, 1e-300))) - FINEST_LEVELS
    return ItemArrays(
        np.ascontiguousarray(items["aabb_min"]),
        np.ascontiguousarray(items["aabb_max"]),
        scale,
        np.clip(finest, -1000, 1000).astype(np.int32),
        surface_rows,
    )


def _node_arrays(nodes: npt.NDArray[np.void]) -> NodeArrays:
    return NodeArrays(
        np.ascontiguousarray(nodes["aabb_min"]),
        np.ascontiguousarray(nodes["aabb_max"]),
        np.ascontiguousarray(nodes["geometric_error"]),
        *(
            np.ascontiguousarray(nodes[name])
            for name in ("parent", "first_child", "n_children", "first_item", "n_direct", "level")
        ),
    )


def _check_references(nodes: npt.NDArray[np.void], items: npt.NDArray[np.void], n_occurrences: int) -> None:
    """Refuse tables that a kernel would follow out of bounds, or around in circles."""
    rows = np.arange(len(nodes))
    inner = nodes["n_children"] > 0
    holders = nodes["n_direct"] > 0
    faults = {
        "parent": (nodes["parent"] >= rows) | (nodes["parent"] < -1),
        "children": inner
        & ((nodes["first_child"] <= rows) | (nodes["n_children"] > len(nodes) - nodes["first_child"])),
        "items": holders & ((nodes["first_item"] < 0) | (nodes["n_direct"] > len(items) - nodes["first_item"])),
        "box": ~np.isfinite(nodes["aabb_min"]).all(axis=1) | ~np.isfinite(nodes["aabb_max"]).all(axis=1),
    }
    for name, bad in faults.items():
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise CacheError(f"node {row} ({nodes['key'][row].decode()}): its {name} lie outside of the tables")
    if len(items) and not ((items["occurrence"] >= 0) & (items["occurrence"] < n_occurrences)).all():
        raise CacheError(f"an item points to an occurrence outside of the {n_occurrences} that exist")
