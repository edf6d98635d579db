"""``nurbs-ooc demo``: how it runs its stages (with stand-ins that only report), and once in earnest."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from nurbs_ooc.cli import demo
from nurbs_ooc.cli.main import main

BUILD = {"faces": {"read": 9, "exact": 8, "healed": 1, "degraded": 0, "failed": 0}, "nodes": 5, "levels": 3, "bytes": 7}
FLY = {
    "frames": 2,
    "bytes_streamed": 1000,
    "screen_error_px": {"mean": 0.2, "max": 0.5},
    "gl_renderer": "soft",
    "fps": {"mean": 9},
}
VERIFY = {"violations": [], "samples": 5, "worst_measured_over_certified": 0.9}
BROKEN = VERIFY | {"violations": [{}]}
SERVE = 'import signal, time; print(\'{"url": "http://127.0.0.1:9"}\', flush=True); signal.pause()'


def stand_in(monkeypatch: pytest.MonkeyPatch, **code: str) -> list[list[str]]:
    """Replace each stage's process by a few lines of Python; returns the list of calls to come."""
    calls: list[list[str]] = []
    default = {
        "build": f"import json; print(json.dumps({BUILD!r}))",
        "serve": SERVE,
        "fly": f"import json; print(json.dumps({FLY!r}))",
        "verify": f"import json; print(json.dumps({VERIFY!r}))",
    }

    def arguments(name: str, values: Sequence[object]) -> list[str]:
        calls.append([name, *map(str, values)])
        return [sys.executable, "-c", (default | code)[name]]

    monkeypatch.setattr(demo, "_arguments", arguments)
    return calls


def run(tmp_path: Path) -> Result:
    return CliRunner().invoke(main, ["demo", "-o", str(tmp_path / "out"), "--json"], catch_exceptions=False)


def test_stages_and_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = stand_in(monkeypatch)
    result = run(tmp_path)
    assert result.exit_code == 0, result.stderr
    assert [call[0] for call in calls] == ["build", "serve", "fly", "verify"]
    assert calls[1][2:] == ["--port", "0", "--json"]
    assert calls[2][1] == "http://127.0.0.1:9"
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report == json.loads(result.stdout)
    assert (report["build"], report["fly"], report["verify"]) == (BUILD, FLY, VERIFY)
    assert set(report["seconds"]) == {"build", "fly", "verify", "total"}


@pytest.mark.parametrize(
    ("stage", "code", "exit_code", "line"),
    [
        ("build", "import sys; sys.exit(2)", 2, "nurbs-ooc: demo: build ended with exit code 2"),
        ("serve", "import sys; sys.exit(1)", 1, "nurbs-ooc: demo: serve ended with exit code 1"),
        ("fly", "import sys; sys.exit(130)", 130, "nurbs-ooc: stopped by Ctrl-C"),
        ("verify", f"import json, sys; print(json.dumps({BROKEN!r})); sys.exit(1)", 1, "nurbs-ooc: demo: verify found"),
    ],
)
def test_failing_stage_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, code: str, exit_code: int, line: str
) -> None:
    stand_in(monkeypatch, **{stage: code})
    result = run(tmp_path)
    assert result.exit_code == exit_code
    assert result.stderr.startswith(line)
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.long
def test_the_whole_way(tmp_path: Path) -> None:
    arguments = ["demo", "-o", str(tmp_path), "--size", "320x180", "--json"]
    result = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["build"]["faces"]["read"] == 1813
    assert report["build"]["faces"]["failed"] == 0
    assert report["verify"]["violations"] == []
    assert report["fly"]["screen_error_px"]["mean"] <= 0.5
    assert report["fly"]["complete_frames"] == 41
    assert report["verify"]["undecided"] == 0
    assert report["verify"]["sampled_surfaces"] == report["verify"]["placed_surfaces"]
    frames = sorted((tmp_path / "frames").glob("frame_*.png"))
    assert len(frames) == report["fly"]["frames"] == 41
    with Image.open(frames[0]) as picture:
        assert picture.size == (320, 180)
        assert len(set(picture.convert("RGB").getdata())) > 100
    assert (tmp_path / "frames" / "contact_sheet.png").is_file()
