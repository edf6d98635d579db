"""What replacing single surfaces of a cache costs: nodes that become stale, surfaces tessellated, processor time.

Works on a copy. Each of some NURBS, spread evenly over the items, gets its middle control point moved by a thousandth
of its size; the stale nodes are rebuilt after each edit.

    python scripts/measure_edits.py CACHE [--edits 20]
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch, SurfaceKind
from nurbs_ooc.build.rebuild_stale import rebuild_stale
from nurbs_ooc.build.replace_surface import replace_surface
from nurbs_ooc.tessellation.deform import deformed_face


def bumped(geometry: GeometryBatch, row: int) -> GeometryBatch:
    """The surface in ``row`` with its middle control point moved."""
    surface = geometry.surfaces[row]
    n_u, n_v, width = int(surface["n_u"]), int(surface["n_v"]), 4 if surface["rational"] else 3
    first = int(surface["points"])
    net: npt.NDArray[np.float64] = geometry.values[first : first + n_u * n_v * width].reshape(n_u, n_v, width).copy()
    net[n_u // 2, n_v // 2, :3] += 1e-3 * np.ptp(net[..., :3], axis=(0, 1))
    return deformed_face(geometry, row, net)


def main() -> None:
    """Print medians and extremes over the edits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cache", type=Path)
    parser.add_argument("--edits", type=int, default=20)
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(arguments.cache, folder / "cache")
    columns: list[tuple[float, ...]] = []
    with Store.open(folder / "cache", read_only=False) as store:
        surfaces = store.get_items()["surface"]
        for surface in surfaces[np.linspace(0, len(surfaces) - 1, arguments.edits).astype(int)].tolist():
            part, row = store.locate_surface(surface)
            geometry = store.get_part(part)
            if geometry.surfaces[row]["kind"] == SurfaceKind.NURBS:
                one, start = bumped(geometry, row), time.process_time()
                stale, middle = replace_surface(store, surface, one), time.process_time()
                rebuilt = rebuild_stale(store)
                columns.append((len(stale), rebuilt.n_meshes, middle - start, time.process_time() - middle))
        print(f"{len(columns)} edits of a cache of {store.n_nodes()} nodes and {store.n_items()} placed surfaces")
    names = "stale nodes", "tessellated surfaces", "replace, CPU s", "rebuild, CPU s"
    for name, values in zip(names, zip(*columns, strict=True), strict=True):
        print(f"{name}: median {statistics.median(values):.3g}, {min(values):.3g} to {max(values):.3g}")
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
