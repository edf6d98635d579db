#!/usr/bin/env python3
"""Rates of a store on disk: tiles, node tables, parts; JSON on stdout.

Wall-clock seconds, warm (the system's page cache holds the file), one thread, best of several runs for reads and
single changes, one run for writes. The folder is made and removed beside ``--folder``.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "cache"))

from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    GeometryBatch,
)
from nurbs_cache.tile import TileContent, encode_tile, tile_hash

TRANSACTION = 1000  # tiles put at once


def seconds(run: Callable[[], object], repeats: int = 1) -> float:
    """Shortest wall-clock time of ``run``."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def tiles(n: int) -> list[tuple[str, bytes]]:
    """Tiles of some 30 KiB whose coordinates do not compress."""
    random = np.random.default_rng(2)
    none = np.zeros(0, np.uint32)
    made = []
    for _ in range(n):
        positions = random.random((4000, 3))
        points = np.arange(4000, dtype=np.uint32)
        data = encode_tile(
            TileContent(positions, positions.astype(np.float32), none.reshape(0, 3), none.reshape(0, 2), points)
        )
        made.append((tile_hash(data), data))
    return made


def part(n_surfaces: int) -> GeometryBatch:
    """Surfaces of 82 control points, four edges each."""
    random = np.random.default_rng(3)
    surfaces = np.zeros(n_surfaces, SURFACE_DTYPE)
    surfaces["points"] = 300 * np.arange(n_surfaces)
    values = random.random(300 * n_surfaces)
    tables = [np.zeros(k * n_surfaces, dtype) for k, dtype in
              ((1, LOOP_DTYPE), (4, COEDGE_DTYPE), (4, EDGE_DTYPE), (8, CURVE_DTYPE))]  # fmt: skip
    return GeometryBatch(surfaces, *tables, random.random((4 * n_surfaces, 3)), values)


def measure(folder: Path, n_tiles: int, n_nodes: int, n_surfaces: int) -> dict[str, object]:
    """All figures."""
    kinds = tiles(min(n_tiles, 200))
    mb = sum(len(data) for _, data in kinds) / len(kinds) * n_tiles / 1e6
    names = [f"{i:032x}" for i in range(n_tiles)]
    batches = [
        [(names[i], kinds[i % len(kinds)][1]) for i in range(first, min(first + TRANSACTION, n_tiles))]
        for first in range(0, n_tiles, TRANSACTION)
    ]
    nodes, items, geometry = np.zeros(n_nodes, NODE_DTYPE), np.zeros(n_nodes, ITEM_DTYPE), part(n_surfaces)
    nodes["aabb_max"] = items["aabb_max"] = np.random.default_rng(4).random((n_nodes, 3))
    part_mb = len(geometry.to_bytes()) / 1e6
    with Store.create(folder / "cache") as store:
        put_s = seconds(lambda: [store.put_tiles(batch) for batch in batches])
        get_s = seconds(lambda: [store.get_tile(name) for name in names], 3)
        tree = {
            "put_s": seconds(lambda: store.put_tree(nodes, items)),
            "get_nodes_s": seconds(store.get_nodes, 3),
            "get_items_s": seconds(store.get_items, 3),
            "update_one_ms": 1e3 * seconds(lambda: store.update_nodes(n_nodes // 2, nodes[:1]), 20),
        }
        parts = {
            "mb": part_mb,
            "put_mb_s": part_mb / seconds(lambda: store.put_parts([(0, PartInfo("p", n_surfaces, 0), geometry)]), 3),
            "get_mb_s": part_mb / seconds(lambda: store.get_part(0), 5),
        }
        content_hash_s = seconds(store.content_hash, 3)
    return {
        "machine": platform.processor() or platform.machine(),
        "tiles": {
            "n": n_tiles,
            "mb": mb,
            "put_mb_s": mb / put_s,
            "get_mb_s": mb / get_s,
            "get_us": 1e6 * get_s / n_tiles,
        },
        "tree": {"n": n_nodes, **tree},
        "part": {"surfaces": n_surfaces, **parts},
        "content_hash_s": content_hash_s,
    }


def main() -> None:
    """Print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where to make the cache (default: the system's temporary folder)")
    parser.add_argument("--tiles", type=int, default=5000, help="number of tiles of some 30 KiB (default 5000)")
    parser.add_argument("--nodes", type=int, default=1_000_000, help="rows of the node and item tables (default 1e6)")
    parser.add_argument("--surfaces", type=int, default=5000, help="surfaces of the part (default 5000)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        report = measure(Path(folder), options.tiles, options.nodes, options.surfaces)
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
