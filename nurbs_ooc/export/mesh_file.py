"""From an open assembly to one GLB, part by part: memory follows the largest part, not the assembly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nurbs_ooc.export.atomic_file import atomic_file
from nurbs_ooc.export.face_tally import FaceTally
from nurbs_ooc.export.glb import GlbWriter
from nurbs_ooc.export.gltf_space import stretch
from nurbs_ooc.export.part_mesh import part_mesh
from nurbs_ooc.export.smallest_angles import AngleCount
from nurbs_ooc.readers.assembly import AssemblyReader, Part
from nurbs_ooc.tessellation.appearance import Appearance
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate

FLOAT32_SHARE = 2.0**-23  # of the part's extent: float32 moves a vertex by at most half of it
LEAST_SHARE = 1e-3  # of the error, kept for float32 where the extent is not known from the edges' ends (a torus)
FLOAT32_NORMAL_DEG = 2e-5  # what float32 turns a normal by at most
MOST_SHARE = 0.5  # of the error: below float32's reach refining further would not help


@dataclass(frozen=True)
class MeshOptions:
    """What ``tessellate`` asks for: errors in mm and degrees, number of threads."""

    chord_error: float
    normal_error_deg: float | None = None
    appearance: Appearance | None = None
    workers: int = 1


Stage = Callable[[str], AbstractContextManager[None]]


def write_mesh_file(
    assembly: AssemblyReader,
    path: Path,
    options: MeshOptions,
    stage: Stage,
    on_part: Callable[[Part], None] = lambda _part: None,
) -> dict[str, Any]:
    """Tessellate every part of ``assembly`` and write it as GLB; returns the report's keys about the mesh.

    Args:
        assembly: open, its parts not yet read.
        path: the GLB; replaced when all is done, untouched if something fails.
        options: the error is that of the placed parts, in assembly space, float32 rounding included.
        stage: context manager that times ``read``, ``tessellate`` and ``write``.
        on_part: called after each part.
    """
    tally, angles = FaceTally(), AngleCount()
    parts: list[dict[str, Any]] = []
    with atomic_file(path) as temporary, GlbWriter(path.parent) as writer:
        for part in _timed(assembly.parts(), stage):
            largest = _largest_stretch(assembly, part.index)
            with stage("tessellate"):
                mesh = _tessellate(part, options, largest)
            with stage("write"):
                drawn = part_mesh(mesh, part.geometry.surfaces["material"])
                writer.add_part(part.index, part.info, drawn)
                error_mm = drawn.float32_error * largest
            angles.add(mesh.positions, mesh.triangles)
            tally.add(part.geometry, mesh, part.info.first_surface, largest)
            parts.append(
                {
                    "name": part.info.name,
                    "faces": len(part.geometry),
                    "triangles": drawn.n_triangles,
                    "points": drawn.n_points,
                    "vertices": drawn.n_vertices,
                    "boundary_edges": drawn.boundary_edges,
                    "nonmanifold_edges": drawn.nonmanifold_edges,
                    "flat_triangles": drawn.flat_triangles,
                    "float32_error_mm": error_mm,
                }
            )
            on_part(part)
        with stage("write"):
            n_bytes = writer.write(temporary, assembly.products, assembly.materials, assembly.occurrences)
    normals = {}
    if tally.certified_normal_error is not None:
        normals["certified_normal_error_deg"] = min(tally.certified_normal_error + FLOAT32_NORMAL_DEG, 180.0)
    if tally.appearance_error is not None:
        normals["appearance_error_mm"] = tally.appearance_error
    return {
        "faces": tally.counts,
        **{k: sum(p[k] for p in parts) for k in ("triangles", "points", "vertices", "boundary_edges")},
        "lines": 0,
        "certified_error_mm": tally.certified_error + max((p["float32_error_mm"] for p in parts), default=0.0),
        **normals,
        "smallest_angle_deg": angles.as_json(),
        "bytes": n_bytes,
        "surfaces": sum(p["faces"] for p in parts),
        "occurrences": len(assembly.occurrences),
        "materials": len(assembly.materials),
        "parts": parts,
        "not_exact": tally.listed,
    }


def _timed(parts: Iterator[Part], stage: Stage) -> Iterator[Part]:
    """``parts``, the time it takes to get each counted as ``read``."""
    while True:
        with stage("read"):
            part = next(parts, None)
        if part is None:
            return
        yield part


def _largest_stretch(assembly: AssemblyReader, part: int) -> float:
    """By how much the placements of a part lengthen its errors, at most."""
    placed = assembly.occurrences[assembly.occurrences["part"] == part]
    return max((stretch(transform) for transform in placed["transform"]), default=1.0)


def _tessellate(part: Part, options: MeshOptions, largest_stretch: float) -> MeshBatch:
    """Mesh a part at the error that leaves room for its stretch and for float32."""
    error = options.chord_error / largest_stretch
    vertices = part.geometry.vertices
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    reserve = min(max(FLOAT32_SHARE * extent, LEAST_SHARE * error), MOST_SHARE * error)
    normal = options.normal_error_deg
    return tessellate(
        part.geometry,
        error - reserve,
        normal_error_deg=None if normal is None else max(normal - FLOAT32_NORMAL_DEG, 0.5 * normal),
        appearance=options.appearance,
        workers=options.workers,
    )
