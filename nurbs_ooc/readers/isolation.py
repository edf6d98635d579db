"""Runs work that may crash or hang in a forked process and passes on what it sends.

The kernel is a large C++ library: on a bad shape it may end the process or never return. The forked
process sees all shapes that were read before (copy on write), so nothing has to be packed up to hand
them over, and its memory is gone when it ends.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, Pipe
from typing import Any

PART_LIMIT_S = 900.0  # silence after which a part counts as hung: the slowest face we met took 20 s
_END = "end"


class WorkDiedError(Exception):
    """The forked process ended early or was silent for too long."""


def run_isolated(work: Callable[[Callable[[Any], None]], None], limit_s: float = PART_LIMIT_S) -> Iterator[Any]:
    """Call ``work(send)`` in a fork and yield each object it sends.

    Raises:
        WorkDiedError: after the last object that arrived whole, if ``work`` did not return.
    """
    receiver, sender = Pipe(duplex=False)
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        receiver.close()
        _run_and_exit(work, sender)
    sender.close()
    done = False
    try:
        while not done:
            if not receiver.poll(limit_s):
                raise WorkDiedError(f"silent for {limit_s:g} s")
            item = _receive(receiver)
            done = isinstance(item, str) and item == _END
            if not done:
                yield item
    finally:
        receiver.close()
        if not done:
            _kill(child)
        os.waitpid(child, 0)


def _receive(receiver: Connection) -> Any:
    try:
        return receiver.recv()
    except (EOFError, OSError) as error:
        raise WorkDiedError("the process ended") from error


def _run_and_exit(work: Callable[[Callable[[Any], None]], None], sender: Connection) -> None:
    """The forked side: never returns, runs no exit handlers of the parent."""
    status = 1
    try:
        work(sender.send)
        sender.send(_END)
        status = 0
    except BrokenPipeError:
        pass
    except BaseException:  # noqa: BLE001 - nothing may unwind into the parent's code
        traceback.print_exc()
    finally:
        os._exit(status)


def _kill(child: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
