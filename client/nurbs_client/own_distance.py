"""How near a surface really comes, where its box says nothing because the viewer is inside or beside it.

A surface's box reaches the eye long before the surface does; taken at its word it would ask for an
error of nothing. The triangles of a LOD that is already there know better: each is clipped to the
frustum, and the least millimetres per pixel over what is left holds for the surface too, less what the
LOD's own error may change: |grad g| <= 2 / (sqrt(3) f), see ``screen_error``. No clamp at a
millimetre as in the paper: what is 40 micrometres away is shown as exactly as the rest.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_client.scene import Floats
from nurbs_client.screen_error import CONVEX_COS, GRADIENT, View

MAX_CORNERS = 10  # a triangle gains at most one corner per plane


@helper
def _clip(plane: Floats, margin: float, polygon: Floats, n: int, result: Floats) -> int:
    """Keep the part of a convex polygon, relative to the eye, with n . p + d >= -margin."""
    count = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = plane[3] + margin
        there = plane[3] + margin
        for axis in range(3):
            here += plane[axis] * polygon[i, axis]
            there += plane[axis] * polygon[j, axis]
        if here >= 0.0:
            result[count] = polygon[i]
            count += 1
        if (here >= 0.0) != (there >= 0.0):
            s = here / (here - there)
            for axis in range(3):
                result[count, axis] = polygon[i, axis] + s * (polygon[j, axis] - polygon[i, axis])
            count += 1
    return count


@helper
def _least(view: View, polygon: Floats, n: int) -> float:
    """Least g over a convex polygon in front of the eye, mm per pixel; see ``screen_error``."""
    nearest = math.inf
    least = math.inf
    cosine = 1.0
    for i in range(n):
        x, y, z = polygon[i, 0], polygon[i, 1], polygon[i, 2]
        depth = view.rotation[2, 0] * x + view.rotation[2, 1] * y + view.rotation[2, 2] * z
        distance = max(math.sqrt(x * x + y * y + z * z), 1e-300)
        nearest = min(nearest, depth)
        cosine = min(cosine, max(depth, 0.0) / distance)
        least = min(least, depth * max(depth, 0.0) / distance)
    if nearest > view.near and cosine >= CONVEX_COS:
        return least / view.focal_px
    return max(nearest, view.near) * max(cosine, view.cos_corner) / view.focal_px


@kernel
def _triangles_mm_per_px(
    view: View, transform: Floats, positions: npt.NDArray[np.float32], triangles: npt.NDArray[np.uint32], margin: float
) -> float:
    """Least g over the visible parts of the triangles; inf where none is visible."""
    points = np.empty((len(positions), 3))
    for i in range(len(positions)):
        for axis in range(3):
            total = transform[axis, 3]
            for k in range(3):
                total += transform[axis, k] * positions[i, k]
            points[i, axis] = total
    polygons = np.empty((2, MAX_CORNERS, 3))
    result = math.inf
    for t in range(len(triangles)):
        for corner in range(3):
            polygons[0, corner] = points[triangles[t, corner]]
        n = 3
        source = 0
        for plane in range(len(view.planes)):
            n = _clip(view.planes[plane], margin, polygons[source], n, polygons[1 - source])
            source = 1 - source
            if n == 0:
                break
        if n:
            result = min(result, _least(view, polygons[source], n))
    return result


def own_mm_per_px(
    view: View,
    transform: npt.NDArray[np.float64],
    origin: npt.NDArray[np.float64],
    positions: npt.NDArray[np.float32],
    triangles: npt.NDArray[np.uint32],
    error: float,
) -> float:
    """Least millimetres per pixel of a surface, from one of its LODs.

    Args:
        view: of the camera.
        transform: (3, 4) from the LOD's space to the assembly, mm.
        origin: (3,) mm that the positions are relative to.
        positions: (n, 3) mm.
        triangles: (t, 3) rows in ``positions``.
        error: mm, the LOD's, in assembly space.

    Returns:
        At least the value at the near plane; inf where no part of the surface can be visible.
    """
    placed = transform.astype(np.float64)
    placed[:, 3] = transform[:, :3] @ origin + transform[:, 3] - view.eye
    least = _triangles_mm_per_px(view, placed, positions, triangles, error)
    return max(float(least) - GRADIENT * error / view.focal_px, view.near * view.cos_corner / view.focal_px)
