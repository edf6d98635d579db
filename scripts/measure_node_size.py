"""What r, a node's longest edge over its error, costs: nodes, primitives and bytes, in the cache and on the screen.

Takes the surfaces of a cache, plants trees for several r, builds all tiles in memory and counts what a view draws.
The view is the whole model at a given number of pixels along its longest edge, without culling, each surface at
half a pixel; direct surfaces that are drawn through their own levels of detail are counted apart.

    python scripts/measure_node_size.py CACHE [--r 128 256 512] [--pixels 250 1000 4000]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.memory_store import MemoryStore
from nurbs_cache.store import Store
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.box_stage import box_surfaces
from nurbs_ooc.build.error_order import order_errors
from nurbs_ooc.build.tile_stage import Forest, build_tiles
from nurbs_ooc.hierarchy.lazy_octree import build_lazy_octree


def built_nodes(store: TypedStore, r: float, boxes: tuple[npt.NDArray[Any], ...]) -> tuple[npt.NDArray[np.void], float]:
    """Node table with all tiles for one r, and the seconds for the tiles."""
    nodes, items = build_lazy_octree(boxes[0], boxes[1], r)
    store.put_face_report(boxes[2])
    store.put_tree(nodes, items)
    forest = Forest.load(store)
    start = time.perf_counter()
    build_tiles(store, forest, np.arange(len(nodes)), 2, lambda _: None)
    seconds = time.perf_counter() - start
    order_errors(store, forest.nodes, np.ones(len(nodes), np.bool_))
    return forest.nodes, seconds


def drawn(nodes: npt.NDArray[np.void], pixel_mm: float) -> tuple[npt.NDArray[np.bool_], int]:
    """Which nodes a view with pixels of this size draws, and the direct surfaces beside them."""
    good = nodes["geometric_error"] <= 0.5 * pixel_mm
    open_parent = np.ones(len(nodes), np.bool_)  # children have larger rows than parents
    for row in range(len(nodes)):
        parent = nodes["parent"][row]
        open_parent[row] = parent < 0 or (open_parent[parent] and not good[parent])
    return good & open_parent, int(nodes["n_direct"][open_parent & ~good].sum())


def main() -> None:
    """Print one line for each r."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cache", type=Path)
    parser.add_argument("--r", type=float, nargs="+", default=[128.0, 256.0, 512.0, 1024.0])
    parser.add_argument("--pixels", type=int, nargs="+", default=[250, 1000, 4000])
    arguments = parser.parse_args()
    store = MemoryStore()
    with Store.open(arguments.cache) as source:
        store.put_parts((i, info, source.get_part(i)) for i, info in enumerate(source.part_infos()))
        store.put_scene(source.get_products(), source.get_materials(), source.get_occurrences(), source.get_units())
    boxes = box_surfaces(store, 2, lambda _: None)
    size = float((boxes[0]["aabb_max"].max(axis=0) - boxes[0]["aabb_min"].min(axis=0)).max())
    print("r | nodes | primitives: mean, largest | tile MiB | s | " + " | ".join(f"{p} px" for p in arguments.pixels))
    for r in arguments.r:
        nodes, seconds = built_nodes(store, r, boxes)
        primitives = nodes["n_triangles"].astype(np.int64) + nodes["n_lines"] + nodes["n_points"]
        views = []
        for pixels in arguments.pixels:
            shown, direct = drawn(nodes, size / pixels)
            kib = nodes["tile_bytes"][shown].sum() / 1024
            views.append(f"{shown.sum()} nodes, {primitives[shown].sum()} primitives, {kib:.0f} KiB, {direct} direct")
        totals = (
            f"{primitives.mean():.0f}, {primitives.max()} | {nodes['tile_bytes'].sum() / 2**20:.1f} | {seconds:.1f}"
        )
        print(f"{r:g} | {len(nodes)} | {totals} | " + " | ".join(views), flush=True)


if __name__ == "__main__":
    main()
