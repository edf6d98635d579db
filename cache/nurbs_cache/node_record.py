"""The lazy octree as two flat tables: its nodes, and the placed surfaces ("items") they hold."""

from __future__ import annotations

import numpy as np

NODE_DTYPE = np.dtype(
    [
        ("key", "S40"),  # canonical text of the NodeKey: "<material>" or "<material>-<octant digits>"
        ("parent", "i4"),  # row of the parent node, -1 for a root
        ("first_child", "i4"),  # children are consecutive rows, breadth first
        ("n_children", "i4"),
        ("first_item", "i4"),  # all items of the subtree are consecutive in the item table ...
        ("n_items", "i4"),
        ("n_direct", "i4"),  # ... and the node's direct surfaces come first among them
        ("material", "i4"),
        ("level", "i4"),  # error level of the tile: geometric budget 2**level mm
        ("aabb_min", "f8", (3,)),  # assembly space, mm; contains every item of the subtree
        ("aabb_max", "f8", (3,)),
        ("geometric_error", "f8"),  # mm; >= that of every child; bound of the drawn tile to the surfaces
        ("tile_hash", "S32"),  # hex content hash of the tile, b"" while it is not built
        ("tile_bytes", "i4"),
        ("n_triangles", "i4"),
        ("n_lines", "i4"),
        ("n_points", "i4"),
    ],
    align=True,
)

ITEM_DTYPE = np.dtype(
    [
        ("surface", "u8"),  # surface id
        ("occurrence", "i4"),  # row in the occurrences
        ("node", "i4"),  # row of the node that holds it as a direct surface
        ("aabb_min", "f8", (3,)),  # assembly space, mm
        ("aabb_max", "f8", (3,)),
        ("normal", "f4", (3,)),  # average unit normal, assembly space
        ("scale", "f4"),  # largest stretch of the occurrence's transform
    ],
    align=True,
)

LOD_DTYPE = np.dtype(
    [
        ("level", "i4"),  # error level in the surface's own space: budget 2**level mm
        ("geometric_error", "f8"),  # mm, certified, surface space
        ("tile_hash", "S32"),
        ("tile_bytes", "i4"),
        ("n_triangles", "i4"),
    ],
    align=True,
)
