"""Running the application: open the cache, bind the port, serve, stop quickly.

One process writes a cache, and a server that builds on demand is that process. Where somebody else
writes, or nobody may, the cache is served as it is.
"""

from __future__ import annotations

import errno
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from fastapi import FastAPI

from nurbs_cache.errors import CacheError, UsageError
from nurbs_cache.store import Store
from nurbs_server.app import create_app
from nurbs_server.backend import Backend
from nurbs_server.limits import SHUTDOWN_GRACE_S
from nurbs_server.on_demand import Builders


@dataclass(frozen=True)
class Served:
    """A running server.

    Attributes:
        url: without a slash at its end.
        refusal: why nothing is built on demand, "" if missing tiles are built.
    """

    url: str
    host: str
    port: int
    refusal: str


def default_builders() -> Builders:
    """The builders of ``nurbs_ooc``; imported here, for they bring the tessellator along."""
    from nurbs_ooc.build.on_demand import build_node_tile, build_surface_lod

    return Builders(node=build_node_tile, lod=build_surface_lod)


def open_to_serve(path: Path | str) -> tuple[Store, str]:
    """The cache, for writing where that is possible; else for reading, and why.

    Raises:
        CacheError: it cannot be read either.
    """
    try:
        return Store.open(path, read_only=False), ""
    except CacheError as error:
        why = str(error)
    return Store.open(path, read_only=True), f"the cache is open for reading only: {why}"


def bind(host: str, port: int) -> socket.socket:
    """A listening socket; port 0 takes a free one.

    Raises:
        UsageError: the port is taken, or not ours to take, or the host is not of this machine.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
    except (OSError, OverflowError) as error:
        raise UsageError(f"host {host}, port {port}: {error}") from error
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(2048)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise UsageError(f"port {port} on {host} is taken; --port 0 finds a free one") from error
        raise UsageError(f"port {port} on {host}: {error.strerror}") from error
    return listener


class Server(uvicorn.Server):
    """uvicorn, stopped by ``stop`` and not by signals; ``ready`` is called when it accepts connections."""

    def __init__(self, app: FastAPI, listener: socket.socket, ready: Callable[[], None] = lambda: None) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                log_config=None,
                log_level="warning",
                access_log=False,
                server_header=False,
                lifespan="on",
                ws="none",
                timeout_graceful_shutdown=SHUTDOWN_GRACE_S,  # type: ignore[arg-type]  # fractions work as well
            )
        )
        self._app = app
        self._listener = listener
        self._ready = ready

    def serve_until_stopped(self) -> None:
        """Run the event loop in this thread."""
        try:
            self.run(sockets=[self._listener])
        finally:
            self._listener.close()

    def stop(self) -> None:
        """End soon, from any thread or a signal handler; called twice, at once."""
        self.force_exit = self.should_exit
        self.should_exit = True

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the command line."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then say so."""
        await super().startup(sockets=sockets)
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Turn away who waits for a build, which may take long; let running answers end; close."""
        self._app.state.backend.turn_away()
        await super().shutdown(sockets=sockets)


def url_of(listener: socket.socket) -> tuple[str, int]:
    """URL and port of a listening socket; a wildcard address is shown as this machine."""
    host, port = listener.getsockname()[:2]
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{shown}:{port}", port


@contextmanager
def serve_in_thread(
    path: Path | str, port: int = 0, *, host: str = "127.0.0.1", builders: Builders | None = None
) -> Iterator[Served]:
    """Serve the cache at ``path`` from a thread of this process while the block runs.

    Other stores of this process may read the cache meanwhile. On leaving, running builds are waited
    for, and the cache is closed.

    Args:
        path: a cache.
        port: 0 takes a free one.
        host: address to listen on.
        builders: how to make missing tiles, None for ``default_builders``.

    Raises:
        CacheError: the cache cannot be read.
        UsageError: the port cannot be had.
    """
    store, refusal = open_to_serve(path)
    with store:
        app = create_app(store, None if refusal else builders or default_builders(), refusal=refusal)
        backend: Backend = app.state.backend
        listener = bind(host, port)
        url, bound = url_of(listener)
        ready = threading.Event()
        server = Server(app, listener, ready.set)
        thread = threading.Thread(target=server.serve_until_stopped, name="server")
        thread.start()
        try:
            while not ready.wait(0.02) and thread.is_alive():
                pass
            if not ready.is_set():
                raise CacheError(f"{path}: the server did not start")
            yield Served(url, host, bound, refusal)
        finally:
            server.stop()
            thread.join()
            backend.close(wait=True)
