"""The tables of a ``GeometryBatch`` as one tuple of arrays, the form that kernels take."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.bspline import MAX_DEGREE as MAX_DEGREE

CONTIGUOUS: tuple[Literal["C"], Literal["A"], Literal["W"]] = ("C", "A", "W")


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
    return Tables(
        _records(geometry.surfaces),
        _records(geometry.loops),
        _records(geometry.coedges),
        _records(geometry.edges),
        _records(geometry.curves),
        np.require(geometry.vertices, requirements=CONTIGUOUS),
        np.require(geometry.values, requirements=CONTIGUOUS),
    )


def _records(table: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """A table whose rows have their fields as attributes: compiled code has them anyway, plain Python wants a view."""
    table = np.require(table, requirements=CONTIGUOUS)
    return table.view(np.recarray) if numba.config.DISABLE_JIT else table
