"""Blocking work in threads, done once for all who ask for it at the same time.

::

    request A --run(key)--> flight --> thread pool
    request B --run(key)----^  |
    request C --run(key)----^  `--> one result or one exception, for A, B and C

Who leaves (a client hangs up, its request is cancelled) does not take the others along. Work that
nobody waits for any more is taken back while it is still queued; once it runs, it runs to its end,
for what it stores is of use to the next who asks.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar, cast

from nurbs_server.errors import BusyError

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(eq=False)
class _Flight:
    work: concurrent.futures.Future[Any]
    landed: asyncio.Future[Any]
    n_waiting: int = 0


class SingleFlight:
    """Runs functions in at most ``threads`` threads, equal keys together; use it from one event loop.

    Args:
        threads: that run at a time.
        queue: most flights that are running or waiting for a thread.
        name: of the threads, and in messages.
    """

    def __init__(self, threads: int, queue: int, name: str) -> None:
        self._executor = concurrent.futures.ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._flights: dict[Hashable, _Flight] = {}
        self._queue = queue
        self._name = name
        self._stopping = False

    def __len__(self) -> int:
        """How many are running or waiting for a thread."""
        return len(self._flights)

    @property
    def running(self) -> bool:
        """Whether a thread is at work."""
        return any(flight.work.running() for flight in list(self._flights.values()))

    async def run(self, key: Hashable, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """The result of ``function``, from a run that is already under way if there is one.

        Raises:
            BusyError: too many others are waiting, or the server is stopping.
            Whatever ``function`` raises, for everyone who waits for it.
        """
        flight = self._flights.get(key) or self._take_off(key, function, *args, **kwargs)
        flight.n_waiting += 1
        try:
            return cast("R", await asyncio.shield(flight.landed))
        finally:
            flight.n_waiting -= 1
            if flight.n_waiting == 0 and flight.work.cancel():
                self._forget(key, flight)

    def turn_away(self) -> None:
        """Tell all who wait, and all who come, that the server is stopping. Call it in the event loop."""
        self._stopping = True
        for flight in list(self._flights.values()):
            flight.work.cancel()
            if not flight.landed.done():
                flight.landed.set_exception(self._refusal())
                flight.landed.exception()  # it may be that nobody waits any more: that is no error

    def close(self, *, wait: bool) -> None:
        """Drop what is queued and take nothing more; with ``wait``, return when what runs has ended."""
        self._stopping = True
        self._executor.shutdown(wait=wait, cancel_futures=True)

    def _take_off(self, key: Hashable, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> _Flight:
        if self._stopping:
            raise self._refusal()
        if len(self._flights) >= self._queue:
            raise BusyError(f"{self._name}: {len(self._flights)} are waiting, the limit is {self._queue}")
        loop = asyncio.get_running_loop()
        flight = _Flight(self._executor.submit(function, *args, **kwargs), loop.create_future())
        self._flights[key] = flight

        def landing(_: object) -> None:
            with suppress(RuntimeError):  # the loop has ended: nobody waits any more
                loop.call_soon_threadsafe(self._land, key, flight)

        flight.work.add_done_callback(landing)
        return flight

    def _land(self, key: Hashable, flight: _Flight) -> None:
        """Hand the result of a flight to all who wait."""
        self._forget(key, flight)
        if flight.landed.done():
            return
        if flight.work.cancelled():
            flight.landed.cancel()
        elif error := flight.work.exception():
            flight.landed.set_exception(error)
            flight.landed.exception()  # whoever waits gets it; if all have left, it is no one's to log
        else:
            flight.landed.set_result(flight.work.result())

    def _forget(self, key: Hashable, flight: _Flight) -> None:
        if self._flights.get(key) is flight:
            del self._flights[key]

    def _refusal(self) -> BusyError:
        return BusyError(f"{self._name}: the server is stopping")
