"""How large an error in millimetres may be so that it stays below so many pixels.

A point at depth z (along the line of sight) and distance d from the eye that moves by eps moves in the
image by at most::

    f d / z^2 * eps          f = h / (2 tan(fov / 2)), the focal length in pixels

which is the largest singular value of the projection's derivative; the direction that shows it is the
one across the ray, in the plane of ray and line of sight. Off the axis that is d / z = 1 / cos(theta)
times more than in the middle of the image at the same depth. The allowed error for tau pixels is then
tau g with g = z^2 / (f d), millimetres per pixel.

Over a box the worst point counts, the least g = z cos(theta) / f:

* Where the whole box is within tan(theta) <= 1 / sqrt(2) of the axis, g is quasi-concave (the set
  rho <= z sqrt(z^2 / s^2 - 1) is convex up to that cone), so the least value is at a corner.
* Otherwise z at the nearest corner times cos(theta) at the outermost corner is a lower bound. Only
  what is visible counts: theta is at most that of the image's corner, z at least the near plane's, and
  at least the distance of the box times the cosine of the image's corner (a box that crosses the eye's
  plane far to the side is not near).

A displacement is not infinitely small. |grad g| <= 2 / (sqrt(3) f) everywhere, so along a path of
length eps g shrinks by at most that much, and eps <= tau g / (1 + 2 tau / (sqrt(3) f)) is safe.

Source: M. Guthe, A. Balazs, R. Klein, "Real-time out-of-core trimmed NURBS rendering and editing", 2004,
section 4.1, whose distance-only form is exact in the middle of the image; the derivation is our own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel

CONVEX_COS = math.sqrt(2.0 / 3.0)  # cos(theta) at tan(theta) = 1 / sqrt(2)
GRADIENT = 2.0 / math.sqrt(3.0)  # bound of |grad(z cos(theta))|, reached at cos^2 = 2/3


class View(NamedTuple):
    """What the kernels know of a camera."""

    eye: npt.NDArray[np.float64]  # (3,) mm
    rotation: npt.NDArray[np.float64]  # (3, 3) rows right, up, forward
    planes: npt.NDArray[np.float64]  # (5, 4) of the frustum, relative to the eye
    focal_px: float
    near: float  # mm
    cos_corner: float  # cosine of the angle between the axis and the image's corner


@helper
def box_is_outside(view: View, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> bool:
    """True if the box is behind one of the frustum's planes; False does not promise that it is visible."""
    for plane in range(view.planes.shape[0]):
        reach = view.planes[plane, 3]
        for axis in range(3):
            normal = view.planes[plane, axis]
            reach += normal * ((high[axis] if normal > 0.0 else low[axis]) - view.eye[axis])
        if reach < 0.0:
            return True
    return False


@helper
def box_distance(view: View, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> float:
    """Distance from the eye to a box, mm; 0 inside."""
    total = 0.0
    for axis in range(3):
        gap = max(low[axis] - view.eye[axis], view.eye[axis] - high[axis], 0.0)
        total += gap * gap
    return math.sqrt(total)


@helper
def box_mm_per_px(view: View, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> float:
    """Least g = z^2 / (f d) over the visible part of a box, mm per pixel (see the module)."""
    nearest = math.inf
    least = math.inf
    cosine = 1.0
    for corner in range(8):
        x = (high[0] if corner & 1 else low[0]) - view.eye[0]
        y = (high[1] if corner & 2 else low[1]) - view.eye[1]
        z = (high[2] if corner & 4 else low[2]) - view.eye[2]
        depth = view.rotation[2, 0] * x + view.rotation[2, 1] * y + view.rotation[2, 2] * z
        distance = math.sqrt(x * x + y * y + z * z)
        nearest = min(nearest, depth)
        if depth > 0.0:
            cosine = min(cosine, depth / distance)
            least = min(least, depth * depth / distance)
        else:
            cosine = 0.0
    if nearest > view.near and cosine >= CONVEX_COS:
        return least / view.focal_px
    depth = max(nearest, view.near, box_distance(view, low, high) * view.cos_corner)
    return depth * max(cosine, view.cos_corner) / view.focal_px


@helper
def allowed_error(mm_per_px: float, target_px: float, focal_px: float) -> float:
    """Largest error, mm, that stays within ``target_px`` wherever ``mm_per_px`` holds."""
    return target_px * mm_per_px / (1.0 + GRADIENT * target_px / focal_px)


@kernel
def _boxes_mm_per_px(
    view: View, lows: npt.NDArray[np.float64], highs: npt.NDArray[np.float64], result: npt.NDArray[np.float64]
) -> None:
    for box in range(len(result)):
        result[box] = (
            math.inf if box_is_outside(view, lows[box], highs[box]) else box_mm_per_px(view, lows[box], highs[box])
        )


def boxes_mm_per_px(
    view: View, lows: npt.NDArray[np.float64], highs: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """(n,) least millimetres per pixel over each of n boxes given by (n, 3) corners; inf outside the frustum."""
    result = np.empty(len(lows))
    _boxes_mm_per_px(view, np.ascontiguousarray(lows), np.ascontiguousarray(highs), result)
    return result


@kernel
def desired_error(mm_per_px: float, target_px: float, focal_px: float) -> float:
    """Largest error, mm, of a node that shows at most ``target_px`` pixels: the paper's epsilon_desired."""
    return allowed_error(mm_per_px, target_px, focal_px)


def screen_error_px(
    mm_per_px: npt.NDArray[np.float64], error: npt.NDArray[np.float64], focal_px: float
) -> npt.NDArray[np.float64]:
    """(n,) pixels that errors in mm may show, the inverse of ``desired_error``; inf where no bound exists."""
    room = mm_per_px - GRADIENT * error / focal_px
    return np.where(room > 0, error / np.where(room > 0, room, 1.0), np.inf)
