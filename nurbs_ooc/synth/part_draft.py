"""A part with its places in the assembly, before it is numbered and stored."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder

Array = npt.NDArray[np.float64]

STAY: Array = np.eye(3, 4)
MIRRORED: Array = np.diag([1.0, -1.0, 1.0, 1.0])[:3]


@dataclass(eq=False)
class PartDraft:
    """One part.

    Attributes:
        name: of the part.
        group: names of the products above it, from the top.
        builder: its geometry.
        places: (3, 4) part to car, mm, one per placement; may mirror.
    """

    name: str
    group: tuple[str, ...]
    builder: BulkBuilder
    places: list[Array] = field(default_factory=lambda: [STAY])


def shift(x: float, y: float, z: float) -> Array:
    """(3, 4) a translation, mm."""
    return np.concatenate([np.eye(3), [[x], [y], [z]]], axis=1)


def turn(axis: int, angle: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """(3, 4) a rotation about coordinate axis ``axis`` by ``angle`` (radians), then a translation."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = shift(x, y, z)
    out[i, i] = out[j, j] = np.cos(angle)
    out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
    return out


def chained(outer: Array, inner: Array) -> Array:
    """(3, 4) ``inner`` first, then ``outer``."""
    return np.concatenate([outer[:, :3] @ inner[:, :3], (outer[:, :3] @ inner[:, 3] + outer[:, 3])[:, None]], axis=1)
