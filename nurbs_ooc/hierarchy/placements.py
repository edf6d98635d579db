"""How occurrences place points, normals and triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Placements:
    """Transforms in the three forms that meshes need.

    Attributes:
        points: (m, 3, 4) float64, part to assembly.
        normals: (m, 3, 3) float64, for outward normals.
        mirrored: (m,) bool: triangles turn around.
        stretch: (m,) float64: the largest stretch of a length.
    """

    points: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]
    mirrored: npt.NDArray[np.bool_]
    stretch: npt.NDArray[np.float64]

    @classmethod
    def of_transforms(cls, transforms: npt.NDArray[np.float64]) -> Placements:
        """From (m, 3, 4) transforms; all may mirror, scale and shear."""
        linear = transforms[:, :, :3]
        cofactors = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])
        mirrored = np.linalg.det(linear) < 0
        sign = np.where(mirrored, -1.0, 1.0)
        stretch = np.linalg.norm(linear, 2, axis=(1, 2)) if len(linear) else np.zeros(0)
        return cls(np.ascontiguousarray(transforms), cofactors * sign[:, None, None], mirrored, stretch)
