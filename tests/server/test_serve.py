"""The server as a process and as a thread: real sockets, real signals."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner

from nurbs_cache.errors import CacheError, UsageError
from nurbs_cache.store import Store
from nurbs_cache.tile import tile_hash
from nurbs_ooc.cli.serve import command
from nurbs_server.serve import bind, serve_in_thread
from tests.server.small_cache import CountingBuilders, tile_of

URL = f"/tiles/{tile_hash(tile_of(0))}"

SERVE = """
import sys
import nurbs_server.serve
from tests.server.small_cache import CountingBuilders
nurbs_server.serve.default_builders = lambda: CountingBuilders(seconds={seconds}).injected
from nurbs_ooc.cli.serve import command
command(sys.argv[1:], prog_name="nurbs-ooc serve")
"""


def test_in_a_thread(small_cache: Path, builders: CountingBuilders) -> None:
    with serve_in_thread(small_cache, builders=builders.injected) as served:
        assert served.refusal == ""
        with httpx.Client(base_url=served.url) as client:
            answer = client.get(URL)
            assert (answer.status_code, answer.content) == (200, tile_of(0))
            assert client.get("/api/nodes/1/tile", follow_redirects=True).content == tile_of(101)
            assert client.head(URL).headers["content-length"] == str(len(tile_of(0)))
            batch = client.post("/tiles:batch", json={"hashes": [tile_hash(tile_of(3))]})
            assert batch.content[40:] == tile_of(3)
            with Store.open(small_cache) as reader:  # others of this process may read meanwhile
                assert reader.get_nodes()[1]["tile_hash"].decode() == tile_hash(tile_of(101))
    with pytest.raises(httpx.ConnectError):
        httpx.get(served.url + URL)
    Store.open(small_cache, read_only=False).close()  # the cache is free again


def test_many_clients_at_once(small_cache: Path, builders: CountingBuilders) -> None:
    results: list[bytes] = []

    def ask(url: str) -> None:
        results.append(httpx.get(url, follow_redirects=True, timeout=30).content)

    with serve_in_thread(small_cache, builders=builders.injected) as served:
        urls = [served.url + path for path in ("/api/nodes/2/tile", "/api/surfaces/1/lods/3") for _ in range(15)]
        threads = [threading.Thread(target=ask, args=(url,)) for url in urls]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert sorted(results) == sorted([tile_of(102)] * 15 + [tile_of(1053)] * 15)
    assert (builders.nodes, builders.lods) == ([2], [(1, 3)])


def test_stops_quickly_though_clients_hold_on(small_cache: Path, builders: CountingBuilders) -> None:
    with httpx.Client() as client:
        with serve_in_thread(small_cache, builders=builders.injected) as served:
            client.get(served.url + URL)  # keeps its connection
            idle = socket.create_connection((served.host, served.port))  # never says a word
            half = socket.create_connection((served.host, served.port))
            half.sendall(b"GET /api/scene HTTP/1.1\r\nHost: x\r\n")  # never ends its request
            start = time.perf_counter()
        assert time.perf_counter() - start < 4.0  # not for as long as clients like; a busy machine needs some time
        idle.close()
        half.close()


def test_leaving_waits_for_a_running_build(small_cache: Path, builders: CountingBuilders) -> None:
    builders.seconds = 0.8

    with serve_in_thread(small_cache, builders=builders.injected) as served:
        client = threading.Thread(target=_is_turned_away, args=(served.url + "/api/nodes/1/tile",))
        client.start()
        while not builders.nodes:
            time.sleep(0.01)
    client.join()
    with Store.open(small_cache) as store:
        assert store.get_nodes()[1]["tile_hash"].decode() == tile_hash(tile_of(101))


def test_a_locked_cache_is_served_as_it_is(small_cache: Path, builders: CountingBuilders) -> None:
    with Store.open(small_cache, read_only=False), serve_in_thread(small_cache, builders=builders.injected) as served:
        assert "reading only" in served.refusal
        assert httpx.get(served.url + URL).content == tile_of(0)
        refused = httpx.get(served.url + "/api/nodes/1/tile")
        assert (refused.status_code, refused.json()["error"]) == (409, "ReadOnlyError")


def test_no_cache_no_server(tmp_path: Path) -> None:
    with pytest.raises(CacheError), serve_in_thread(tmp_path):
        pytest.fail("served a folder that is no cache")


def test_a_taken_port_is_one_line(small_cache: Path) -> None:
    with bind("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=rf"port {port} on 127\.0\.0\.1 is taken"):
            bind("127.0.0.1", port)
        with Store.open(small_cache, read_only=False):  # locked, so no builders are needed
            result = CliRunner().invoke(command, [str(small_cache), "--port", str(port)])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert f"port {port}" in result.stderr


@pytest.mark.parametrize("host", ["host.invalid", "203.0.113.1"])
def test_a_host_that_is_not_here(host: str) -> None:
    with pytest.raises(UsageError, match=host):
        bind(host, 0)


def test_bad_caches_are_one_line(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent"):
        result = CliRunner().invoke(command, [str(path)])
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
        assert str(path) in result.stderr


def test_the_token_file_is_checked(small_cache: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.write_text(" \n")
    for path in (empty, tmp_path / "absent"):
        result = CliRunner().invoke(command, [str(small_cache), "--edit-token-file", str(path)])
        assert result.exit_code == 2
        assert str(path) in result.stderr


@contextmanager
def process(
    env: dict[str, str], *arguments: str, seconds: float = 0.02
) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """The command in a process of its own, with what it says about itself."""
    server = subprocess.Popen(
        [sys.executable, "-c", SERVE.format(seconds=seconds), *arguments, "--port", "0", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=env,
    )
    try:
        assert server.stdout is not None
        assert server.stderr is not None
        line = server.stdout.readline()
        assert line, server.stderr.read()
        yield server, json.loads(line)
    finally:
        if server.poll() is None:
            server.kill()
        server.communicate()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_stop_it_within_a_second(
    small_cache: Path, python_path: dict[str, str], number: signal.Signals
) -> None:
    with process(python_path, str(small_cache)) as (server, said), httpx.Client() as client:
        assert (said["builds"], said["edits"], said["pid"]) == (True, False, server.pid)
        assert client.get(said["url"] + URL).content == tile_of(0)  # and keeps its connection
        start = time.perf_counter()
        server.send_signal(number)
        output, errors = server.communicate(timeout=10)
        assert time.perf_counter() - start < 5.0  # not for as long as clients like; a busy machine needs some time
        assert (server.returncode, output, errors) == (0, "", "")
    Store.open(small_cache, read_only=False).close()


def test_a_long_build_does_not_hold_it_up(small_cache: Path, tmp_path: Path, python_path: dict[str, str]) -> None:
    token = tmp_path / "token"
    token.write_text("secret\n")
    with process(python_path, str(small_cache), "--edit-token-file", str(token), seconds=30) as (server, said):
        waiting = threading.Thread(target=_is_turned_away, args=(said["url"] + "/api/nodes/1/tile",))
        waiting.start()
        while not re.search(r"builds_waiting 1", httpx.get(said["url"] + "/metrics").text):
            time.sleep(0.02)
        start = time.perf_counter()
        server.send_signal(signal.SIGTERM)
        _, errors = server.communicate(timeout=10)
        assert time.perf_counter() - start < 6.0
        waiting.join()
        assert server.returncode == 0
        assert errors.splitlines() == [
            "nurbs-ooc: this version takes no edits; the edit token is not used",
            "nurbs-ooc: stopped in the middle of a build, which the next request will start again",
        ]
    with Store.open(small_cache, read_only=False) as store:
        assert store.get_nodes()[1]["tile_hash"] == b""
        store.check()


def _is_turned_away(url: str) -> None:
    answer = httpx.get(url, timeout=20)
    assert (answer.status_code, answer.json()["detail"]) == (503, "builds: the server is stopping")
    assert answer.headers["retry-after"] == "1"
