"""Builds that are killed go on and end with the same content."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nurbs_cache.errors import CacheError
from nurbs_cache.store import Store
from nurbs_ooc.build.spill import spill_path
from nurbs_ooc.build.target import partial_path
from tests.ooc.scenes import hash_of, run_build, write_scene

# Runs a build in a process that is killed at its n-th transaction, before or after that is stored, or, alone, in the
# middle of its n-th intermediate file.
KILLED = """
import contextlib, os, signal, sys
from pathlib import Path
from nurbs_cache.store import Store
from nurbs_ooc.build import box_stage, fragments, spill
from tests.ooc.scenes import run_build

source, cache, number, after = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "after"
transact, count = Store.transact, 0

def counted(self, change):
    global count
    count += 1
    if count == number and not after:
        os.kill(os.getpid(), signal.SIGKILL)
    result = transact(self, change)
    if count == number:
        os.kill(os.getpid(), signal.SIGKILL)
    return result

class Killing:
    def __init__(self, file):
        self.file = file

    def write(self, data):
        global count
        count += 1
        self.file.write(data[: len(data) // 2])
        self.file.flush()
        if count == number:
            os.kill(os.getpid(), signal.SIGKILL)
        self.file.write(data[len(data) // 2 :])

@contextlib.contextmanager
def killing_file(path):
    with spill.new_file(path) as file:
        yield Killing(file)

if sys.argv[4] == "file":
    box_stage.new_file = fragments.new_file = killing_file
else:
    Store.transact = counted
run_build(source, cache, workers=1 if sys.argv[4] == "file" else 2, resume=True)
print(count)
"""


NURBS_OOC = (sys.executable, "-m", "nurbs_ooc")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("source") / "scene.nurbs", n=2)


@pytest.fixture(scope="module")
def undisturbed(source: Path) -> str:
    run_build(source, source.parent / "whole")
    return hash_of(source.parent / "whole")


def environment() -> dict[str, str]:
    root = Path(__file__).parents[2]
    return {**os.environ, "PYTHONPATH": ":".join(str(root / folder) for folder in (".", "cache", "server", "client"))}


def run_killed(source: Path, cache: Path, number: int, when: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", KILLED, str(source), str(cache), str(number), when]
    return subprocess.run(command, env=environment(), capture_output=True, text=True)


@pytest.mark.parametrize(("number", "when"), [(2, "after"), (5, "before"), (8, "after")])
def test_killed_build_goes_on(source: Path, undisturbed: str, tmp_path: Path, number: int, when: str) -> None:
    cache = tmp_path / "cache"
    assert run_killed(source, cache, number, when).returncode == -signal.SIGKILL
    assert not cache.exists()
    run_build(source, cache, resume=True)
    assert hash_of(cache) == undisturbed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache"]


@pytest.mark.parametrize("number", [1, 3])
def test_half_an_intermediate_file_is_not_used(source: Path, undisturbed: str, tmp_path: Path, number: int) -> None:
    cache = tmp_path / "cache"
    assert run_killed(source, cache, number, "file").returncode == -signal.SIGKILL
    assert any(path.suffix not in (".boxes", ".meshes") for path in spill_path(cache).iterdir())
    run_build(source, cache, resume=True)
    assert hash_of(cache) == undisturbed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache"]


@pytest.mark.long
def test_killed_at_random_moments(tmp_path: Path) -> None:
    model, cache, rng = tmp_path / "car.nurbs", tmp_path / "cache", random.Random(1)
    subprocess.run([*NURBS_OOC, "synth", "golf", "--surfaces", "1600", "-o", model], env=environment(), check=True)
    run_build(model, tmp_path / "whole")
    start = time.monotonic()
    run_build(model, tmp_path / "timed", workers=2)
    whole_s = time.monotonic() - start
    kills = 0
    while True:
        process = subprocess.Popen([*NURBS_OOC, "build", model, "-o", cache, "--resume"], env=environment())
        try:
            process.wait(rng.uniform(0.2, 1.0) * whole_s)
            break
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            kills += 1
    assert process.returncode == 0
    assert kills > 0
    assert hash_of(cache) == hash_of(tmp_path / "whole")
    assert not spill_path(cache).exists()


@pytest.mark.long
def test_killed_again_and_again(source: Path, undisturbed: str, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    kills = 0
    for number in range(1, 100):
        result = run_killed(source, cache, 2 + number % 3, ("before", "after")[number % 2])
        if result.returncode == 0:
            break
        assert result.returncode == -signal.SIGKILL, result.stderr
        kills += 1
    assert kills > 2  # of eight transactions
    assert hash_of(cache) == undisturbed


def test_resume_without_anything_is_a_plain_build(source: Path, undisturbed: str, tmp_path: Path) -> None:
    run_build(source, tmp_path / "cache", resume=True)
    assert hash_of(tmp_path / "cache") == undisturbed
    run_build(source, tmp_path / "cache", resume=True)
    assert hash_of(tmp_path / "cache") == undisturbed


def test_other_inputs_are_not_mixed_in(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    run_killed(source, cache, 3, "after")
    other = write_scene(tmp_path / "other.nurbs", n=1)
    with pytest.raises(CacheError, match="inputs"):
        run_build(other, cache, resume=True)
    run_build(other, cache, force=True, levels="root")
    with Store.open(cache) as store:
        assert store.get_provenance()["inputs"][0]["name"] == "other.nurbs"


def test_finished_inputs_are_not_read_again(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from nurbs_ooc.build import read_stage

    other = write_scene(tmp_path / "other.nurbs", n=1)
    opened, open_input = [], read_stage.open_input

    def stop_at_second(path: Path):  # type: ignore[no-untyped-def]
        opened.append(path.name)
        if len(opened) == 2:
            raise KeyboardInterrupt
        return open_input(path)

    monkeypatch.setattr(read_stage, "open_input", stop_at_second)
    with pytest.raises(KeyboardInterrupt):
        run_build([source, other], tmp_path / "cache", levels="root")
    run_build([source, other], tmp_path / "cache", levels="root", resume=True)
    assert opened == ["scene.nurbs", "other.nurbs", "other.nurbs"]
    run_build([source, other], tmp_path / "straight", levels="root")
    assert hash_of(tmp_path / "cache") == hash_of(tmp_path / "straight")


def test_two_builds_of_one_cache(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    with Store.create(partial_path(cache), provenance={}):
        code = "import sys; from pathlib import Path; from tests.ooc.scenes import run_build\n"
        code += "run_build(Path(sys.argv[1]), Path(sys.argv[2]), force=True)"
        root = Path(__file__).parents[2]
        env = {**os.environ, "PYTHONPATH": f"{root}:{root / 'cache'}"}
        command = [sys.executable, "-c", code, str(source), str(cache)]
        result = subprocess.run(command, env=env, capture_output=True, text=True)
    assert result.returncode != 0
    assert "CacheError" in result.stderr
