"""Starts the kernel's process on first use and opens sessions in it."""

from __future__ import annotations

import atexit
import os
import pickle
import socket
import subprocess
import sys
from multiprocessing.connection import Connection, Pipe

STOP_LIMIT_S = 5.0


class KernelProcess:
    """One kernel process for this process; it ends when its socket is closed, so also if we are killed."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        ours, theirs = socket.socketpair()
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-m", "nurbs_ooc.readers.kernel_server", str(theirs.fileno())]
        self.process = subprocess.Popen(
            command, pass_fds=[theirs.fileno()], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        theirs.close()
        self.socket = ours

    def alive(self) -> bool:
        """Whether this process started it and it still runs."""
        return self.owner == os.getpid() and self.process.poll() is None

    def open_session(self, path: str, shown: str, kind: str) -> Connection:
        """The read end of a new session's messages."""
        receiver, sender = Pipe(duplex=False)
        socket.send_fds(self.socket, [pickle.dumps((path, shown, kind))], [sender.fileno()])
        sender.close()
        return receiver

    def stop(self) -> None:
        """Let it end; kill it if it does not."""
        self.socket.close()
        if self.owner != os.getpid():
            return
        try:
            self.process.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


_current: KernelProcess | None = None


def open_session(path: str, shown: str, kind: str) -> Connection:
    """Open ``path`` in the kernel's process, which is started if need be."""
    global _current
    if _current is None or not _current.alive():
        _current = KernelProcess()
        atexit.register(_current.stop)
    return _current.open_session(path, shown, kind)
