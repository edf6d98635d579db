"""Triangles of many faces in one set of arrays, with the error that each face promises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


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

    @property
    def certified_error(self) -> npt.NDArray[np.float64]:
        """(n,) mm: bound of the symmetric Hausdorff distance of each face to its triangles."""
        return self.surface_error + self.trim_error + self.pcurve_error
