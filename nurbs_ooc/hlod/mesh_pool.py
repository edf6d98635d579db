"""Tessellations of many surfaces in one block of memory or of a file, and their placement in a node.

A surface is tessellated once per error level in part space, whatever number of nodes and occurrences
show it. The meshes lie one after another in 8-byte words, each with a row of a table::

    slots   key, first word, counts, errors, ...          words
      0     (level, surface)  -----------------> | positions f8 | normals f4 | triangles i4 | segments i4 |
      1     ...               -----------------> | positions ...

``place`` copies the meshes of one node, transformed, into a ``Soup``.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_ooc.hierarchy.placements import Placements
from nurbs_ooc.hlod.soup import Soup
from nurbs_ooc.tessellation.mesh import MeshBatch

SLOT_DTYPE = np.dtype(
    [
        ("key", "u8"),  # whatever tells meshes apart; ascending where they are searched
        ("first_word", "i8"),  # in the pool's words
        ("n_vertices", "i4"),
        ("n_triangles", "i4"),
        ("n_segments", "i4"),
        ("checksum", "u4"),  # crc32 of the mesh's words
        ("errors", "f8", (3,)),  # mm, part space: surface, trim and p-curve error
        ("reason", "u2"),  # FaceReason
        ("status", "u1"),  # FaceStatus
    ],
    align=True,
)

Words = npt.NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class MeshPool:
    """Meshes by slot.

    Attributes:
        slots: (n,) ``SLOT_DTYPE``.
        words: (m,) uint64: of each slot the positions (3 float64 a vertex, mm, part space), normals
            (3 float32 a vertex, outward), triangles (3 int32, rows counted from the slot's first vertex)
            and boundary segments (2 int32, likewise); the last three begin at whole words.
    """

    slots: npt.NDArray[np.void]
    words: Words

    def __len__(self) -> int:
        return len(self.slots)

    @classmethod
    def of_mesh(cls, mesh: MeshBatch, keys: npt.NDArray[np.uint64]) -> MeshPool:
        """One slot per face of ``mesh``, with these keys."""
        slots = np.zeros(len(keys), SLOT_DTYPE)
        slots["key"] = keys
        slots["n_vertices"] = np.diff(mesh.vertex_start)
        slots["n_triangles"] = np.diff(mesh.triangle_start)
        slots["n_segments"] = np.diff(mesh.segment_start)
        slots["errors"] = np.stack([mesh.surface_error, mesh.trim_error, mesh.pcurve_error], axis=1)
        slots["reason"], slots["status"] = mesh.reason, mesh.status
        ends = np.cumsum(slot_words(slots))
        slots["first_word"] = ends - slot_words(slots)
        words = np.zeros(int(ends[-1]) if len(ends) else 0, np.uint64)
        _pack(
            slots, mesh.vertex_start, mesh.triangle_start, mesh.segment_start, mesh.positions, mesh.normals,
            mesh.triangles, mesh.segments, words.view(np.float64), words.view(np.float32), words.view(np.int32),
        )  # fmt: skip
        mapped = words.data
        slots["checksum"] = [zlib.crc32(mapped[first:end]) for first, end in itertools.pairwise([0, *ends.tolist()])]
        return cls(slots, words)

    @classmethod
    def join(cls, pools: Sequence[MeshPool]) -> MeshPool:
        """All slots of the first pool, then those of the second, ..."""
        slots = np.concatenate([np.zeros(0, SLOT_DTYPE), *(pool.slots for pool in pools)])
        shifts = np.cumsum([0, *(len(pool.words) for pool in pools)])[:-1]
        slots["first_word"] += np.repeat(shifts, [len(pool) for pool in pools])
        return cls(slots, np.concatenate([np.zeros(0, np.uint64), *(pool.words for pool in pools)]))

    def by_key(self) -> MeshPool:
        """The same meshes with ascending keys."""
        return MeshPool(self.slots[np.argsort(self.slots["key"])], self.words)


def slot_words(slots: npt.NDArray[np.void]) -> npt.NDArray[np.int64]:
    """(n,) 8-byte words that each slot takes."""
    vertices, triangles = slots["n_vertices"].astype(np.int64), slots["n_triangles"].astype(np.int64)
    return 3 * vertices + (3 * vertices + 1) // 2 + (3 * triangles + 1) // 2 + slots["n_segments"]


@leaf
def _starts(slot: np.void) -> tuple[int, int, int, int]:
    """First position (float64), normal (float32), triangle and segment (int32) number of a slot."""
    position = slot["first_word"]
    normal = position + 3 * np.int64(slot["n_vertices"])
    triangle = normal + (3 * np.int64(slot["n_vertices"]) + 1) // 2
    segment = triangle + (3 * np.int64(slot["n_triangles"]) + 1) // 2
    return position, 2 * normal, 2 * triangle, 2 * segment


@kernel
def _pack(
    slots: npt.NDArray[np.void],
    vertex_start: npt.NDArray[np.int64],
    triangle_start: npt.NDArray[np.int64],
    segment_start: npt.NDArray[np.int64],
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    triangles: npt.NDArray[np.int64],
    segments: npt.NDArray[np.int64],
    doubles: npt.NDArray[np.float64],
    floats: npt.NDArray[np.float32],
    ints: npt.NDArray[np.int32],
) -> None:
    """Copy every face's arrays to its slot."""
    for i in range(len(slots)):
        position, normal, triangle, segment = _starts(slots[i])
        first = vertex_start[i]
        for row in range(first, vertex_start[i + 1]):
            for axis in range(3):
                doubles[position + 3 * (row - first) + axis] = positions[row, axis]
                floats[normal + 3 * (row - first) + axis] = normals[row, axis]
        for row in range(triangle_start[i], triangle_start[i + 1]):
            for k in range(3):
                ints[triangle + 3 * (row - triangle_start[i]) + k] = triangles[row, k] - first
        for row in range(segment_start[i], segment_start[i + 1]):
            for k in range(2):
                ints[segment + 2 * (row - segment_start[i]) + k] = segments[row, k] - first


@kernel
def _place(
    slots: npt.NDArray[np.void],
    placement: npt.NDArray[np.int64],
    doubles: npt.NDArray[np.float64],
    floats: npt.NDArray[np.float32],
    ints: npt.NDArray[np.int32],
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
        position, normal, triangle, segment = _starts(slots[i])
        matrix, turn = point_matrix[placement[i]], normal_matrix[placement[i]]
        first = v
        for _ in range(slots[i]["n_vertices"]):
            length = 0.0
            for axis in range(3):
                p, n = matrix[axis, 3], 0.0
                for k in range(3):
                    p += matrix[axis, k] * doubles[position + k]
                    n += turn[axis, k] * floats[normal + k]
                out_positions[v, axis], out_normals[v, axis] = p, n
                length += n * n
            if length > 0.0:
                for axis in range(3):
                    out_normals[v, axis] /= np.sqrt(length)
            v += 1
            position += 3
            normal += 3
        for _ in range(slots[i]["n_triangles"]):
            a, b, c = ints[triangle], ints[triangle + 1], ints[triangle + 2]
            if mirrored[placement[i]]:
                b, c = c, b
            out_triangles[t, 0], out_triangles[t, 1], out_triangles[t, 2] = first + a, first + b, first + c
            t += 1
            triangle += 3
        for _ in range(slots[i]["n_segments"]):
            out_segments[s, 0], out_segments[s, 1] = first + ints[segment], first + ints[segment + 1]
            s += 1
            segment += 2
        if slots[i]["n_triangles"] == 0:
            for row in range(first, v):
                out_points[n_points] = row
                n_points += 1
    return n_points


@kernel
def _counts(slots: npt.NDArray[np.void]) -> tuple[int, int, int]:
    """Vertices, triangles and segments of some slots."""
    vertices, triangles, segments = 0, 0, 0
    for i in range(len(slots)):
        vertices += slots[i]["n_vertices"]
        triangles += slots[i]["n_triangles"]
        segments += slots[i]["n_segments"]
    return vertices, triangles, segments


def place(
    pool: MeshPool,
    taken: npt.NDArray[np.void],
    placements: Placements,
    placement: npt.NDArray[np.int64],
    extra: int = 0,
) -> Soup:
    """Meshes of the pool, the i-th placed by the row ``placement[i]`` of the transforms.

    Args:
        pool: has their words.
        taken: (n,) ``SLOT_DTYPE``: their slots.
        placements: one row per occurrence.
        placement: (n,) rows in it.
        extra: so many points more, the last vertices; the caller fills in their positions and normals.
    """
    n_meshed, n_triangles, n_segments = _counts(taken)
    n = n_meshed + extra
    positions, normals = np.empty((n, 3)), np.empty((n, 3), np.float32)
    triangles, segments = np.empty((n_triangles, 3), np.int32), np.empty((n_segments, 2), np.int32)
    points = np.empty(n, np.int32)
    n_points = _place(
        taken, placement, pool.words.view(np.float64), pool.words.view(np.float32), pool.words.view(np.int32),
        placements.points, placements.normals, placements.mirrored,
        positions, normals, triangles, segments, points,
    )  # fmt: skip
    points[n_points : n_points + extra] = np.arange(n - extra, n)
    return Soup(positions, normals, triangles, segments, points[: n_points + extra])
