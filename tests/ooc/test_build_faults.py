"""What goes wrong around a build ends in one line, and harms nothing that was there."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from nurbs_cache.errors import CacheError, CorruptRecordError, UsageError, WorkerDiedError
from nurbs_cache.keys import number_key
from nurbs_cache.store import Store
from nurbs_ooc.build import mesh_stage
from nurbs_ooc.build.fragments import FragmentShelf, read_slots
from nurbs_ooc.build.memory import DEFAULT_MEMORY, MIB
from nurbs_ooc.build.process_crew import ProcessCrew
from nurbs_ooc.build.spill import spill_path
from nurbs_ooc.build.surface_runs import surface_runs
from nurbs_ooc.build.target import partial_path
from nurbs_ooc.build.workshop import Bench, Workshop
from tests.ooc.scenes import hash_of, run_build, write_scene

ROOT = Path(__file__).parents[2]
ENV = {**os.environ, "PYTHONPATH": os.pathsep.join(str(ROOT / p) for p in (".", "cache", "server", "client"))}
NURBS_OOC = (sys.executable, "-m", "nurbs_ooc")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("source") / "scene.nurbs", n=2)


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model that takes some seconds."""
    path = tmp_path_factory.mktemp("car") / "car.nurbs"
    subprocess.run([*NURBS_OOC, "synth", "golf", "--surfaces", "1600", "-o", path], env=ENV, check=True)
    return path


def one_line(text: str) -> bool:
    return text.count("\n") == 1 and "Traceback" not in text


def interrupted(source: Path, cache: Path) -> Path:
    """Leave what a build has done when all meshes are there; returns the folder of intermediate files."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nurbs_ooc.build.pipeline.build_tiles", stop)
        with pytest.raises(KeyboardInterrupt):
            run_build(source, cache)
    return spill_path(cache)


def test_ctrl_c_stops_all_processes_and_says_how_to_go_on(car: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    process = subprocess.Popen(
        [*NURBS_OOC, "build", str(car), "-o", str(cache), "--workers", "2"], env=ENV, stderr=subprocess.PIPE, text=True
    )
    while not list(spill_path(cache).glob("*.boxes")):
        assert process.poll() is None
        time.sleep(0.01)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) == 2
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert one_line(error)
    assert "--resume" in error
    assert not any(worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE for worker in workers)
    assert not cache.exists()
    subprocess.run([*NURBS_OOC, "build", str(car), "-o", str(cache), "--resume"], env=ENV, check=True)
    run_build(car, tmp_path / "whole")
    assert hash_of(cache) == hash_of(tmp_path / "whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "whole"]


def test_workers_end_when_the_builder_is_killed(car: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    process = subprocess.Popen([*NURBS_OOC, "build", str(car), "-o", str(cache), "--workers", "2"], env=ENV)
    while not list(spill_path(cache).glob("*.boxes")):
        assert process.poll() is None
        time.sleep(0.01)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    gone, alive = psutil.wait_procs(workers, timeout=30)
    assert len(gone) == 2
    assert not alive


@pytest.mark.parametrize("limit", [1 << 16, 1 << 20])
def test_no_room_is_one_line_and_an_existing_cache_stays(source: Path, car: Path, tmp_path: Path, limit: int) -> None:
    cache = tmp_path / "cache"
    run_build(source, cache)
    before = hash_of(cache)
    result = subprocess.run(
        [*NURBS_OOC, "build", str(car), "-o", str(cache), "--force"],
        env=ENV,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert result.returncode == 2
    assert one_line(result.stderr)
    assert "too large" in result.stderr or f"files of {limit} bytes" in result.stderr
    assert str(tmp_path) in result.stderr
    assert hash_of(cache) == before
    assert not spill_path(cache).exists()


def test_full_disk_in_the_spill_folder(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mesh_stage, "mesh_slices", no_space)
    with pytest.raises(OSError, match="No space left"):
        run_build(source, tmp_path / "cache")
    assert not spill_path(tmp_path / "cache").exists()


def test_damaged_part_is_named(source: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.nurbs"
    shutil.copytree(source, damaged)
    with Store.open(damaged, read_only=False) as store:
        part = bytearray(store.get("parts", number_key(1)))
        part[len(part) // 2] ^= 1
        store.put_many("parts", [(number_key(1), bytes(part))])
    result = subprocess.run(
        [*NURBS_OOC, "build", str(damaged), "-o", str(tmp_path / "cache")], env=ENV, capture_output=True, text=True
    )
    assert result.returncode == 2
    assert one_line(result.stderr)
    assert "damaged.nurbs" in result.stderr
    assert not (tmp_path / "cache").exists()


def test_damaged_intermediate_files_are_made_anew(source: Path, tmp_path: Path) -> None:
    run_build(source, tmp_path / "whole")
    for suffix in (".boxes", ".meshes"):
        for at in (3, 100, -5):
            folder = interrupted(source, tmp_path / "cache")
            file = next(folder.glob(f"*{suffix}"))
            content = bytearray(file.read_bytes())
            content[at] ^= 0x10
            file.write_bytes(content)
            run_build(source, tmp_path / "cache", resume=True)
            assert hash_of(tmp_path / "cache") == hash_of(tmp_path / "whole")
            shutil.rmtree(tmp_path / "cache")


def test_meshes_that_are_damaged_meanwhile_are_refused(source: Path, tmp_path: Path) -> None:
    folder = interrupted(source, tmp_path / "cache")
    with Store.open(partial_path(tmp_path / "cache")) as store:
        runs = surface_runs(store.part_infos())
    file = next(folder.glob("*.meshes"))
    keys = read_slots(file)["key"]
    assert (FragmentShelf(folder, runs).pool(keys).slots["key"] == keys).all()
    content = bytearray(file.read_bytes())
    file.write_bytes(content[:-8])
    with pytest.raises(CorruptRecordError, match=r"length.*--resume"):
        FragmentShelf(folder, runs).pool(keys)
    content[-4] ^= 1
    file.write_bytes(content)
    with pytest.raises(CorruptRecordError, match="mesh of surface"):
        FragmentShelf(folder, runs).pool(keys)
    with pytest.raises(CorruptRecordError, match="lacks"):
        FragmentShelf(folder, runs).pool(keys[:1] + np.uint64(1 << 50))
    file.unlink()
    with pytest.raises(CorruptRecordError, match="cannot be read"):
        FragmentShelf(folder, runs).pool(keys)


def test_two_builds_of_one_cache(source: Path, tmp_path: Path) -> None:
    interrupted(source, tmp_path / "cache")
    with Store.open(partial_path(tmp_path / "cache"), read_only=False):
        for how in ("--resume", "--force"):
            result = subprocess.run(
                [*NURBS_OOC, "build", str(source), "-o", str(tmp_path / "cache"), how],
                env=ENV,
                capture_output=True,
                text=True,
            )
            assert result.returncode == 2
            assert one_line(result.stderr)
            assert f"process {os.getpid()}" in result.stderr
    assert list(spill_path(tmp_path / "cache").glob("*.meshes"))


def test_unfinished_build_of_another_schema(source: Path, tmp_path: Path) -> None:
    interrupted(source, tmp_path / "cache")
    with Store.open(partial_path(tmp_path / "cache"), read_only=False) as store:
        store.put_many("meta", [(b"schema", b"99")])
    with pytest.raises(CacheError, match="schema 99"):
        run_build(source, tmp_path / "cache", resume=True)


def test_too_little_memory_says_how_much_is_needed(source: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="needs at least 640 MiB"):
        run_build(source, tmp_path / "cache", workers=2, memory=200 * MIB)
    assert list(tmp_path.iterdir()) == []
    result = subprocess.run(
        [*NURBS_OOC, "build", str(source), "-o", str(tmp_path / "cache"), "--memory", "plenty"],
        env=ENV,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert "1.5GiB" in result.stderr
    run_build(source, tmp_path / "cache", workers=1, memory=DEFAULT_MEMORY)


def die(bench: Bench, job: int) -> int:
    if job == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return job


def fail(bench: Bench, job: int) -> int:
    return 1 // (3 - job)


def test_a_dead_worker_is_reported(source: Path, tmp_path: Path) -> None:
    shop = Workshop(source, tmp_path, "zstd")
    with ProcessCrew(2) as crew, pytest.raises(WorkerDiedError, match="signal 9"):
        list(crew.run(die, shop, range(8)))
    with ProcessCrew(2) as crew, pytest.raises(WorkerDiedError, match="ZeroDivisionError"):
        list(crew.run(fail, shop, range(8)))


def test_results_come_in_the_order_of_the_jobs(source: Path, tmp_path: Path) -> None:
    with ProcessCrew(2) as crew:
        assert list(crew.run(die, Workshop(source, tmp_path, "zstd"), range(4, 40))) == list(range(4, 40))


def clocked(bench: Bench, job: int) -> tuple[float, float]:
    start = time.monotonic()
    time.sleep(0.5)
    return start, time.monotonic()


def test_the_first_job_goes_ahead_where_kernels_must_be_compiled(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NURBS_OOC_KERNEL_CACHE", str(tmp_path / "kernels"))
    shop = Workshop(source, tmp_path, "zstd")
    with ProcessCrew(2) as crew:
        first, *others = crew.run(clocked, shop, range(4))
        assert all(start >= first[1] for start, _ in others)
        first, second, *_ = crew.run(clocked, shop, range(4))
        assert second[0] < first[1]
