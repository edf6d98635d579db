"""Arrays of the kernel as numpy arrays, by index: their Python iterators are seven times slower."""

from __future__ import annotations

from typing import Any

import numpy as np

from nurbs_ooc.geometry.forms import Array


def numbers(array: Any) -> Array:
    """(n,) from an ``Array1_double``."""
    value = array.Value
    return np.array([value(i) for i in range(array.Lower(), array.Upper() + 1)])


def points(array: Any) -> Array:
    """(n, dim) from an ``Array1_gp_Pnt`` or ``Array1_gp_Pnt2d``."""
    value = array.Value
    return np.array([value(i).Coord() for i in range(array.Lower(), array.Upper() + 1)])


def grid_points(array: Any) -> Array:
    """(n_u, n_v, 3) from an ``Array2_gp_Pnt``."""
    value = array.Value
    columns = range(array.LowerCol(), array.UpperCol() + 1)
    rows = [[value(i, j).Coord() for j in columns] for i in range(array.LowerRow(), array.UpperRow() + 1)]
    return np.array(rows)
