"""What can go wrong around a store on disk: foreign and damaged files, two writers, full disks, kills."""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import lmdb
import numpy as np
import pytest

from nurbs_cache.environment import lock_writer
from nurbs_cache.errors import CacheError
from nurbs_cache.keys import number_key
from nurbs_cache.lmdb_layout import check_whole
from nurbs_cache.node_record import ITEM_DTYPE
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from tests.cache.makers import geometry, node_rows

PYTHON_PATH = os.pathsep.join(sys.path)


def python(script: str, *arguments: object, **options: object) -> subprocess.Popen[str]:
    """Another process that runs ``script``."""
    return subprocess.Popen(  # type: ignore[call-overload, no-any-return]
        [sys.executable, "-c", script, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": PYTHON_PATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


# opening what is not a store


def test_missing(cache_path: Path) -> None:
    with pytest.raises(CacheError, match="is not a nurbs-ooc cache"):
        Store.open(cache_path)
    assert not cache_path.exists()


def test_a_file_and_a_random_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "notes.txt").write_text("x")
    for name in ("file", "folder"):
        for use in (Store.open, Store.create):
            with pytest.raises(CacheError):
                use(tmp_path / name)
    assert [p.name for p in (tmp_path / "folder").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("read_only", [True, False])
def test_foreign_lmdb(cache_path: Path, read_only: bool) -> None:
    with lmdb.open(str(cache_path), max_dbs=4) as env:
        env.open_db(b"theirs")
    before = (cache_path / "data.mdb").read_bytes()
    with pytest.raises(CacheError, match="not a nurbs-ooc cache"):
        Store.open(cache_path, read_only=read_only)
    with pytest.raises(CacheError, match="not a nurbs-ooc cache"):
        Store.create(cache_path, overwrite=True)
    assert (cache_path / "data.mdb").read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"x" * 8192, bytes(8192)])
def test_not_lmdb_at_all(cache_path: Path, content: bytes) -> None:
    cache_path.mkdir()
    (cache_path / "data.mdb").write_bytes(content)
    for read_only in (True, False):
        with pytest.raises(CacheError, match="not an LMDB file"):
            Store.open(cache_path, read_only=read_only)
    assert (cache_path / "data.mdb").read_bytes() == content


def test_other_schema(cache_path: Path) -> None:
    with Store.create(cache_path) as store:
        store.put_many("meta", [(b"schema", b"99")])
    for read_only in (True, False):
        with pytest.raises(CacheError, match="schema 99, this program reads 1"):
            Store.open(cache_path, read_only=read_only)


def test_truncated_at_every_page(cache_path: Path, tmp_path: Path) -> None:
    with Store.create(cache_path) as store:
        store.put_parts((i, PartInfo(f"{i}", 20, 20 * i), geometry(20, seed=i)) for i in range(4))
        store.put_many("tiles", ((bytes([i]) * 16, bytes([i]) * 20_000) for i in range(5)))
    data = (cache_path / "data.mdb").read_bytes()
    broken = tmp_path / "broken"
    broken.mkdir()
    n_refused = 0
    for n_pages in range(len(data) // 4096):
        (broken / "data.mdb").write_bytes(data[: 4096 * n_pages + 1000])
        try:
            with Store.open(broken) as store:  # pages that nothing refers to may be missing
                assert sum(len(value) for _, value in store.scan("tiles")) == 100_000
                assert len(store.part_infos()) == 4
        except CacheError:
            n_refused += 1
    assert n_refused > 0.8 * len(data) / 4096


def test_whole_files_pass(cache_path: Path) -> None:
    with Store.create(cache_path) as store:
        for i in range(30):
            store.put_many("tiles", [(number_key(k), bytes(200 * (k % 30))) for k in range(i * 10)])
            store.delete_many("tiles", [number_key(k) for k in range(0, i * 10, 3)])
            check_whole(cache_path / "data.mdb")


# creating


def test_create_refuses_an_existing_cache(cache_path: Path) -> None:
    with Store.create(cache_path, provenance={"by": "first"}) as store:
        store.put_many("tiles", [(b"k", b"v")])
    with pytest.raises(CacheError, match="there is a cache already"):
        Store.create(cache_path)
    with Store.open(cache_path) as store:
        assert store.get("tiles", b"k") == b"v"
        assert store.get_provenance() == {"by": "first"}
    with Store.create(cache_path, overwrite=True) as store:
        assert store.find("tiles", b"k") is None


def test_create_in_an_empty_folder(cache_path: Path) -> None:
    cache_path.mkdir()
    Store.create(cache_path).close()
    Store.open(cache_path).close()


def test_read_only_store_refuses_to_write(cache_path: Path) -> None:
    Store.create(cache_path).close()
    with Store.open(cache_path) as store, pytest.raises(CacheError, match="reading only"):
        store.put_many("tiles", [(b"k", b"v")])


# several openings


def test_reader_and_writer_share_one_process(cache_path: Path) -> None:
    with Store.create(cache_path) as writer, Store.open(cache_path) as first, Store.open(cache_path) as second:
        writer.put_many("tiles", [(b"k", b"v")])
        assert first.get("tiles", b"k") == second.get("tiles", b"k") == b"v"
        first.close()
        assert second.get("tiles", b"k") == b"v"


def test_second_writer_in_one_process(cache_path: Path) -> None:
    with Store.create(cache_path) as store:
        for use in (lambda: Store.open(cache_path, read_only=False), lambda: Store.create(cache_path, overwrite=True)):
            with pytest.raises(CacheError, match="already open for writing in this process"):
                use()
        store.put_many("tiles", [(b"k", b"v")])
    with Store.open(cache_path, read_only=False) as store:
        assert store.get("tiles", b"k") == b"v"


def test_second_writer_in_another_process(cache_path: Path) -> None:
    script = """
import sys
from nurbs_cache.errors import CacheError
from nurbs_cache.store import Store
for use in (lambda: Store.open(sys.argv[1], read_only=False), lambda: Store.create(sys.argv[1], overwrite=True)):
    try:
        use()
    except CacheError as error:
        print(error)
with Store.open(sys.argv[1]) as store:
    print(store.get("tiles", b"k"))
"""
    with Store.create(cache_path) as store:
        store.put_many("tiles", [(b"k", b"v")])
        out, err = python(script, cache_path).communicate(timeout=60)
        line = f"{cache_path}: process {os.getpid()} is writing to it; wait for it or stop it"
        assert out.splitlines() == [line, line, "b'v'"], err
        store.put_many("tiles", [(b"k", b"w")])


def test_lock_goes_with_the_store(cache_path: Path) -> None:
    Store.create(cache_path).close()
    os.close(lock_writer(cache_path))


def test_cache_replaced_under_the_same_name(cache_path: Path, tmp_path: Path) -> None:
    with Store.create(cache_path) as old:
        old.put_many("tiles", [(b"k", b"old")])
        cache_path.rename(tmp_path / "away")
        with Store.create(cache_path) as new:
            new.put_many("tiles", [(b"k", b"new")])
            assert (old.get("tiles", b"k"), new.get("tiles", b"k")) == (b"old", b"new")


# growing


def test_map_grows(cache_path: Path) -> None:
    with Store.create(cache_path, map_bytes=1 << 20) as writer, Store.open(cache_path) as reader:
        writer.put_many("tiles", ((number_key(i), bytes([i % 256]) * 50_000) for i in range(200)))
        assert sum(len(v) for _, v in reader.scan("tiles")) == 200 * 50_000
    with Store.open(cache_path) as reader:
        assert reader.counts()["tiles"] == 200


def test_other_process_follows_a_growing_map(cache_path: Path) -> None:
    script = """
import sys
from nurbs_cache.store import Store
with Store.open(sys.argv[1]) as store:
    print(store.counts()["tiles"], flush=True)
    sys.stdin.readline()
    print(store.counts()["tiles"], sum(len(v) for _, v in store.scan("tiles")))
"""
    with Store.create(cache_path, map_bytes=1 << 20) as writer:
        reader = python(script, cache_path, stdin=subprocess.PIPE)
        assert reader.stdout and reader.stdout.readline() == "0\n"
        writer.put_many("tiles", ((number_key(i), bytes(100_000)) for i in range(100)))
        out, err = reader.communicate("go\n", timeout=60)
        assert out == "100 10000000\n", err


def test_threads_read_while_the_map_grows(cache_path: Path) -> None:
    stop = threading.Event()
    wrong: list[object] = []

    def read(store: Store) -> None:
        # With a breath between scans: two threads that spin may pass the interpreter's lock to and fro for ever.
        while not stop.wait(0.001):
            for key, value in store.scan("tiles"):
                if value != key * 5000:
                    wrong.append(key)

    with Store.create(cache_path, map_bytes=1 << 20) as writer, Store.open(cache_path) as reader:
        threads = [threading.Thread(target=read, args=(reader,)) for _ in range(2)]
        for thread in threads:
            thread.start()
        for i in range(12):
            writer.put_many("tiles", ((number_key(k), number_key(k) * 5000) for k in range(10 * i, 10 * i + 10)))
        stop.set()
        for thread in threads:
            thread.join()
        assert reader.counts()["tiles"] == 120
    assert not wrong


def test_threads_update_one_surface_at_once(cache_path: Path) -> None:
    with Store.create(cache_path) as store:
        store.put_tree(node_rows(50), np.zeros(0, ITEM_DTYPE))

        def update(row: int) -> None:
            nodes = node_rows(1)
            nodes["tile_bytes"] = row
            store.update_nodes(row, nodes)

        threads = [threading.Thread(target=update, args=(row,)) for row in range(50)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert store.get_nodes()["tile_bytes"].tolist() == list(range(50))


# full disk, kills, forks


def test_no_space_leaves_what_was_there(cache_path: Path) -> None:
    """A limit on the file's size stands for a full disk: both fail inside LMDB's write."""
    script = """
import resource, sys
from nurbs_cache.errors import CacheError
from nurbs_cache.store import Store
with Store.open(sys.argv[1], read_only=False) as store:
    resource.setrlimit(resource.RLIMIT_FSIZE, (4 << 20, resource.RLIM_INFINITY))
    try:
        store.put_many("tiles", ((bytes([i]), bytes(100_000)) for i in range(100)))
    except CacheError as error:
        print(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    print(store.counts()["tiles"], store.get("tiles", b"old"))
    store.put_many("tiles", [(b"new", b"2")])
"""
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    with Store.create(cache_path) as store:
        store.put_many("tiles", [(b"old", b"1")])
    out, err = python(script, cache_path).communicate(timeout=60)
    lines = out.splitlines()
    assert len(lines) == 2 and lines[0].startswith(f"{cache_path}: cannot be written: "), out + err
    assert lines[1] == "1 b'1'"
    with Store.open(cache_path) as store:
        assert list(store.scan("tiles")) == [(b"new", b"2"), (b"old", b"1")]


def test_kill_while_writing(cache_path: Path) -> None:
    """A killed writer leaves a readable store with whole transactions, free to be written again."""
    script = """
import sys
from nurbs_cache.store import Store
with Store.open(sys.argv[1], read_only=False) as store:
    print("ready", flush=True)
    i = store.counts()["tiles"]
    while True:
        store.put_many("tiles", ((f"{i + k:08}".encode(), bytes(5000 + i)) for k in range(10)))
        i += 10
"""
    Store.create(cache_path, map_bytes=1 << 20).close()
    random = np.random.default_rng(3)
    for _ in range(4):
        writer = python(script, cache_path)
        assert writer.stdout and writer.stdout.readline() == "ready\n"
        time.sleep(float(random.uniform(0.01, 0.25)))
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
        with Store.open(cache_path) as store:
            keys = list(store.scan_keys("tiles"))
            assert len(keys) % 10 == 0
            assert all(len(v) == 5000 + 10 * (i // 10) for i, (_, v) in enumerate(store.scan("tiles")))
    with Store.open(cache_path, read_only=False) as store:
        store.put_many("tiles", [(b"z", b"")])


def _count_tiles(store: Store, answer: multiprocessing.queues.Queue[object]) -> None:
    try:
        answer.put(store.counts()["tiles"])
        store.close()
    except CacheError as error:
        answer.put(str(error))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_forked_child_opens_its_own(cache_path: Path) -> None:
    context = multiprocessing.get_context("fork")
    answer: multiprocessing.queues.Queue[object] = context.Queue()
    with Store.create(cache_path) as store:
        store.put_many("tiles", [(b"a", b"1")])
        child = context.Process(target=_count_tiles, args=(store, answer))
        child.start()
        assert answer.get(timeout=60) == 1
        child.join()
        store.put_many("tiles", [(b"b", b"2")])
        assert store.counts()["tiles"] == 2


def test_not_writable(cache_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the folder cannot be written, reading works without lock files."""
    with Store.create(cache_path) as store:
        store.put_many("tiles", [(b"k", b"v")])
    real: Callable[..., bool] = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK and real(path, mode))
    with Store.open(cache_path) as store:
        assert store.get("tiles", b"k") == b"v"


def test_full_disk_is_called_so(cache_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(transaction: object) -> None:
        raise lmdb.DiskError("mdb_txn_commit: Input/output error")

    with Store.create(cache_path) as store:
        usage = shutil.disk_usage(cache_path)
        for free, message in ((0, "its disk is full"), (1 << 40, "mdb_txn_commit: Input/output error")):
            monkeypatch.setattr(shutil, "disk_usage", lambda _path, free=free: usage._replace(free=free))
            with pytest.raises(CacheError, match=f"^{cache_path}: cannot be written: {message}$"):
                store.transact(fail)
