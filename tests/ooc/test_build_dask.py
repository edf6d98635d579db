"""The same stages on a Dask cluster of two worker processes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from nurbs_cache.errors import UsageError
from tests.ooc.scenes import hash_of, run_build, write_scene
from tests.ooc.test_build_resume import environment

pytest.importorskip("distributed", reason="the extra dask is not installed")
pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own

# A cluster in a process of its own, so that its threads and event loop stay out of the tests'.
CLUSTER = """
import sys
from distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=int(sys.argv[1]), dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def cluster(folder: Path, threads: int) -> Iterator[str]:
    script = folder / "cluster.py"
    script.write_text(CLUSTER)
    command = [sys.executable, str(script), str(threads)]
    with subprocess.Popen(
        command, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None and process.stdin is not None
        yield process.stdout.readline().strip()
        process.stdin.close()


@pytest.fixture
def one_thread_each(tmp_path: Path) -> Iterator[str]:
    yield from cluster(tmp_path, 1)


@pytest.fixture
def two_threads_each(tmp_path: Path) -> Iterator[str]:
    yield from cluster(tmp_path, 2)


def test_a_cluster_builds_the_same_cache(one_thread_each: str, tmp_path: Path) -> None:
    source = write_scene(tmp_path / "scene.nurbs", n=2)
    run_build(source, tmp_path / "here")
    run_build(source, tmp_path / "there", dask=one_thread_each)
    assert hash_of(tmp_path / "there") == hash_of(tmp_path / "here")
    assert not list(tmp_path.glob("*.spill"))
    other = write_scene(tmp_path / "other.nurbs", n=1)
    run_build(other, tmp_path / "other here")
    run_build(other, tmp_path / "there", dask=one_thread_each, force=True)
    assert hash_of(tmp_path / "there") == hash_of(tmp_path / "other here")


def test_workers_with_threads_are_refused(two_threads_each: str, tmp_path: Path) -> None:
    source = write_scene(tmp_path / "scene.nurbs", n=1)
    with pytest.raises(UsageError, match="--nthreads 1"):
        run_build(source, tmp_path / "cache", dask=two_threads_each)


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nurbs_ooc.build.dask_crew.CONNECT_LIMIT_S", 0.5)
    source = write_scene(tmp_path / "scene.nurbs", n=1)
    with pytest.raises(UsageError, match=r"no scheduler answers"):
        run_build(source, tmp_path / "cache", dask=f"tcp://127.0.0.1:{os.getpid() % 1000 + 1}")
    assert not (tmp_path / "cache").exists()
