"""The command: exit codes, JSON and the one line that names a violation."""

from __future__ import annotations

import json
from pathlib import Path

from click.testing import CliRunner

from nurbs_cache.store import Store
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
