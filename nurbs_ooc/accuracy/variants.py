"""The ways to make triangles whose cost is compared; each is one row of ``VARIANTS``.

A variant is a name, the dials it is turned by, and a function that prepares a part and one that meshes
it. To add one write those two functions and append a row; the
curves, the tables and the plots take it from there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.accuracy.sampled_mesh import sampled_mesh, uniform_mesh
from nurbs_ooc.tessellation.appearance import Appearance
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate

Timed = tuple[MeshBatch, float]  # and the CPU seconds it took

ERROR_SHARES = tuple(float(x) for x in 10.0 ** -np.arange(2.0, 6.01, 0.5))  # of the diagonal, coarse to fine
GRID_STEPS = (1, 2, 4, 8, 16, 32, 64, 128)


@dataclass(frozen=True)
class Variant:
    """One way to tessellate.

    Attributes:
        name: in tables and legends.
        dial: what is turned: an error as a share of the diagonal, or the steps of a grid.
        settings: of the dial, coarse to fine.
        certified: its bound is a promise.
        prepare: once a part, not timed.
        mesh: what ``prepare`` gave and the error in mm (dial ``error``) or the steps (dial ``steps``).
        peer: another program's, only on request.
    """

    name: str
    dial: Literal["error", "steps"]
    settings: tuple[float, ...]
    certified: bool
    prepare: Callable[[GeometryBatch], Any]
    mesh: Callable[[Any, float], Timed]
    peer: bool = False


def _itself(geometry: GeometryBatch) -> GeometryBatch:
    return geometry


def _timed(mesh: Callable[[GeometryBatch, float], MeshBatch]) -> Callable[[GeometryBatch, float], Timed]:
    def run(geometry: GeometryBatch, setting: float) -> Timed:
        start = time.process_time()
        made = mesh(geometry, setting)
        return made, time.process_time() - start

    return run


def _certified(geometry: GeometryBatch, error: float) -> MeshBatch:
    return tessellate(geometry, error, workers=1)


def _appearance(geometry: GeometryBatch, error: float) -> MeshBatch:
    return tessellate(geometry, error, appearance=Appearance(), workers=1)


def _uniform(geometry: GeometryBatch, steps: float) -> MeshBatch:
    return uniform_mesh(geometry, int(steps))


def _build_shape(geometry: GeometryBatch) -> Any:
    from nurbs_ooc.accuracy.open_cascade_mesh import build_shape

    return build_shape(geometry)


def _mesh_shape(shape: Any, error: float) -> Timed:
    from nurbs_ooc.accuracy.open_cascade_mesh import mesh_shape

    return mesh_shape(shape, error)


VARIANTS = (
    Variant("certified", "error", ERROR_SHARES, True, _itself, _timed(_certified)),
    Variant("appearance-preserving", "error", ERROR_SHARES, True, _itself, _timed(_appearance)),
    Variant("sampled estimate", "error", ERROR_SHARES, False, _itself, _timed(sampled_mesh)),
    Variant("uniform", "steps", GRID_STEPS, False, _itself, _timed(_uniform)),
    Variant("Open CASCADE", "error", ERROR_SHARES, False, _build_shape, _mesh_shape, peer=True),
)
