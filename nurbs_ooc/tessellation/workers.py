"""Runs a kernel over ranges of items on several threads; results come back in the order of the items.

Kernels release the interpreter lock, so threads suffice, and since the result for an item does not depend on
the range it is in, it does not depend on the number of threads. The caller's thread works too. Each thread takes
the next range when it is done with one; ranges shrink towards the end, so that all come to an end together::

    thread 0  |-------0-------|-------2-------|---4---|-6-|8|
    thread 1  |--------1--------|------3------|---5---|-7-|
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from nurbs_ooc.geometry.ranges import Run

# Items per call where one thread does them all: what comes out of a call is copied once more if there are several.
ALONE = 8192
# Items per call of several threads: many, for the overhead of a call is some 50 µs, yet few enough to share out.
FACES = 256
EDGES = 512
CURVES = 2048
# A range is at most this part of what is left for each thread.
SHARES = 2
# Ranges end to shrink at this part of the longest, for calls cost something too; of few items, at one.
SHORTEST = 32


def ranges(n: int, workers: int, longest: int) -> list[tuple[int, int]]:
    """Ranges that follow one another from 0 to ``n``, of at most ``longest`` items, shorter towards the end."""
    shortest = max(1, min(longest, n // workers) // SHORTEST)
    found = []
    low = 0
    while low < n:
        size = min(max((n - low) // (SHARES * workers), shortest), longest, n - low)
        found.append((low, low + size))
        low += size
    return found


class Threads:
    """The caller's thread and ``workers - 1`` more, for one run after another; those end when nobody has this any more.

    Args:
        workers: threads that work at the same time; 1 for the caller's alone.
    """

    def __init__(self, workers: int) -> None:
        self.workers = max(1, workers)
        self._others = ThreadPoolExecutor(self.workers - 1) if self.workers > 1 else None

    def runner(self, longest: int) -> Run:
        """A ``Run`` on these threads, with ranges of at most ``longest`` items if there are several."""
        others = self._others
        if others is None:
            return _alone

        def run(kernel: Callable[[int, int], Any], n: int) -> list[Any]:
            parts = ranges(n, self.workers, longest)
            results: list[Any] = [None] * len(parts)
            left = iter(range(len(parts)))  # shared: whoever is free takes the next

            def work() -> None:
                for k in left:
                    results[k] = kernel(*parts[k])

            helpers = [others.submit(work) for _ in range(min(self.workers, len(parts)) - 1)]
            try:
                work()
            finally:
                # After a failure nothing more is begun.
                for _ in left:
                    pass
                for helper in helpers:
                    if not helper.cancel():
                        helper.result()
            return results

        return run


def _alone(kernel: Callable[[int, int], Any], n: int) -> list[Any]:
    return [kernel(low, min(low + ALONE, n)) for low in range(0, n, ALONE)]
