"""Workers as processes of this machine: both cores busy, whatever the interpreter's lock does.

Each worker is a fresh interpreter at the other end of a socket. It gets its next job while it does the
one before; it ends when the socket is closed, so also when this process is killed. Ctrl-C is this
process's: it kills the workers, who have nothing to finish, for whatever they write appears by a rename.

::

    this process                             worker
      job 3 ------------------------------->  job 1 running, job 3 waiting
      <------------------------ result of job 1
"""

from __future__ import annotations

import contextlib
import inspect
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Self, TypeVar, cast

from nurbs_cache.compile_notice import compiling
from nurbs_cache.errors import WorkerDiedError
from nurbs_cache.jit import note_run, ran_before
from nurbs_ooc.build.workshop import Bench, Workshop

J = TypeVar("J")
R = TypeVar("R")

AHEAD = 2  # jobs a worker has: one running, one waiting
UNORDERED = 8  # jobs a worker may be ahead of the oldest result that is missing: bounds the results that are held


class _Worker:
    """A process and our end of its socket."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-m", "nurbs_ooc.build.worker", str(theirs.fileno())]
        self.process = subprocess.Popen(
            command, pass_fds=[theirs.fileno()], env=environment, stdin=subprocess.DEVNULL, process_group=0
        )
        theirs.close()
        self.connection = Connection(ours.detach())
        self.n_jobs = 0

    def send(self, message: Any) -> None:
        """Give it a job."""
        try:
            self.connection.send(message)
        except OSError:
            raise self._died() from None
        self.n_jobs += 1

    def receive(self) -> Any:
        """Take a result."""
        try:
            message = self.connection.recv()
        except (EOFError, OSError):
            raise self._died() from None
        self.n_jobs -= 1
        return message

    def _died(self) -> WorkerDiedError:
        code = self.process.wait()
        why = f"signal {-code}" if code < 0 else f"exit code {code}"
        return WorkerDiedError(
            f"worker process {self.process.pid} ended ({why}), perhaps for lack of memory; --resume goes on"
        )

    def kill(self) -> None:
        """End it at once."""
        self.connection.close()
        self.process.kill()
        self.process.wait()


class ProcessCrew:
    """Some processes on this machine; see ``Crew``.

    Args:
        n_workers: how many.
    """

    def __init__(self, n_workers: int) -> None:
        self.n_workers = n_workers
        self._workers: list[_Worker] = []
        try:
            for _ in range(n_workers):
                self._workers.append(_Worker())
        except BaseException:
            self._end()
            raise

    def run(self, task: Callable[[Bench, J], R], shop: Workshop, jobs: Iterable[J]) -> Iterator[R]:
        """See ``Crew``."""
        numbered = enumerate(jobs)
        module = inspect.getfile(task)
        # Nobody compiles what another worker is compiling: then the first job goes ahead.
        alone = not ran_before(module)
        if alone:
            compiling()
        held: dict[int, R] = {}  # results that came before their turn
        n_sent, n_yielded, exhausted = 0, 0, False
        while True:
            for worker in sorted(self._workers, key=lambda w: w.n_jobs) * AHEAD:
                if alone and n_sent:
                    break
                if exhausted or worker.n_jobs >= AHEAD or n_sent - n_yielded >= UNORDERED * self.n_workers:
                    continue
                number, job = next(numbered, (-1, None))
                exhausted = number < 0
                if not exhausted:
                    worker.send((number, task, shop, job))
                    n_sent += 1
            if n_yielded == n_sent:
                return
            ready = wait([worker.connection for worker in self._workers if worker.n_jobs])
            for worker in self._workers:
                if worker.connection in ready:
                    number, result, error = worker.receive()
                    if error is not None:
                        raise error
                    held[number] = cast("R", result)
                    if alone:
                        alone = False
                        note_run(module)
            while n_yielded in held:
                yield held.pop(n_yielded)
                n_yielded += 1

    def _end(self) -> None:
        for worker in self._workers:
            with contextlib.suppress(OSError):
                worker.kill()
        self._workers.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()
