"""The process in which the CAD kernel lives: it forks a session for every file that is opened.

The reader's own process never loads the kernel. It starts this one once and asks it through a socket;
each request carries the write end of a pipe. Sessions are forks of a process that has the kernel
loaded, no threads and nothing else, so a start costs milliseconds and a crash costs nobody else.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import sys
import traceback
from multiprocessing.connection import Connection

MAX_REQUEST_BYTES = 65536


def main(descriptor: int) -> None:
    """Serve requests (path, shown, kind) on the socket until the other side closes it."""
    from nurbs_ooc.readers.kernel_setup import prepare_kernel
    from nurbs_ooc.readers.session import serve_file

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the reader's; it closes the socket
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # ended sessions need no waiting for
    prepare_kernel()
    with socket.socket(fileno=descriptor) as requests:
        while True:
            data, pipes, _, _ = socket.recv_fds(requests, MAX_REQUEST_BYTES, 1)
            if not data:
                return
            path, shown, kind = pickle.loads(data)
            if os.fork() == 0:
                requests.close()
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                _session(Connection(pipes[0], readable=False), serve_file, path, shown, kind)
            os.close(pipes[0])


def _session(pipe: Connection, serve_file, path: str, shown: str, kind: str) -> None:  # type: ignore[no-untyped-def]
    status = 1
    try:
        serve_file(pipe.send, path, shown, kind)
        status = 0
    except BrokenPipeError:  # the reader was closed early
        pass
    except BaseException:  # noqa: BLE001 - nothing may unwind into the server's loop
        traceback.print_exc()
    finally:
        os._exit(status)


if __name__ == "__main__":
    main(int(sys.argv[1]))
