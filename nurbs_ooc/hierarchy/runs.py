"""Rows of many ranges at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def run_rows(start: npt.ArrayLike, count: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """``start[0], start[0] + 1, ... (count[0] rows), start[1], ...`` as one int64 array."""
    first, length = np.asarray(start, np.int64), np.asarray(count, np.int64)
    within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
    return np.repeat(first, length) + within
