"""Tessellates surfaces at the levels that nodes need, each (level, surface) once.

At each level a part counts as consisting of the surfaces that any node shows at that level, whichever of
them are made now: they meet vertex for vertex, and what they meet does not depend on who asks. The others
stay out; most are far larger, and to tessellate them so finely only for the sake of a neighbour took
half of the time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.mesh_demand import Keys, MeshDemand, key_levels, key_surfaces
from nurbs_ooc.build.run_geometry import Ids, RunGeometry
from nurbs_ooc.build.surface_runs import PartSlice, surface_runs
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.tessellation.tessellate import Tessellator


def mesh_levels(near: RunGeometry, keys: Keys, demanded: Keys, workers: int = 1) -> list[MeshPool]:
    """Tessellate surfaces at one level after the other.

    Args:
        near: the surfaces with those beside them.
        keys: mesh keys, ascending.
        demanded: all mesh keys of their parts that any node needs, ascending; ``keys`` among them.
        workers: threads.

    Returns:
        One pool a level, ascending levels.
    """
    tessellator = Tessellator(near.geometry, workers)
    levels, demanded_levels = key_levels(keys), key_levels(demanded)
    pools = []
    for level in np.unique(levels).tolist():
        own = keys[levels == level]
        rows = near.rows_of(key_surfaces(own))
        present = near.rows_of(key_surfaces(demanded[demanded_levels == level]))
        # Hardly ever more than one: a level below what float64 can keep of a part.
        errors = np.maximum(2.0**level, near.smallest)
        parts = [
            _pool(tessellator, error, own[errors[rows] == error], rows[errors[rows] == error],
                  present[errors[present] == error], workers)
            for error in np.unique(errors[rows]).tolist()
        ]  # fmt: skip
        pools.append(parts[0] if len(parts) == 1 else MeshPool.join(parts).by_key())
    return pools


def _pool(tessellator: Tessellator, error: float, keys: Keys, rows: Ids, present: Ids, workers: int) -> MeshPool:
    return MeshPool.of_mesh(tessellator.mesh(error, faces=rows, present=present, workers=workers), keys)


def mesh_slices(
    store: TypedStore, slices: Sequence[PartSlice], keys: Keys, demanded: Keys, workers: int = 1
) -> list[MeshPool]:
    """Tessellate surfaces of a run.

    Args:
        store: has the parts.
        slices: of the run.
        keys: mesh keys of surfaces in the slices, ascending.
        demanded: all mesh keys of their parts that any node needs, ascending; ``keys`` among them.
        workers: threads.

    Returns:
        Pools whose keys ascend from the first to the last.
    """
    surfaces = key_surfaces(keys)
    pools = []
    for near, own in RunGeometry.batches(store, slices, np.unique(surfaces)):
        pools += mesh_levels(near, keys[np.isin(surfaces, own)], demanded, workers)
    # Batches are of different surfaces, ascending, and a key begins with its level.
    return sorted(pools, key=lambda pool: int(pool.slots["key"][0]))


def mesh_surfaces(store: TypedStore, keys: Keys, demand: MeshDemand, workers: int) -> MeshPool:
    """Tessellate ``keys`` (ascending, each once); slot ``i`` of the pool is that of ``keys[i]``.

    Args:
        store: has the parts.
        keys: ascending, each once.
        demand: all that any node needs.
        workers: threads.
    """
    surfaces = key_surfaces(keys)
    pools = []
    for run in surface_runs(store.part_infos()):
        own = keys[(surfaces >= run.first_surface) & (surfaces < run.first_surface + run.n_surfaces)]
        pools += mesh_slices(store, run.slices, own, demand.of_surfaces(*run.surfaces_of_parts), workers)
    return MeshPool.join(pools).by_key()
