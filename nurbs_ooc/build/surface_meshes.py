"""Tessellates the surfaces that a set of nodes needs, each once per error level, into one mesh pool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.workers import run_in_order
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.tessellation.tessellate import tessellate

LEVEL_SHIFT = np.uint64(48)  # a mesh key is (level + LEVEL_ZERO) << 48 | surface id
LEVEL_ZERO = 1024
SURFACE_MASK = np.uint64((1 << 48) - 1)


def mesh_keys(surfaces: npt.NDArray[np.uint64], levels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint64]:
    """One sortable number for each (surface, level in surface space)."""
    return ((levels + LEVEL_ZERO).astype(np.uint64) << LEVEL_SHIFT) | surfaces


@dataclass(frozen=True)
class _Job:
    """Surfaces of one part to be tessellated at one level."""

    part: int
    level: int
    faces: npt.NDArray[np.int64]


def _jobs(store: TypedStore, keys: npt.NDArray[np.uint64]) -> Iterator[_Job]:
    """Cut ascending keys into runs of one level and part."""
    first_surface = np.array([info.first_surface for info in store.part_infos()], np.int64)
    surfaces = (keys & SURFACE_MASK).astype(np.int64)
    levels = (keys >> LEVEL_SHIFT).astype(np.int64) - LEVEL_ZERO
    parts = np.searchsorted(first_surface, surfaces, side="right") - 1
    cuts = np.flatnonzero((np.diff(parts) != 0) | (np.diff(levels) != 0)) + 1
    for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), len(keys)], strict=True):
        if first < last:
            part = int(parts[first])
            yield _Job(part, int(levels[first]), surfaces[first:last] - first_surface[part])


def _mesh(store: TypedStore, job: _Job, workers: int) -> MeshPool:
    geometry: GeometryBatch = store.get_part(job.part)
    return MeshPool.of_mesh(tessellate(geometry, 2.0**job.level, faces=job.faces, workers=workers))


def mesh_surfaces(store: TypedStore, keys: npt.NDArray[np.uint64], workers: int) -> MeshPool:
    """Tessellate ``keys`` (ascending, each once); slot ``i`` of the pool is that of ``keys[i]``.

    Many small parts are done side by side, a few large ones each with all threads.
    """
    jobs = list(_jobs(store, keys))
    if len(jobs) >= 2 * workers:
        return MeshPool.join(list(run_in_order((partial(_mesh, store, job, 1) for job in jobs), workers)))
    return MeshPool.join([_mesh(store, job, workers) for job in jobs])
