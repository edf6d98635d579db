"""Runs a kernel over ranges of items on several threads; results come back in the order of the items.

Kernels release the interpreter lock, so threads suffice, and since ranges do not depend on the
number of threads, neither do the results.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

# Items per call where one thread does them all: what comes out of a call is copied once more if there are several.
ALONE = 8192
# Items per call: long enough that a call's overhead (some 50 µs) vanishes, short enough to share out.
CHUNK = 64


def chunk_runner(workers: int, chunk: int = CHUNK) -> Callable[[Callable[[int, int], Any], int], list[Any]]:
    """A function ``run(kernel, n)`` that calls ``kernel(low, high)`` over chunks of range(n).

    Args:
        workers: threads; 1 runs in the caller's.
        chunk: items per call of several threads.
    """
    if workers <= 1:
        chunk = ALONE

    def run(kernel: Callable[[int, int], Any], n: int) -> list[Any]:
        ranges = [(low, min(low + chunk, n)) for low in range(0, n, chunk)]
        if workers <= 1 or len(ranges) <= 1:
            return [kernel(low, high) for low, high in ranges]
        with ThreadPoolExecutor(workers) as pool:
            return list(pool.map(lambda r: kernel(*r), ranges))

    return run
