"""Threads that share the work of kernels.

Kernels release the interpreter lock, so threads suffice, and since the result for an item does not depend on who
does it, it does not depend on the number of threads. The caller's thread works too. Each thread takes the next range of
items when it is done with one; ranges shrink towards the end, so that all come to an end together::

    thread 0  |-------0-------|-------2-------|---4---|-6-|8|
    thread 1  |--------1--------|------3------|---5---|-7-|
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

from nurbs_ooc.geometry.ranges import Run

T = TypeVar("T")


class Lengths(NamedTuple):
    """Items per call: many, for the overhead of a call is some 20 µs, yet few enough to share out."""

    longest: int
    shortest: int


SURFACES = Lengths(256, 4)
EDGES = Lengths(512, 8)
CURVES = Lengths(2048, 128)
CHUNKS = Lengths(1, 1)
ALONE = Lengths(8192, 8192)  # where one thread does them all
# A range is at most this part of what is left for each thread.
SHARES = 2


def ranges(n: int, workers: int, lengths: Lengths) -> list[tuple[int, int]]:
    """Ranges that follow one another from 0 to ``n``, shorter towards the end."""
    found = []
    low = 0
    while low < n:
        size = min(max((n - low) // (SHARES * workers), lengths.shortest), lengths.longest, n - low)
        found.append((low, low + size))
        low += size
    return found


def _interrupted(error: SystemError) -> bool:
    """Whether Ctrl-C while compiled code ran is at the root of it.

    numba then makes arrays of its results with the signal waiting; Python complains, once for each.
    """
    cause: BaseException | None = error
    while isinstance(cause, SystemError):
        cause = cause.__cause__
    return isinstance(cause, KeyboardInterrupt)


class Threads:
    """The caller's thread and ``workers - 1`` more; those end when nobody has this any more.

    Args:
        workers: threads that work at the same time; 1 for the caller's alone.
    """

    def __init__(self, workers: int) -> None:
        self.workers = max(1, workers)
        self._others = ThreadPoolExecutor(self.workers - 1) if self.workers > 1 else None

    def each(self, call: Callable[[], T], n: int) -> list[T]:
        """What ``call`` returns on each thread that there is work for: ``n`` items, of which it takes what is left.

        A thread that comes too late for any item may not call it. When it fails it must leave no item to others.
        """
        helpers = []
        if self._others is not None:
            helpers = [self._others.submit(call) for _ in range(min(self.workers, n) - 1)]
        try:
            results = [call()]
        except SystemError as error:
            if _interrupted(error):
                raise KeyboardInterrupt from error
            raise
        finally:
            begun = [helper for helper in helpers if not helper.cancel()]
            more = [helper.result() for helper in begun]
        return results + more

    def runner(self, lengths: Lengths) -> Run:
        """A ``Run`` on these threads."""

        def run(kernel: Callable[[int, int], Any], n: int) -> list[Any]:
            parts = ranges(n, self.workers, lengths if self.workers > 1 else ALONE)
            results: list[Any] = [None] * len(parts)
            left = iter(range(len(parts)))  # of all threads: who is free takes the next

            def work() -> None:
                try:
                    for k in left:
                        results[k] = kernel(*parts[k])
                finally:
                    for _ in left:
                        pass

            self.each(work, len(parts))
            return results

        return run
