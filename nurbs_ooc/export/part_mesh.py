"""The mesh of one part as glTF wants it: float32 relative to one origin, one primitive per material.

All faces of a part share the origin, so positions that are equal in float64 stay equal in float32 and the
mesh stays closed. What the rounding moved is measured and charged to the part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.export.gltf_space import MM_PER_M, from_gltf, to_gltf
from nurbs_ooc.export.sliver import flip_collinear, triangle_areas
from nurbs_ooc.export.weld import edge_counts, weld
from nurbs_ooc.tessellation.mesh import MeshBatch

Ids = npt.NDArray[np.int64]
Float32 = npt.NDArray[np.float32]

ORIGIN_GRID = 64.0  # the origin lies on a binary grid of about 1/64 of the part, so that p - origin rounds little


@dataclass(frozen=True, eq=False)
class Primitive:
    """What is drawn with one material: triangles, or points where ``indices`` is None.

    Attributes:
        material: row in the scene's materials.
        positions: (n, 3) float32, metres, y up, relative to the part's origin.
        normals: (n, 3) float32, unit, y up.
        features: (n,) float32, row of the vertex's face in the part.
        indices: (3 t,) unsigned, counter-clockwise from outside.
    """

    material: int
    positions: Float32
    normals: Float32
    features: Float32
    indices: npt.NDArray[np.uint16] | npt.NDArray[np.uint32] | None


@dataclass(frozen=True, eq=False)
class PartMesh:
    """One part, ready to be written.

    Attributes:
        origin: (3,) mm, part space: zero of the primitives' positions.
        primitives: in order of material, triangles before points.
        float32_error: mm, largest distance that rounding moved a vertex.
        boundary_edges: edges with one triangle after welding equal positions.
        nonmanifold_edges: edges with more than two.
        flat_triangles: triangles without an area that had to stay (see ``sliver``).
    """

    origin: npt.NDArray[np.float64]
    primitives: list[Primitive]
    float32_error: float
    boundary_edges: int
    nonmanifold_edges: int
    flat_triangles: int

    @property
    def n_triangles(self) -> int:
        """Triangles of all primitives."""
        return sum(len(p.indices) // 3 for p in self.primitives if p.indices is not None)

    @property
    def n_points(self) -> int:
        """Points of all primitives that have no triangles."""
        return sum(len(p.positions) for p in self.primitives if p.indices is None)

    @property
    def n_vertices(self) -> int:
        """Vertices of all primitives."""
        return sum(len(p.positions) for p in self.primitives)


def part_mesh(mesh: MeshBatch, face_material: npt.NDArray[np.integer]) -> PartMesh:
    """Round a part's mesh to float32 and sort it by material.

    Args:
        mesh: all drawn faces of one part, mm, part space.
        face_material: (n_surfaces,) material of each row of the part's geometry batch.

    Returns:
        The part; faces without triangles are drawn as points, each of their vertices one.
    """
    origin = _origin(mesh.positions)
    positions = (to_gltf(mesh.positions - origin) / MM_PER_M).astype(np.float32)
    moved = from_gltf(positions.astype(np.float64)) * MM_PER_M + origin - mesh.positions
    ids = weld(positions)
    triangles, face_of_triangle = _clean(mesh, positions.astype(np.float64), ids)
    boundary, nonmanifold = edge_counts(ids[triangles])
    normals = _unit(to_gltf(mesh.normals)).astype(np.float32)
    primitives = _primitives(mesh, face_material, positions, normals, triangles, face_of_triangle)
    return PartMesh(
        origin=origin,
        primitives=primitives,
        float32_error=_largest_norm(moved),
        boundary_edges=boundary,
        nonmanifold_edges=nonmanifold,
        flat_triangles=int((triangle_areas(positions.astype(np.float64), triangles) == 0.0).sum()),
    )


def _origin(positions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Centre of the box, on a binary grid."""
    if len(positions) == 0:
        return np.zeros(3)
    low, high = positions.min(axis=0), positions.max(axis=0)
    extent = float((high - low).max())
    centre = low + (high - low) / 2.0
    if extent == 0.0:
        return np.asarray(centre)
    step = 2.0 ** math.floor(math.log2(extent / ORIGIN_GRID))
    return np.asarray(np.round(centre / step) * step)


def _clean(mesh: MeshBatch, points: npt.NDArray[np.float64], ids: Ids) -> tuple[Ids, Ids]:
    """Triangles without those that rounding emptied, and the face (0 to n - 1) that each belongs to."""
    faces = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.triangle_start))
    keep = _distinct(ids[mesh.triangles])
    triangles = flip_collinear(points, mesh.triangles[keep])
    faces = faces[keep]
    keep = _distinct(ids[triangles])
    return triangles[keep], faces[keep]


def _distinct(corners: Ids) -> npt.NDArray[np.bool_]:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.asarray((a != b) & (b != c) & (c != a))


def _primitives(
    mesh: MeshBatch,
    face_material: npt.NDArray[np.integer],
    positions: Float32,
    normals: Float32,
    triangles: Ids,
    face_of_triangle: Ids,
) -> list[Primitive]:
    """Sort vertices and triangles by material; vertices that no triangle uses are left out."""
    n_vertices = len(positions)
    face_of_vertex = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.vertex_start))
    features = mesh.faces[face_of_vertex].astype(np.float32)
    material = np.asarray(face_material, dtype=np.int64)[mesh.faces]
    has_triangles = np.bincount(face_of_triangle, minlength=len(mesh.faces)) > 0
    used = ~has_triangles[face_of_vertex]
    used[triangles] = True

    # Number the drawn sets: triangles of material m are 2 m, its points 2 m + 1.
    group_of_face = 2 * material + ~has_triangles
    group = np.where(used, group_of_face[face_of_vertex], -1)
    order = np.argsort(group, kind="stable")
    triangle_group = group_of_face[face_of_triangle]
    triangle_order = np.argsort(triangle_group, kind="stable")

    result = []
    new_row = np.zeros(n_vertices, dtype=np.int64)
    for key in np.unique(group[used]).tolist():
        rows = _slice_of(group, order, key)
        new_row[rows] = np.arange(len(rows))
        indices = None
        if key % 2 == 0:
            corners = new_row[triangles[_slice_of(triangle_group, triangle_order, key)]]
            indices = _smallest(corners.ravel(), len(rows))
        result.append(Primitive(key // 2, positions[rows], normals[rows], features[rows], indices))
    return result


def _smallest(indices: Ids, n_vertices: int) -> npt.NDArray[np.uint16] | npt.NDArray[np.uint32]:
    """``indices`` in two bytes where they fit; 65535 is glTF's restart value and never an index."""
    if n_vertices < np.iinfo(np.uint16).max:
        return indices.astype(np.uint16)
    return indices.astype(np.uint32)


def _slice_of(keys: Ids, order: Ids, key: int) -> Ids:
    """Rows of ``order``, which sorts ``keys``, whose key is ``key``."""
    first, last = np.searchsorted(keys, [key, key + 1], sorter=order)
    return order[first:last]


def _unit(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), [0.0, 1.0, 0.0])


def _largest_norm(vectors: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).max(initial=0.0)))
