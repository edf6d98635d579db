"""One run for all who wait, and nobody is taken along by who leaves."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine

import pytest

from nurbs_server.errors import BusyError
from nurbs_server.single_flight import SingleFlight


def run(test: Callable[[SingleFlight], Coroutine[None, None, None]], threads: int = 1, queue: int = 8) -> None:
    """Run ``test`` in an event loop with flights of its own."""
    flights = SingleFlight(threads, queue, "test")
    try:
        asyncio.run(test(flights))
    finally:
        flights.close(wait=True)
    assert not flights.running


class Work:
    """A blocking function that counts its runs and waits to be let go."""

    def __init__(self) -> None:
        self.runs = 0
        self.started = threading.Event()
        self.go = threading.Event()

    def __call__(self) -> int:
        self.runs += 1
        self.started.set()
        assert self.go.wait(10)
        return self.runs

    async def until_started(self) -> None:
        while not self.started.is_set():
            await asyncio.sleep(0.001)


def test_all_who_wait_share_one_run() -> None:
    async def test(flights: SingleFlight) -> None:
        work = Work()
        waiting = [asyncio.create_task(flights.run("key", work)) for _ in range(50)]
        await work.until_started()
        assert len(flights) == 1
        work.go.set()
        assert await asyncio.gather(*waiting) == [1] * 50
        assert work.runs == 1
        assert len(flights) == 0
        assert await flights.run("key", work) == 2  # landed: the next who asks starts anew

    run(test)


def test_an_exception_reaches_all_and_is_not_kept() -> None:
    async def test(flights: SingleFlight) -> None:
        def fail() -> None:
            time.sleep(0.02)
            raise ValueError("broken")

        waiting = [asyncio.create_task(flights.run("key", fail)) for _ in range(5)]
        results = await asyncio.gather(*waiting, return_exceptions=True)
        assert [str(result) for result in results] == ["broken"] * 5
        assert await flights.run("key", lambda: "mended") == "mended"

    run(test)


def test_who_leaves_does_not_take_the_others_along() -> None:
    async def test(flights: SingleFlight) -> None:
        work = Work()
        first, second = (asyncio.create_task(flights.run("key", work)) for _ in range(2))
        await work.until_started()
        first.cancel()
        with pytest.raises(asyncio.CancelledError):
            await first
        work.go.set()
        assert await second == 1

    run(test)


def test_queued_work_that_nobody_waits_for_is_taken_back() -> None:
    async def test(flights: SingleFlight) -> None:
        running, queued = Work(), Work()
        first = asyncio.create_task(flights.run("running", running))
        await running.until_started()
        leaving = [asyncio.create_task(flights.run("queued", queued)) for _ in range(2)]
        await asyncio.sleep(0.01)
        assert len(flights) == 2
        for task in leaving:
            task.cancel()
        await asyncio.gather(*leaving, return_exceptions=True)
        assert len(flights) == 1
        queued.go.set()
        late = asyncio.create_task(flights.run("queued", queued))  # joins no cancelled flight
        running.go.set()
        assert await first == 1
        assert await late == 1
        assert queued.runs == 1

    run(test)


def test_running_work_ends_though_all_have_left() -> None:
    async def test(flights: SingleFlight) -> None:
        work = Work()
        task = asyncio.create_task(flights.run("key", work))
        await work.until_started()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        joined = asyncio.create_task(flights.run("key", work))  # still in the air: joins it
        await asyncio.sleep(0.01)
        work.go.set()
        assert await joined == 1
        assert work.runs == 1

    run(test)


def test_the_event_loop_is_never_blocked() -> None:
    async def test(flights: SingleFlight) -> None:
        task = asyncio.create_task(flights.run("key", time.sleep, 0.2))
        longest, last = 0.0, time.perf_counter()
        while not task.done():
            await asyncio.sleep(0.005)
            now = time.perf_counter()
            longest, last = max(longest, now - last), now
        assert longest < 0.15

    run(test)


def test_as_many_threads_as_said() -> None:
    async def test(flights: SingleFlight) -> None:
        at_once, most, lock = 0, 0, threading.Lock()

        def work() -> None:
            nonlocal at_once, most
            with lock:
                at_once += 1
                most = max(most, at_once)
            time.sleep(0.01)
            with lock:
                at_once -= 1

        await asyncio.gather(*(flights.run(i, work) for i in range(8)))
        assert most == 2

    run(test, threads=2)


def test_stopping_turns_everyone_away_at_once() -> None:
    async def test(flights: SingleFlight) -> None:
        work = Work()
        waiting = [asyncio.create_task(flights.run(key, work)) for key in (1, 1, 2)]
        await work.until_started()
        flights.turn_away()
        refused = await asyncio.gather(*waiting, flights.run(3, work), return_exceptions=True)
        assert [type(error) for error in refused] == [BusyError] * 4
        assert flights.running  # what runs is left alone
        work.go.set()

    run(test)


def test_a_full_queue_refuses_new_keys_only() -> None:
    async def test(flights: SingleFlight) -> None:
        work = Work()
        waiting = [asyncio.create_task(flights.run(key, work)) for key in (1, 2, 1, 2)]
        await work.until_started()
        with pytest.raises(BusyError, match="limit is 2"):
            await flights.run(3, work)
        work.go.set()
        assert len(await asyncio.gather(*waiting)) == 4

    run(test, queue=2)
