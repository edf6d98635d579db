"""Tessellates surfaces of one part at the levels that nodes need, each (level, surface) once.

At each level the part counts as consisting of the surfaces that any node shows at that level, whichever of
them are made now: they meet vertex for vertex, and what they meet does not depend on who asks. The others
stay out; most are far larger, and to tessellate them so finely only for the sake of a neighbour took
half of the time.
"""

from __future__ import annotations

import numpy as np

from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.mesh_demand import Keys, MeshDemand, key_levels, key_surfaces
from nurbs_ooc.build.surface_runs import geometry_around
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.tessellation.tessellate import tessellate


def mesh_part(
    geometry: GeometryBatch, first_surface: int, keys: Keys, demanded: Keys, workers: int = 1
) -> list[MeshPool]:
    """Tessellate surfaces of a part.

    Args:
        geometry: the part.
        first_surface: id of its first surface.
        keys: mesh keys of this part, ascending.
        demanded: all mesh keys of this part that any node needs, ascending; ``keys`` among them.
        workers: threads.

    Returns:
        One pool a level, ascending levels.
    """
    levels, demanded_levels = key_levels(keys), key_levels(demanded)
    pools = []
    for level in np.unique(levels).tolist():
        own = keys[levels == level]
        rows = key_surfaces(demanded[demanded_levels == level]) - first_surface
        part = geometry if len(rows) == len(geometry) else subset(geometry, rows)
        faces = np.searchsorted(rows, key_surfaces(own) - first_surface)
        if 2 * len(faces) < len(rows):
            part, faces = geometry_around(part, faces)
        mesh = tessellate(part, 2.0**level, faces=faces, workers=workers)
        pools.append(MeshPool.of_mesh(mesh, own))
    return pools


def mesh_surfaces(store: TypedStore, keys: Keys, demand: MeshDemand, workers: int) -> MeshPool:
    """Tessellate ``keys`` (ascending, each once); slot ``i`` of the pool is that of ``keys[i]``.

    Args:
        store: has the parts.
        keys: ascending, each once.
        demand: all that any node needs.
        workers: threads.
    """
    infos = store.part_infos()
    firsts = np.array([info.first_surface for info in infos], np.int64)
    part_of = np.searchsorted(firsts, key_surfaces(keys), side="right") - 1
    pools = []
    for part in np.unique(part_of).tolist():
        first, count = infos[part].first_surface, infos[part].n_surfaces
        demanded = demand.of_surfaces(first, count)
        pools += mesh_part(store.get_part(part), first, keys[part_of == part], demanded, workers)
    pool = MeshPool.join(pools)
    return MeshPool(pool.slots[np.argsort(pool.slots["key"])], pool.words)
