"""The command: exit codes, JSON and the one line that names a violation."""

from __future__ import annotations

import json
import signal
import threading
from contextlib import nullcontext
from pathlib import Path

import pytest
from click.testing import CliRunner

from nurbs_cache.store import Store
from nurbs_ooc.cli.console import Console
from nurbs_ooc.cli.verify import command
from tests.ooc.test_measure_cache import fill


def _on_disk(path: Path, promise: float) -> Path:
    """The two spheres' cache, on disk."""
    with Store.create(path) as store:
        fill(store, promise=promise)
    return path


def test_an_honest_cache_exits_0(tmp_path: Path) -> None:
    path = _on_disk(tmp_path / "c", 1.0)
    result = CliRunner().invoke(
        command, [str(path), "--samples", "1000", "--json", "--report", str(tmp_path / "r.json")]
    )
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["violations"] == []
    assert found["nodes"] == 1
    assert json.loads((tmp_path / "r.json").read_text())["samples"] == found["samples"]


def test_a_broken_promise_exits_1_and_is_named(tmp_path: Path) -> None:
    path = _on_disk(tmp_path / "c", 0.9)
    result = CliRunner().invoke(command, [str(path), "--samples", "2000"])
    assert result.exit_code == 1
    assert "node 0 0" in result.stderr
    assert "promised" in result.stderr
    assert "certified" in result.stdout


def test_no_cache_exits_2(tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(tmp_path / "nothing")])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1


class _Impatient:
    """A progress bar that presses Ctrl-C at the third stroke."""

    strokes = 0

    def advance(self, _: float = 1) -> None:
        self.strokes += 1
        if self.strokes == 3:
            signal.raise_signal(signal.SIGINT)


def test_ctrl_c_ends_it_with_one_line_and_no_thread_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, bar = _on_disk(tmp_path / "c", 1.0), _Impatient()
    monkeypatch.setattr(Console, "progress", lambda *_: nullcontext(bar))
    threads = threading.active_count()
    # A suite that was started in the background inherits a Ctrl-C that is ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        result = CliRunner().invoke(command, [str(path), "--samples", "5000000", "--workers", "2", "--json"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert result.exit_code == 130
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert "Ctrl-C" in result.stderr
    assert bar.strokes == 3
    assert threading.active_count() == threads
