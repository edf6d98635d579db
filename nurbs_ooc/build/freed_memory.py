"""Lets a process give memory back as soon as it is freed.

glibc serves large blocks by mappings of their own, which end when they are freed; but each freed one raises the size
from which it does so, up to 32 MiB, and what is smaller stays with the process. One large job would count
for ever. A fixed threshold turns this off.

Source: mallopt(3), M_MMAP_THRESHOLD and M_TRIM_THRESHOLD.
"""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
THRESHOLD_BYTES = 1 << 20


def return_freed_memory() -> None:
    """Fix the thresholds of this process; does nothing where the C library has none."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, THRESHOLD_BYTES)
        mallopt(_M_TRIM_THRESHOLD, THRESHOLD_BYTES)
