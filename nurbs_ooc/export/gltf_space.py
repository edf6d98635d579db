"""From the project's space (millimetres, z up) to glTF's (metres, y up), and node transforms that glTF allows.

::

    CAD   z   y            glTF  y
          | /                    |
          |/___ x                |___ x        (x, y, z) mm  ->  (x, z, -y) / 1000 m
                                /
                               z

A CAD transform M becomes C M C^-1 with C the map above, so nested nodes stay nested nodes. glTF wants every
node's matrix to be translation * rotation * scale; a matrix with shear is the product of two such nodes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MM_PER_M = 1000.0
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # rows: glTF axes in CAD axes
SHEAR_TOLERANCE = 1e-9  # cosine between columns; gltf-validator refuses from about 1e-6 on


def to_gltf(vectors: Array) -> Array:
    """Turn (n, 3) CAD vectors into glTF's axes, the length unit kept."""
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1)


def from_gltf(vectors: Array) -> Array:
    """Inverse of ``to_gltf``."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=1)


def matrix4(transform: npt.ArrayLike) -> Array:
    """(4, 4) of twelve row-major numbers or a (3, 4) transform."""
    return np.vstack([np.asarray(transform, dtype=float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def stretch(transform: npt.ArrayLike) -> float:
    """Largest factor by which a (3, 4) transform lengthens a vector."""
    return float(np.linalg.norm(np.asarray(transform, dtype=float).reshape(3, 4)[:, :3], ord=2))


def node_chain(transform: Array, origin: Array) -> list[dict[str, Any]]:
    """Properties of glTF nodes, outermost first, that place a mesh whose vertices are relative to ``origin``.

    Args:
        transform: (4, 4) from the mesh's CAD space to its parent's, mm.
        origin: (3,) mm, the point of the mesh's CAD space that is zero in its vertices.

    Returns:
        One dictionary with nothing, ``translation`` or ``matrix``; two where ``transform`` shears.
    """
    linear = transform[:3, :3]
    shift = AXES @ (linear @ origin + transform[:3, 3]) / MM_PER_M
    linear = AXES @ linear @ AXES.T
    if _is_trs(linear):
        return [_properties(linear, shift)]
    left, scale, right = np.linalg.svd(linear)
    return [_properties(left * scale, shift), _properties(right, np.zeros(3))]


def _is_trs(linear: Array) -> bool:
    """Whether the columns are mutually orthogonal, so that the matrix is a rotation times a scale."""
    gram = linear.T @ linear
    lengths = np.sqrt(np.diag(gram))
    off_diagonal = np.abs(gram - np.diag(np.diag(gram)))
    return bool((off_diagonal <= SHEAR_TOLERANCE * np.outer(lengths, lengths) + math.ulp(0.0)).all())


def _properties(linear: Array, shift: Array) -> dict[str, Any]:
    if np.array_equal(linear, np.eye(3)):
        return {"translation": shift.tolist()} if shift.any() else {}
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    return {"matrix": (matrix.T.ravel() + 0.0).tolist()}  # column-major; + 0.0 turns -0 into 0
