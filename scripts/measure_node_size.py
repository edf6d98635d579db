"""What r, a node's longest edge over its error, costs: nodes, primitives and bytes, in the cache and on the screen.

Takes the surfaces of a cache, plants trees for several r, builds all tiles in a temporary folder and counts what a
view draws. The view is the whole model at a given number of pixels along its longest edge, without culling, each
surface at half a pixel; direct surfaces that are drawn through their own levels of detail are counted apart.

    python scripts/measure_node_size.py CACHE [--r 128 256 512] [--most 16384 32768] [--pixels 250 1000 4000]
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nurbs_cache.store import Store
from nurbs_ooc.build import tunables
from nurbs_ooc.build.box_stage import Boxes, box_surfaces
from nurbs_ooc.build.codec_choice import DEFAULT_CODEC
from nurbs_ooc.build.crew import SoloCrew
from nurbs_ooc.build.error_order import order_errors
from nurbs_ooc.build.forest import Forest
from nurbs_ooc.build.mesh_stage import mesh_surfaces_of_runs
from nurbs_ooc.build.surface_runs import surface_runs
from nurbs_ooc.build.tile_stage import build_tiles
from nurbs_ooc.build.workshop import Workshop
from nurbs_ooc.hierarchy.lazy_octree import build_lazy_octree


def built_nodes(shop: Workshop, r: float, boxes: Boxes) -> tuple[npt.NDArray[np.void], float]:
    """Node table with all tiles for one r, and the processor time for meshes and tiles, s."""
    nodes, items = build_lazy_octree(boxes[0], boxes[1], r)
    with Store.open(shop.store, read_only=False) as store, SoloCrew() as crew:
        store.put_face_report(boxes[2])
        store.put_tree(nodes, items)
        forest = Forest.load(store)
        start = time.process_time()
        runs = surface_runs(store.part_infos())
        mesh_surfaces_of_runs(store, crew, shop, runs, forest.demand, forest.demand, lambda _: None)
        build_tiles(store, forest, np.arange(len(nodes)), crew, shop, lambda _: None)
        seconds = time.process_time() - start
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
    parser.add_argument("--most", type=int, nargs="+", default=[tunables.PRIMITIVES_PER_NODE], help="primitives a node")
    parser.add_argument("--pixels", type=int, nargs="+", default=[250, 1000, 4000])
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    shop = Workshop(folder / "cache", folder, DEFAULT_CODEC)
    with Store.open(arguments.cache) as source, Store.create(shop.store) as store:
        store.put_parts((i, info, source.get_part(i)) for i, info in enumerate(source.part_infos()))
        store.put_scene(source.get_products(), source.get_materials(), source.get_occurrences(), source.get_units())
        runs = surface_runs(store.part_infos())
    with SoloCrew() as crew:
        boxes = box_surfaces(crew, shop, runs, lambda _: None)
    size = float((boxes[0]["aabb_max"].max(axis=0) - boxes[0]["aabb_min"].min(axis=0)).max())
    print(
        "r | at most | nodes | primitives: mean, largest | tile MiB | CPU s | "
        + " | ".join(f"{p} px" for p in arguments.pixels)
    )
    for r, most in itertools.product(arguments.r, arguments.most):
        tunables.PRIMITIVES_PER_NODE = most
        nodes, seconds = built_nodes(shop, r, boxes)
        primitives = nodes["n_triangles"].astype(np.int64) + nodes["n_lines"] + nodes["n_points"]
        views = []
        for pixels in arguments.pixels:
            shown, direct = drawn(nodes, size / pixels)
            kib = nodes["tile_bytes"][shown].sum() / 1024
            views.append(f"{shown.sum()} nodes, {primitives[shown].sum()} primitives, {kib:.0f} KiB, {direct} direct")
        totals = (
            f"{primitives.mean():.0f}, {primitives.max()} | {nodes['tile_bytes'].sum() / 2**20:.1f} | {seconds:.1f}"
        )
        print(f"{r:g} | {most} | {len(nodes)} | {totals} | " + " | ".join(views), flush=True)
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
