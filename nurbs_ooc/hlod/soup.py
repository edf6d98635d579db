"""The primitives of a node before they are simplified, and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Soup:
    """Triangles, boundary lines and points over one set of vertices, in assembly space.

    Attributes:
        positions: (n, 3) float64, mm.
        normals: (n, 3) float32, unit.
        triangles: (t, 3) int32 rows of vertices, counter-clockwise from outside.
        lines: (l, 2) int32: boundary segments.
        points: (p,) int32: vertices that stand for something smaller than a pixel.
    """

    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    lines: npt.NDArray[np.int32]
    points: npt.NDArray[np.int32]
