"""A perspective camera in float64: axes, frustum, and transforms relative to the eye.

View space has its origin in the eye, x to the right, y up and z *forward*, so that depth is positive
in front of the camera. Everything that reaches the graphics card is first made relative to the eye in
float64 and rounded to float32 afterwards: a model far from the origin stays as sharp as one at it.

Depth is reversed with an infinite far plane: depth = near / z, 1 at the near plane, 0 at infinity.
With a float32 buffer its relative resolution is the same at every distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_client.screen_error import View

Vector = npt.NDArray[np.float64]

MIN_FOV_DEG, MAX_FOV_DEG = 0.01, 170.0


def unit(vector: npt.ArrayLike) -> Vector:
    """(3,) ``vector`` at length 1; zero stays zero."""
    array = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(array))
    return array / length if length > 0 else array


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the viewer is and what the window sees of the scene.

    Attributes:
        eye: (3,) mm, assembly space.
        target: (3,) mm, the point in the middle of the image; not the eye.
        up: (3,) any length; a direction along the line of sight is replaced by a steady choice.
        fov_deg: vertical field of view, degrees.
        width, height: pixels.
        near: mm; what is nearer is not drawn.
    """

    eye: Vector
    target: Vector
    up: Vector
    fov_deg: float
    width: int
    height: int
    near: float = 1e-2

    def __post_init__(self) -> None:
        finite = np.isfinite(np.concatenate([self.eye, self.target, self.up])).all()
        if not finite or float(np.linalg.norm(self.target - self.eye)) == 0.0:
            raise UsageError(f"camera: eye {list(self.eye)} and target {list(self.target)} must be finite and apart")
        if not MIN_FOV_DEG <= self.fov_deg <= MAX_FOV_DEG:
            raise UsageError(f"camera: fov {self.fov_deg} is outside {MIN_FOV_DEG} to {MAX_FOV_DEG} degrees")
        if self.width < 1 or self.height < 1 or not self.near > 0:
            raise UsageError(f"camera: size {self.width}x{self.height} and near {self.near} must be positive")

    def resized(self, width: int, height: int) -> Camera:
        """The same view in a window of another size."""
        return replace(self, width=width, height=height)

    @cached_property
    def rotation(self) -> npt.NDArray[np.float64]:
        """(3, 3) rows right, up, forward: turns assembly directions into view space."""
        forward = unit(self.target - self.eye)
        right = np.cross(forward, unit(self.up))
        if float(np.linalg.norm(right)) < 1e-9:  # looking along "up": any steady direction will do
            right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
        right = unit(right)
        return np.stack([right, np.cross(right, forward), forward])

    @cached_property
    def focal_px(self) -> float:
        """Distance of the image plane in pixels: f = h / (2 tan(fov / 2))."""
        return self.height / (2.0 * math.tan(math.radians(self.fov_deg) / 2.0))

    @cached_property
    def projection(self) -> npt.NDArray[np.float64]:
        """(4, 4) view space to clip space, reversed depth, for column vectors (x, y, z forward, 1)."""
        matrix = np.zeros((4, 4))
        matrix[0, 0] = 2.0 * self.focal_px / self.width
        matrix[1, 1] = 2.0 * self.focal_px / self.height
        matrix[2, 3] = self.near
        matrix[3, 2] = 1.0
        return matrix

    @cached_property
    def frustum_planes(self) -> npt.NDArray[np.float64]:
        """(5, 4) near, left, right, bottom, top: n . (p - eye) + d >= 0 inside, n unit, assembly space."""
        tan_x, tan_y = self.width / (2.0 * self.focal_px), self.height / (2.0 * self.focal_px)
        normals = np.array([[0, 0, 1], [1, 0, tan_x], [-1, 0, tan_x], [0, 1, tan_y], [0, -1, tan_y]], dtype=np.float64)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        planes = np.zeros((5, 4))
        planes[:, :3] = normals @ self.rotation
        planes[0, 3] = -self.near
        return planes

    @cached_property
    def view(self) -> View:
        """The same camera as the arrays that the selection kernels take."""
        tan_x, tan_y = self.width / (2.0 * self.focal_px), self.height / (2.0 * self.focal_px)
        cos_corner = 1.0 / math.sqrt(1.0 + tan_x * tan_x + tan_y * tan_y)
        return View(
            self.eye.astype(np.float64),
            np.ascontiguousarray(self.rotation),
            np.ascontiguousarray(self.frustum_planes),
            self.focal_px,
            self.near,
            cos_corner,
        )

    def to_view(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(n, 3) mm in assembly space to (n, 3) mm in view space."""
        return np.asarray((points - self.eye) @ self.rotation.T)

    def project(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(n, 3) mm in assembly space to (n, 2) pixels from the top left corner; NaN behind the eye."""
        view = self.to_view(points)
        depth = np.where(view[:, 2] > 0, view[:, 2], np.nan)
        x = self.width / 2.0 + self.focal_px * view[:, 0] / depth
        y = self.height / 2.0 - self.focal_px * view[:, 1] / depth
        return np.stack([x, y], axis=1)

    def model_view(
        self, transform: npt.NDArray[np.float64] | None, origin: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float32]:
        """(3, 4) float32 that takes a tile's float32 positions to view space.

        Args:
            transform: (3, 4) of the occurrence, mm; None for tiles that are in assembly space already.
            origin: (3,) mm that the tile's positions are relative to, in the tile's own space.
        """
        linear = np.eye(3) if transform is None else transform[:, :3]
        offset = origin if transform is None else linear @ origin + transform[:, 3]
        matrix = np.empty((3, 4))
        matrix[:, :3] = self.rotation @ linear
        matrix[:, 3] = self.rotation @ (offset - self.eye)
        return matrix.astype(np.float32)
