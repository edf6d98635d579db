"""Ranges of items, shared out to threads."""

from __future__ import annotations

import gc
import threading
import time

import pytest

from nurbs_ooc.tessellation.workers import CHUNKS, CURVES, EDGES, SURFACES, Lengths, Threads, ranges

ONE = Lengths(1, 1)


@pytest.mark.parametrize("lengths", [SURFACES, EDGES, CURVES, CHUNKS, Lengths(7, 3)])
@pytest.mark.parametrize("workers", [2, 3, 16])
def test_ranges_follow_one_another_and_shrink(lengths: Lengths, workers: int) -> None:
    for n in (0, 1, 2, 5, 63, 1000, 20_000):
        found = ranges(n, workers, lengths)
        assert [i for low, high in found for i in range(low, high)] == list(range(n))
        sizes = [high - low for low, high in found]
        assert sizes == sorted(sizes, reverse=True)
        assert all(size <= lengths.longest for size in sizes)
        assert all(size >= lengths.shortest for size in sizes[:-1])


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_items(workers: int) -> None:
    run = Threads(workers).runner(Lengths(10, 2))

    def kernel(low: int, high: int) -> list[int]:
        time.sleep(1e-4 * (low % 7))
        return list(range(low, high))

    for n in (0, 1, 9, 200):
        assert [i for part in run(kernel, n) for i in part] == list(range(n))


def test_several_threads_work_at_the_same_time() -> None:
    together = threading.Barrier(3, timeout=60.0)

    def kernel(_low: int, _high: int) -> int:
        together.wait()
        return threading.get_ident()

    threads = set(Threads(3).runner(ONE)(kernel, 3))
    assert len(threads) == 3
    assert threading.get_ident() in threads


def test_one_item_stays_with_the_caller() -> None:
    before = threading.active_count()
    threads = Threads(4)
    assert threads.each(threading.get_ident, 1) == [threading.get_ident()]
    assert threading.active_count() == before


@pytest.mark.parametrize("workers", [1, 3])
def test_a_failure_is_raised_and_nothing_more_is_begun(workers: int) -> None:
    threads = Threads(workers)
    run, begun = threads.runner(ONE), []

    def kernel(low: int, high: int) -> int:
        begun.append(low)
        time.sleep(1e-3)
        if low <= 5 < high:
            raise ValueError("five")
        return low

    with pytest.raises(ValueError, match="five"):
        run(kernel, 10_000)
    assert len(begun) < 100
    assert run(lambda low, _: low, 50)[0] == 0


def test_threads_end_when_nobody_has_them() -> None:
    before = set(threading.enumerate())
    threads = Threads(4)
    threads.runner(ONE)(lambda _, __: time.sleep(1e-3), 50)
    own = set(threading.enumerate()) - before
    assert own
    del threads
    gc.collect()
    for thread in own:
        thread.join(60.0)
    assert not any(thread.is_alive() for thread in own)
