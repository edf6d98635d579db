"""Threads for kernels that run without the interpreter; results come in the order of the jobs.

Jobs are short (tenths of a second), so Ctrl-C, which the waiting main thread takes at once, leaves
only the running ones to finish.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

R = TypeVar("R")

AHEAD = 2  # jobs per worker that are running or waiting: bounds the results that are held


def run_in_order(jobs: Iterable[Callable[[], R]], workers: int) -> Iterator[R]:
    """Yield the results of ``jobs`` in their order, computed by ``workers`` threads.

    Args:
        jobs: taken as they are needed, never more than ``AHEAD`` per worker in advance.
        workers: threads, >= 1.
    """
    pool = ThreadPoolExecutor(workers)
    waiting: deque[Future[R]] = deque()
    try:
        for job in jobs:
            waiting.append(pool.submit(job))
            if len(waiting) > AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
