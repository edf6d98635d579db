"""A part moved to its place for good: what a file without occurrences has, every placement its own surfaces."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch

Array = npt.NDArray[np.float64]


class Baker:
    """Moves copies of one part.

    Args:
        geometry: NURBS surfaces only, as everything here is.
    """

    def __init__(self, geometry: GeometryBatch) -> None:
        self._geometry = geometry
        s, c = geometry.surfaces, geometry.curves
        in_space = c["dim"] == 3
        assert (c["kind"][in_space] == CurveKind.NURBS).all()
        first = np.concatenate([s["points"], c["points"][in_space]])
        count = np.concatenate([s["n_u"].astype(np.int64) * s["n_v"], c["n"][in_space].astype(np.int64)])
        rational = np.concatenate([s["rational"], c["rational"][in_space]]).astype(bool)
        self._plain = _point_rows(first[~rational], count[~rational], 3)
        self._weighted = _point_rows(first[rational], count[rational], 4)

    def moved(self, place: Array) -> GeometryBatch:
        """The part under ``place`` (3, 4); mirrored faces are turned inside out so that outside stays outside."""
        g, linear, offset = self._geometry, place[:, :3], place[:, 3]
        values = g.values.copy()
        values[self._plain] = g.values[self._plain] @ linear.T + offset
        weighted = g.values[self._weighted]
        values[self._weighted[:, :3]] = weighted[:, :3] @ linear.T + weighted[:, 3:] * offset
        surfaces = g.surfaces
        if np.linalg.det(linear) < 0.0:
            surfaces = surfaces.copy()
            surfaces["reversed"] ^= 1
        return dataclasses.replace(g, surfaces=surfaces, values=values, vertices=g.vertices @ linear.T + offset)


def _point_rows(first: npt.NDArray[np.int64], count: npt.NDArray[np.int64], width: int) -> npt.NDArray[np.int64]:
    """(n, width) offsets of the numbers of all control points, each once."""
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    point = np.arange(total) - np.repeat(ends - count, count)
    starts = np.unique(np.repeat(first, count) + width * point)
    return np.asarray(starts[:, None] + np.arange(width))
