"""Triangles of many faces in one set of arrays, with the error that each face promises."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

NOT_ASKED: npt.NDArray[np.float64] = np.empty(0)


def _not_asked() -> npt.NDArray[np.float64]:
    return NOT_ASKED


@dataclass(frozen=True, eq=False)
class MeshBatch:
    """What ``tessellate`` returns for the rows ``faces`` of a ``GeometryBatch``.

    Face ``i`` owns the vertices ``vertex_start[i]:vertex_start[i + 1]``, the triangles
    ``triangle_start[i]:triangle_start[i + 1]`` and the boundary segments
    ``segment_start[i]:segment_start[i + 1]``. Faces share no vertex rows, but where two faces meet
    their boundary vertices have bit-identical positions.

    Attributes:
        faces: (n,) int64, rows in the geometry batch.
        positions: (n_vertices, 3) float64, mm, part space.
        normals: (n_vertices, 3) float64, unit, to the outside of the face; never NaN.
        parameters: (n_vertices, 2) float64, native (u, v) of the surface.
        triangles: (n_triangles, 3) int64 rows in ``positions``, counter-clockwise from outside.
        segments: (n_segments, 2) int64 rows in ``positions``: the face's boundary, for lines.
        surface_error, trim_error, pcurve_error: (n,) float64, mm: the ledger's first three terms;
            their sum bounds the distance between the face and its triangles in both directions.
        normal_error: (n,) float64, degrees: bound of the angle between normals interpolated in the triangles and
            the surface's, 180 where there is none; (0,) if it was not asked for.
        appearance_error: (n,) float64, mm: bound of the error of distance and shading combined, without trim and
            p-curve terms; (0,) if it was not asked for.
        status: (n,) uint8 ``FaceStatus``; reason: (n,) uint16 ``FaceReason`` (reader's included).
    """

    faces: npt.NDArray[np.int64]
    vertex_start: npt.NDArray[np.int64]
    triangle_start: npt.NDArray[np.int64]
    segment_start: npt.NDArray[np.int64]
    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]
    parameters: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    segments: npt.NDArray[np.int64]
    surface_error: npt.NDArray[np.float64]
    trim_error: npt.NDArray[np.float64]
    pcurve_error: npt.NDArray[np.float64]
    status: npt.NDArray[np.uint8]
    reason: npt.NDArray[np.uint16]
    normal_error: npt.NDArray[np.float64] = field(default_factory=_not_asked)
    appearance_error: npt.NDArray[np.float64] = field(default_factory=_not_asked)

    @property
    def certified_error(self) -> npt.NDArray[np.float64]:
        """(n,) mm: bound of the symmetric Hausdorff distance of each face to its triangles."""
        return self.surface_error + self.trim_error + self.pcurve_error


def _rows(
    start: npt.NDArray[np.int64], at: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows start[i]:start[i + 1] of all i in ``at``, one after the other, and where each one's begin."""
    counts = start[at + 1] - start[at]
    begins = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return np.arange(begins[-1]) + np.repeat(start[at] - begins[:-1], counts), begins


def take_faces(mesh: MeshBatch, at: npt.NDArray[np.int64]) -> MeshBatch:
    """The mesh of the faces at places ``at`` (n,) of ``mesh.faces``, in that order."""
    vertices, vertex_start = _rows(mesh.vertex_start, at)
    triangles, triangle_start = _rows(mesh.triangle_start, at)
    segments, segment_start = _rows(mesh.segment_start, at)
    shift = vertex_start[:-1] - mesh.vertex_start[at]
    return MeshBatch(
        faces=mesh.faces[at],
        vertex_start=vertex_start,
        triangle_start=triangle_start,
        segment_start=segment_start,
        positions=mesh.positions[vertices],
        normals=mesh.normals[vertices],
        parameters=mesh.parameters[vertices],
        triangles=mesh.triangles[triangles] + np.repeat(shift, np.diff(triangle_start))[:, None],
        segments=mesh.segments[segments] + np.repeat(shift, np.diff(segment_start))[:, None],
        surface_error=mesh.surface_error[at],
        trim_error=mesh.trim_error[at],
        pcurve_error=mesh.pcurve_error[at],
        status=mesh.status[at],
        reason=mesh.reason[at],
        normal_error=mesh.normal_error[at] if len(mesh.normal_error) else NOT_ASKED,
        appearance_error=mesh.appearance_error[at] if len(mesh.appearance_error) else NOT_ASKED,
    )
