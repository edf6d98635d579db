"""Requests and bytes a second of the tile route, beside an ordinary route of the framework, over loopback.

    python scripts/bench_serve.py [--seconds 2] [--json]

One server process, one client process of its own kind: sixteen connections kept alive, each with one
request at a time, no parsing beyond the length. On two cores client and server share the machine;
compare within one run only. ``server_cpu_us`` is the server's processor time for a request, which other
work on the machine disturbs least.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib
import importlib.util
import json
import multiprocessing
import os
import platform
import tempfile
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, cast

import httpx
import numpy as np
import psutil
from fastapi import Response

from nurbs_cache.ledger import Ledger
from nurbs_cache.store import Store
from nurbs_cache.tile import TileContent, encode_tile, tile_hash
from nurbs_server.app import create_app
from nurbs_server.batch import FRAME
from nurbs_server.serve import Server, bind, url_of

N_TILES = 24
N_TRIANGLES = 18_000  # some 30 KiB of tile
N_CONNECTIONS = 16


def make_cache(path: Path) -> tuple[list[str], int]:
    """A cache with nothing but tiles; returns their hashes and the mean of their bytes."""
    hashes: list[str] = []
    n_bytes = 0
    with Store.create(path) as store:
        for number in range(N_TILES):
            tile = encode_tile(bumpy_sheet(number))
            hashes.append(tile_hash(tile))
            store.put_tiles([(hashes[-1], tile)])
            n_bytes += len(tile)
    return hashes, n_bytes // N_TILES


def bumpy_sheet(seed: int) -> TileContent:
    """A grid of triangles with random heights."""
    n = int(np.sqrt(N_TRIANGLES / 2)) + 1
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float), indexing="ij")
    rng = np.random.default_rng(seed)
    z = rng.normal(0.0, 0.05, (n, n))
    normals = rng.normal(0.0, 0.1, (n * n, 3)) + np.array([0.0, 0.0, 1.0])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, n, 1], corner[:, None] + [1, n, n + 1]])
    return TileContent(
        positions=np.stack([x, y, z], axis=-1).reshape(-1, 3),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        triangles=triangles.astype(np.uint32),
        lines=np.zeros((0, 2), np.uint32),
        points=np.zeros(0, np.uint32),
        ledger=Ledger(surface=0.05),
    )


def serve(path: Path, pipe: Connection) -> None:
    """The server process: the application with one ordinary route more; says its port, ends when told."""
    with Store.open(path) as store:
        app = create_app(store)
        tiles = app.state.backend.tiles

        @app.get("/plain/{tile}")
        async def plain(tile: str) -> Response:
            headers = {"ETag": f'"{tile}"', "Cache-Control": "public, max-age=31536000, immutable"}
            return Response(await tiles.read(tile), headers=headers, media_type="application/octet-stream")

        listener = bind("127.0.0.1", 0)
        server = Server(app, listener, lambda: pipe.send(url_of(listener)[1]))

        def stop() -> None:
            pipe.recv()
            server.stop()

        threading.Thread(target=stop, daemon=True).start()
        server.serve_until_stopped()


class Asker(asyncio.Protocol):
    """One connection that sends the next request when the last is answered, until its time is over."""

    def __init__(self, requests: list[bytes], until: float) -> None:
        self.requests, self.until = requests, until
        self.seconds: list[float] = []
        self.n_bytes = 0
        self.done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._head = b""
        self._missing = -1  # bytes of the body still to come, -1 within the head

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        self._transport = cast("asyncio.Transport", transport)
        self._ask()

    def connection_lost(self, error: Exception | None) -> None:
        """Report a server that hung up."""
        if not self.done.done():
            self.done.set_exception(error or ConnectionError("the server closed the connection"))

    def _ask(self) -> None:
        self._start = time.perf_counter()
        self._transport.write(self.requests[len(self.seconds) % len(self.requests)])

    def data_received(self, data: bytes) -> None:
        """Count the bytes of an answer; ask again at its end."""
        self.n_bytes += len(data)
        if self._missing < 0:
            self._head += data
            end = self._head.find(b"\r\n\r\n")
            if end < 0:
                return
            self._missing = body_length(self._head[:end]) - (len(self._head) - end - 4)
            self._head = b""
        else:
            self._missing -= len(data)
        if self._missing > 0:
            return
        self._missing = -1
        now = time.perf_counter()
        self.seconds.append(now - self._start)
        if now < self.until:
            self._ask()
        else:
            self.done.set_result(None)
            self._transport.close()


def body_length(head: bytes) -> int:
    """Content-Length of a good answer's head; 304 has no body."""
    status, *lines = head.lower().split(b"\r\n")
    if b" 200 " not in status and b" 304 " not in status:
        raise RuntimeError(f"answered {status.decode()}")
    return next((int(line.split(b":")[1]) for line in lines if line.startswith(b"content-length:")), 0)


async def ask(port: int, requests: list[bytes], seconds: float) -> dict[str, float]:
    """Figures of all connections together."""
    until = time.perf_counter() + seconds
    start = time.perf_counter()
    loop = asyncio.get_running_loop()
    made = [
        await loop.create_connection(lambda: Asker(requests, until), "127.0.0.1", port) for _ in range(N_CONNECTIONS)
    ]
    askers = [protocol for _, protocol in made]
    await asyncio.gather(*(asker.done for asker in askers))
    wall = time.perf_counter() - start
    times = np.concatenate([asker.seconds for asker in askers])
    return {
        "requests_per_s": len(times) / wall,
        "mb_per_s": sum(asker.n_bytes for asker in askers) / wall / 1e6,
        "p50_ms": float(np.percentile(times, 50)) * 1e3,
        "p99_ms": float(np.percentile(times, 99)) * 1e3,
    }


def request(path: str, headers: str = "") -> bytes:
    """A GET."""
    return f"GET {path} HTTP/1.1\r\nHost: bench\r\n{headers}\r\n".encode()


def ask_batches(port: int, hashes: list[str], seconds: float) -> dict[str, float]:
    """Tiles a second through the batch endpoint, one client, one batch at a time."""
    n_tiles = n_bytes = 0
    with httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
        start = time.perf_counter()
        while n_tiles == 0 or time.perf_counter() - start < seconds:
            answer = client.post("/tiles:batch", json={"hashes": hashes})
            answer.raise_for_status()
            n_tiles += len(hashes)
            n_bytes += len(answer.content) - len(hashes) * FRAME.size
    wall = time.perf_counter() - start
    return {"tiles_per_s": n_tiles / wall, "mb_per_s": n_bytes / wall / 1e6}


def measure(port: int, pid: int, hashes: list[str], seconds: float) -> dict[str, dict[str, float]]:
    """All cases, after a first round that warms the server; with the server's own time for each request."""
    process = psutil.Process(pid)

    def case(requests: list[bytes]) -> dict[str, float]:
        before = sum(process.cpu_times()[:2])
        figures = runner.run(ask(port, requests, seconds))
        spent = sum(process.cpu_times()[:2]) - before
        return {**figures, "server_cpu_us": spent / (figures["requests_per_s"] * seconds) * 1e6}

    raw = [request(f"/tiles/{name}") for name in hashes]
    plain = [request(f"/plain/{name}") for name in hashes]
    kept = [request(f"/tiles/{name}", f'If-None-Match: "{name}"\r\n') for name in hashes]
    runner = asyncio.Runner(loop_factory=loop_factory())
    with runner:
        for requests in (raw, plain):
            runner.run(ask(port, requests, min(0.3, seconds)))
        return {
            "tile_route": case(raw),
            "framework_route": case(plain),
            "tile_route_304": case(kept),
            "batch": ask_batches(port, hashes, seconds),
        }


def loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """Uvloop's where it is installed, as for the server."""
    if importlib.util.find_spec("uvloop") is None:
        return None
    return cast("Callable[[], asyncio.AbstractEventLoop]", importlib.import_module("uvloop").new_event_loop)


def run(seconds: float) -> dict[str, Any]:
    """Make a cache, serve it from another process, ask."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cache"
        hashes, tile_bytes = make_cache(path)
        here, there = context.Pipe()
        server = context.Process(target=serve, args=(path, there))
        server.start()
        try:
            if not here.poll(60):
                raise RuntimeError("the server did not start")
            cases = measure(here.recv(), server.pid or 0, hashes, seconds)
        finally:
            here.send("stop")
            server.join(10)
    return {
        "script": "scripts/bench_serve.py",
        "machine": {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()},
        "warm": True,
        "uvloop": loop_factory() is not None,
        "connections": N_CONNECTIONS,
        "tile_bytes": tile_bytes,
        "seconds_per_case": seconds,
        "cases": cases,
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=2.0, help="per case, 0.05 to 60")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    if not 0.05 <= options.seconds <= 60.0:
        parser.error(f"--seconds {options.seconds}: from 0.05 to 60")
    report = run(options.seconds)
    if options.json:
        print(json.dumps(report))
        return
    print(f"{report['tile_bytes']} bytes a tile, {N_CONNECTIONS} connections")
    for name, figures in report["cases"].items():
        print(f"{name:16s}", "  ".join(f"{key} {value:,.1f}" for key, value in figures.items()))


if __name__ == "__main__":
    main()
