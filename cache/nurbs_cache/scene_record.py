"""The assembly around the surfaces: products, materials and placed parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

OCCURRENCE_DTYPE = np.dtype(
    [
        ("part", "i4"),  # row in the scene's parts
        ("product", "i4"),  # row in the scene's products: the leaf that is placed
        ("material", "i4"),  # override for every surface of the part, -1: their own
        ("transform", "f8", (3, 4)),  # part to assembly: x' = T[:, :3] x + T[:, 3], mm
    ],
    align=True,
)


@dataclass(frozen=True)
class Product:
    """One node of the product tree, as placed: parents come before their children.

    Attributes:
        name: as in the file, never empty.
        parent: row of the parent in the scene's products, -1 for a root.
        transform: twelve numbers, row-major 3 x 4, from this node to its parent, mm.
    """

    name: str
    parent: int
    transform: tuple[float, ...]


@dataclass(frozen=True)
class Material:
    """A colour as the file gives it. ``rgba`` is linear, each 0 to 1."""

    name: str
    rgba: tuple[float, float, float, float]


DEFAULT_MATERIAL = Material("default", (0.55, 0.57, 0.60, 1.0))


@dataclass(frozen=True)
class PartInfo:
    """What is known of a part without loading its geometry."""

    name: str
    n_surfaces: int
    first_surface: int  # id of its first surface; ids run on through all parts
