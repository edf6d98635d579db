"""One mesh of faces that were triangulated one by one, without a promise beyond the error asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_ooc.tessellation.mesh import MeshBatch

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
FaceArrays = tuple[Floats, Floats, Floats, Ints]


def collect_faces(
    faces: Sequence[FaceArrays], error: float, status: npt.NDArray[np.integer], reason: npt.NDArray[np.integer]
) -> MeshBatch:
    """Put faces together.

    Args:
        faces: of each, (n, 3) positions in mm, (n, 3) unit normals, (n, 2) parameters and (t, 3) rows of them.
        error: mm, what was asked for; it stands as every face's surface error, certified by nobody.
        status, reason: (n_faces,) ``FaceStatus`` and ``FaceReason``.

    Returns:
        The mesh, without boundary segments.
    """
    n = len(faces)
    sizes = np.array([(len(f[0]), len(f[3])) for f in faces], np.int64).reshape(-1, 2)
    starts = np.concatenate([np.zeros((1, 2), np.int64), np.cumsum(sizes, axis=0)])
    return MeshBatch(
        faces=np.arange(n),
        vertex_start=starts[:, 0].copy(),
        triangle_start=starts[:, 1].copy(),
        segment_start=np.zeros(n + 1, np.int64),
        positions=np.concatenate([*(f[0] for f in faces), np.empty((0, 3))]),
        normals=np.concatenate([*(f[1] for f in faces), np.empty((0, 3))]),
        parameters=np.concatenate([*(f[2] for f in faces), np.empty((0, 2))]),
        triangles=np.concatenate(
            [*(f[3] + at for f, at in zip(faces, starts[:, 0], strict=False)), np.empty((0, 3), np.int64)]
        ),
        segments=np.empty((0, 2), np.int64),
        surface_error=np.full(n, error),
        trim_error=np.zeros(n),
        pcurve_error=np.zeros(n),
        status=status.astype(np.uint8),
        reason=reason.astype(np.uint16),
    )
