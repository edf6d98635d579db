"""The other end of ``process_crew``: does jobs until the socket is closed."""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from nurbs_cache.errors import NurbsOocError, WorkerDiedError
from nurbs_ooc.build.freed_memory import return_freed_memory
from nurbs_ooc.build.warm_up import warm_up
from nurbs_ooc.build.workshop import opened


def serve(descriptor: int) -> None:
    """Receive (number, task, shop, job), send (number, result, error)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return_freed_memory()
    connection = Connection(descriptor)
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, inbox), daemon=True).start()
    warm_up()
    while True:
        number, task, shop, job = inbox.get()
        result, error = None, None
        try:
            result = task(opened(shop), job)
        except (NurbsOocError, OSError) as known:
            error = known
        except Exception:  # noqa: BLE001 - the builder decides what becomes of it
            error = WorkerDiedError(f"internal error in a worker: {traceback.format_exc()}")
        connection.send((number, result, error))


def _receive(connection: Connection, inbox: queue.SimpleQueue[Any]) -> None:
    """Take jobs in while others run, so that nobody waits to send; leave when there is nobody to work for."""
    try:
        while True:
            inbox.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
