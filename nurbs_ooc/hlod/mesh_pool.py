"""Tessellations of many surfaces in one set of arrays, and their placement in a node.

A surface is tessellated once per error level in part space, whatever number of nodes and occurrences
show it. ``MeshPool`` holds these meshes one after another; ``place`` copies those of one node,
transformed, into a ``Soup``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hlod.soup import Soup
from nurbs_ooc.tessellation.mesh import MeshBatch


@dataclass(frozen=True, eq=False)
class MeshPool:
    """Meshes by slot; slot ``i`` has the vertices ``vertex_start[i]:vertex_start[i + 1]`` and so on.

    Attributes:
        vertex_start, triangle_start, segment_start: (n + 1,) int64.
        positions: (n_vertices, 3) float64, mm, part space.
        normals: (n_vertices, 3) float32, outward.
        triangles: (n_triangles, 3) int32, rows counted from the slot's first vertex.
        segments: (n_segments, 2) int32, likewise.
        errors: (n, 3) float64, mm: surface, trim and p-curve error.
        status, reason: (n,) as in ``MeshBatch``.
    """

    vertex_start: npt.NDArray[np.int64]
    triangle_start: npt.NDArray[np.int64]
    segment_start: npt.NDArray[np.int64]
    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    segments: npt.NDArray[np.int32]
    errors: npt.NDArray[np.float64]
    status: npt.NDArray[np.uint8]
    reason: npt.NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.errors)

    @property
    def nbytes(self) -> int:
        """Bytes of the large arrays."""
        return self.positions.nbytes + self.normals.nbytes + self.triangles.nbytes + self.segments.nbytes

    @classmethod
    def of_mesh(cls, mesh: MeshBatch) -> MeshPool:
        """One slot per face of ``mesh``."""
        first_of_triangle = np.repeat(mesh.vertex_start[:-1], np.diff(mesh.triangle_start))
        first_of_segment = np.repeat(mesh.vertex_start[:-1], np.diff(mesh.segment_start))
        return cls(
            mesh.vertex_start,
            mesh.triangle_start,
            mesh.segment_start,
            mesh.positions,
            mesh.normals.astype(np.float32),
            (mesh.triangles - first_of_triangle[:, None]).astype(np.int32),
            (mesh.segments - first_of_segment[:, None]).astype(np.int32),
            np.stack([mesh.surface_error, mesh.trim_error, mesh.pcurve_error], axis=1),
            mesh.status,
            mesh.reason,
        )

    @classmethod
    def join(cls, pools: Sequence[MeshPool]) -> MeshPool:
        """All slots of the first pool, then those of the second, ..."""
        return cls(
            _join_starts([p.vertex_start for p in pools]),
            _join_starts([p.triangle_start for p in pools]),
            _join_starts([p.segment_start for p in pools]),
            np.concatenate([np.zeros((0, 3)), *(p.positions for p in pools)]),
            np.concatenate([np.zeros((0, 3), np.float32), *(p.normals for p in pools)]),
            np.concatenate([np.zeros((0, 3), np.int32), *(p.triangles for p in pools)]),
            np.concatenate([np.zeros((0, 2), np.int32), *(p.segments for p in pools)]),
            np.concatenate([np.zeros((0, 3)), *(p.errors for p in pools)]),
            np.concatenate([np.zeros(0, np.uint8), *(p.status for p in pools)]),
            np.concatenate([np.zeros(0, np.uint16), *(p.reason for p in pools)]),
        )


def _join_starts(starts: Sequence[npt.NDArray[np.int64]]) -> npt.NDArray[np.int64]:
    counts = [np.diff(start) for start in starts]
    return np.concatenate([[0], np.cumsum(np.concatenate([np.zeros(0, np.int64), *counts]))])


@kernel
def _place(
    slots: npt.NDArray[np.int64],
    placement: npt.NDArray[np.int64],
    vertex_start: npt.NDArray[np.int64],
    triangle_start: npt.NDArray[np.int64],
    segment_start: npt.NDArray[np.int64],
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float32],
    triangles: npt.NDArray[np.int32],
    segments: npt.NDArray[np.int32],
    point_matrix: npt.NDArray[np.float64],
    normal_matrix: npt.NDArray[np.float64],
    mirrored: npt.NDArray[np.bool_],
    out_positions: npt.NDArray[np.float64],
    out_normals: npt.NDArray[np.float32],
    out_triangles: npt.NDArray[np.int32],
    out_segments: npt.NDArray[np.int32],
    out_points: npt.NDArray[np.int32],
) -> int:
    """Copy the slots one after another; returns the number of points (vertices of slots without triangles)."""
    v, t, s, n_points = 0, 0, 0, 0
    for i in range(len(slots)):
        slot, matrix, turn = slots[i], point_matrix[placement[i]], normal_matrix[placement[i]]
        first = v
        for row in range(vertex_start[slot], vertex_start[slot + 1]):
            length = 0.0
            for axis in range(3):
                p, n = matrix[axis, 3], 0.0
                for k in range(3):
                    p += matrix[axis, k] * positions[row, k]
                    n += turn[axis, k] * normals[row, k]
                out_positions[v, axis], out_normals[v, axis] = p, n
                length += n * n
            if length > 0.0:
                for axis in range(3):
                    out_normals[v, axis] /= np.sqrt(length)
            v += 1
        for row in range(triangle_start[slot], triangle_start[slot + 1]):
            a, b, c = triangles[row]
            if mirrored[placement[i]]:
                b, c = c, b
            out_triangles[t, 0], out_triangles[t, 1], out_triangles[t, 2] = first + a, first + b, first + c
            t += 1
        for row in range(segment_start[slot], segment_start[slot + 1]):
            out_segments[s, 0], out_segments[s, 1] = first + segments[row, 0], first + segments[row, 1]
            s += 1
        if triangle_start[slot] == triangle_start[slot + 1]:
            for row in range(first, v):
                out_points[n_points] = row
                n_points += 1
    return n_points


def place(
    pool: MeshPool, slots: npt.NDArray[np.int64], placements: Placements, placement: npt.NDArray[np.int64]
) -> Soup:
    """The meshes ``slots`` of the pool, each placed by the row ``placement`` of the transforms."""

    def total(start: npt.NDArray[np.int64]) -> int:
        return int((start[slots + 1] - start[slots]).sum())

    n = total(pool.vertex_start)
    positions, normals = np.empty((n, 3)), np.empty((n, 3), np.float32)
    triangles = np.empty((total(pool.triangle_start), 3), np.int32)
    segments = np.empty((total(pool.segment_start), 2), np.int32)
    points = np.empty(n, np.int32)
    n_points = _place(
        slots, placement,
        pool.vertex_start, pool.triangle_start, pool.segment_start,
        pool.positions, pool.normals, pool.triangles, pool.segments,
        placements.points, placements.normals, placements.mirrored,
        positions, normals, triangles, segments, points,
    )  # fmt: skip
    return Soup(positions, normals, triangles, segments, points[:n_points])
