"""Faces of a batch where they stand in an assembly: exact points and tangents under each face's placement.

Source: the evaluation of ``exact_surface``; a placement maps x to T[:, :3] x + T[:, 3].
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.exact_curve import MAX_DEGREE
from nurbs_ooc.measure.exact_surface import surface_point

IDENTITY = np.eye(3, 4)

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@leaf
def placed_point(tables, row, transform, u, v, scratch, out) -> None:  # type: ignore[no-untyped-def]
    """``out`` rows become S, S_u and S_v of the placed surface; ``tables`` are surfaces, curves and values."""
    surfaces, curves, values = tables
    surface_point(surfaces, curves, values, row, u, v, scratch, out)
    for i in range(3):
        x, y, z = out[i, 0], out[i, 1], out[i, 2]
        for k in range(3):
            out[i, k] = transform[k, 0] * x + transform[k, 1] * y + transform[k, 2] * z
    for k in range(3):
        out[0, k] += transform[k, 3]


@kernel
def _points(surfaces, curves, values, rows, transforms, faces, uv, out):  # type: ignore[no-untyped-def]
    scratch = np.empty((3, 2, MAX_DEGREE + 1))
    tables = (surfaces, curves, values)
    for i in range(len(faces)):
        f = faces[i]
        placed_point(tables, rows[f], transforms[f], uv[i, 0], uv[i, 1], scratch, out[i])


class PlacedFaces:
    """Some faces of a batch, each with a placement; later calls name a face by its index in here.

    Args:
        geometry: holds the surfaces.
        rows: (f,) rows of ``geometry.surfaces``; a row may stand at several places.
        transforms: (f, 3, 4) placements; left out: every face stands where its record says.
    """

    def __init__(self, geometry: GeometryBatch, rows: npt.ArrayLike, transforms: Floats | None = None) -> None:
        self.geometry = geometry
        self.rows: Indices = np.array(rows, np.int64).reshape(-1)
        self.transforms: Floats = np.ascontiguousarray(
            np.broadcast_to(IDENTITY if transforms is None else transforms, (len(self.rows), 3, 4)), np.float64
        )

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def tables(self) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void], Floats, Indices, Floats]:
        """What kernels take: surfaces, curves, values, rows, transforms."""
        g = self.geometry
        return g.surfaces, g.curves, g.values, self.rows, self.transforms

    def derivatives(self, face: npt.ArrayLike, uv: npt.ArrayLike) -> Floats:
        """(n, 3, 3) placed S, S_u, S_v of faces (an index, or (n,) indices) at (n, 2) native parameters."""
        at = np.ascontiguousarray(uv, float).reshape(-1, 2)
        of = np.ascontiguousarray(np.broadcast_to(np.asarray(face, np.int64), len(at)))
        out = np.empty((len(at), 3, 3))
        _points(*self.tables, of, at, out)
        return out

    def points(self, face: npt.ArrayLike, uv: npt.ArrayLike) -> Floats:
        """(n, 3) placed points, mm; arguments as for ``derivatives``."""
        return self.derivatives(face, uv)[:, 0]
