"""Which meshes nodes need: (level, surface) keys, found by surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

LEVEL_SHIFT = np.uint64(48)  # a mesh key is (level + LEVEL_ZERO) << 48 | surface id
LEVEL_ZERO = 1024
SURFACE_MASK = np.uint64((1 << 48) - 1)

Keys = npt.NDArray[np.uint64]


def mesh_keys(surfaces: npt.NDArray[np.uint64], levels: npt.NDArray[np.int64]) -> Keys:
    """One sortable number for each (level in surface space, surface)."""
    return ((levels + LEVEL_ZERO).astype(np.uint64) << LEVEL_SHIFT) | surfaces


def key_levels(keys: Keys) -> npt.NDArray[np.int64]:
    """The levels of mesh keys."""
    return (keys >> LEVEL_SHIFT).astype(np.int64) - LEVEL_ZERO


def key_surfaces(keys: Keys) -> npt.NDArray[np.int64]:
    """The surface ids of mesh keys."""
    return (keys & SURFACE_MASK).astype(np.int64)


class MeshDemand:
    """A set of mesh keys.

    Args:
        keys: each once, in any order.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys[np.argsort(keys & SURFACE_MASK, kind="stable")]

    def __len__(self) -> int:
        return len(self._keys)

    def of_surfaces(self, first: int, count: int) -> Keys:
        """The keys of the surfaces ``first`` to ``first + count``, ascending."""
        bounds = np.array([first, first + count], np.uint64)
        low, high = np.searchsorted(self._keys & SURFACE_MASK, bounds)
        return np.sort(self._keys[low:high])
