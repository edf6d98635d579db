"""The tables of a ``GeometryBatch`` as one tuple of arrays, the form that kernels take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch

MAX_DEGREE = 30  # scratch arrays are sized by it; the reader refuses more


class Tables(NamedTuple):
    """Arrays of a ``GeometryBatch``, in its order and with its meaning."""

    surfaces: npt.NDArray[np.void]
    loops: npt.NDArray[np.void]
    coedges: npt.NDArray[np.void]
    edges: npt.NDArray[np.void]
    curves: npt.NDArray[np.void]
    vertices: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]


def tables(geometry: GeometryBatch) -> Tables:
    """The arrays of ``geometry``, contiguous and writable so that kernels see one type only."""
    arrays = (
        geometry.surfaces,
        geometry.loops,
        geometry.coedges,
        geometry.edges,
        geometry.curves,
        geometry.vertices,
        geometry.values,
    )
    return Tables(*(np.require(a, requirements=["C", "A", "W"]) for a in arrays))
