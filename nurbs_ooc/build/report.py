"""What is in a cache, in the words that all reports share."""

from __future__ import annotations

from typing import Any

import numpy as np

from nurbs_cache.node_record import NODE_DTYPE
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.face_report import reason_counts, status_counts


def contents(store: TypedStore) -> dict[str, Any]:
    """Counts, errors and bytes of a cache; lengths in mm.

    ``triangles``, ``lines`` and ``points`` are those of all node tiles together; ``certified_error_mm`` is
    the largest error of a root: that of the coarsest picture that the cache can give.
    """
    nodes = store.get_nodes()
    built = nodes["tile_hash"] != b""
    roots = nodes["parent"] < 0
    bytes_per_table = store.stats()
    return {
        "faces": status_counts(store),
        "face_reasons": reason_counts(store),
        "surfaces": sum(info.n_surfaces for info in store.part_infos()),
        "parts": len(store.part_infos()),
        "products": len(store.get_products()),
        "occurrences": len(store.get_occurrences()),
        "placed_surfaces": store.n_items(),
        "materials": len(store.get_materials()),
        "units": store.get_units(),
        "nodes": len(nodes),
        "roots": int(roots.sum()),
        "tiles": int(built.sum()),
        "levels": len(np.unique(nodes["level"])),
        "finest_level": int(nodes["level"].min(initial=0)) if len(nodes) else None,
        "coarsest_level": int(nodes["level"].max()) if len(nodes) else None,
        "triangles": int(nodes["n_triangles"].sum(dtype=np.int64)),
        "lines": int(nodes["n_lines"].sum(dtype=np.int64)),
        "points": int(nodes["n_points"].sum(dtype=np.int64)),
        "certified_error_mm": float(nodes["geometric_error"][roots].max(initial=0.0)),
        "primitives_per_node": primitives_per_node(nodes[built]),
        "tile_bytes": int(nodes["tile_bytes"].sum(dtype=np.int64)),
        "bytes": sum(bytes_per_table.values()),
        "bytes_per_table": bytes_per_table,
    }


def primitives_per_node(nodes: np.ndarray[Any, np.dtype[np.void]]) -> dict[str, float]:
    """Mean, median and largest number of triangles, lines and points together."""
    assert nodes.dtype == NODE_DTYPE
    counts = nodes["n_triangles"].astype(np.int64) + nodes["n_lines"] + nodes["n_points"]
    if not len(counts):
        return {"mean": 0.0, "median": 0.0, "max": 0.0}
    return {"mean": float(counts.mean()), "median": float(np.median(counts)), "max": float(counts.max())}
