"""Open addressing in plain arrays: the set operations that clustering needs, one pass each.

A table is an array of uint64 keys whose length is a power of two, filled with ``EMPTY``. Slots are
found by Fibonacci hashing and linear probing.

Source: D. E. Knuth, "The Art of Computer Programming", vol. 3, 6.4 (multiplicative hashing, algorithm L).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, leaf

EMPTY = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
GOLDEN = np.uint64(0x9E37_79B9_7F4A_7C15)  # 2**64 divided by the golden ratio


@helper
def new_table(n: int) -> npt.NDArray[np.uint64]:
    """An empty table for ``n`` keys, at most half full."""
    size = 8
    while size < 2 * n:
        size *= 2
    return np.full(size, EMPTY, np.uint64)


@leaf
def find_slot(table: npt.NDArray[np.uint64], key: np.uint64) -> int:
    """The slot that holds ``key``, or the empty one where it belongs."""
    mask = len(table) - 1
    slot = int((key * GOLDEN) >> np.uint64(32)) & mask
    while table[slot] != EMPTY and table[slot] != key:
        slot = (slot + 1) & mask
    return slot


@helper
def pair_key(a: int, b: int) -> np.uint64:
    """Key of an unordered pair of rows below 2**31."""
    low, high = min(a, b), max(a, b)
    return (np.uint64(low) << np.uint64(32)) | np.uint64(high)
