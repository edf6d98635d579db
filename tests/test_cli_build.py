"""``nurbs-ooc build`` and ``nurbs-ooc info`` as a user runs them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.ooc.scenes import write_scene

ROOT = Path(__file__).parents[1]
ENV = {**os.environ, "PYTHONPATH": os.pathsep.join(str(ROOT / p) for p in (".", "cache", "server", "client"))}


def nurbs_ooc(*arguments: object, check: int = 0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "nurbs_ooc", *map(str, arguments)]
    result = subprocess.run(command, env=ENV, capture_output=True, text=True)
    assert result.returncode == check, result.stderr
    return result


def one_line(text: str) -> bool:
    return text.count("\n") == 1 and "Traceback" not in text


def test_build_reports_and_info_agrees(tmp_path: Path) -> None:
    source, cache = write_scene(tmp_path / "scene.nurbs"), tmp_path / "cache"
    out = nurbs_ooc("build", source, "-o", cache, "--workers", 2, "--report", tmp_path / "r.json", "--json")
    report = json.loads(out.stdout)
    assert report == json.loads((tmp_path / "r.json").read_text())
    assert report["faces"] == {"read": 34, "exact": 34, "healed": 0, "degraded": 0, "failed": 0}
    assert (report["surfaces"], report["placed_surfaces"], report["occurrences"]) == (34, 103, 7)
    assert report["workers"] == 2
    assert report["face_reasons"] == {}
    assert {"read", "tessellate", "hierarchy", "hlod", "write", "total"} <= report["seconds"].keys()
    assert min(report["triangles"], report["points"], report["lines"], report["bytes"], report["peak_rss_mib"]) > 0
    assert report["nodes"] == report["tiles"]
    found = json.loads(nurbs_ooc("info", cache, "--json").stdout)
    assert len(found["content_hash"]) == 32
    assert {key: found[key] for key in ("faces", "nodes", "levels", "triangles")} == {
        key: report[key] for key in ("faces", "nodes", "levels", "triangles")
    }
    text = nurbs_ooc("info", cache).stdout
    assert found["content_hash"] in text
    assert "scene" in text
    assert "red" in text


def test_refusals_are_one_line(tmp_path: Path) -> None:
    source, cache = write_scene(tmp_path / "scene.nurbs", n=1), tmp_path / "cache"
    assert one_line(nurbs_ooc("build", tmp_path / "none.step", "-o", cache, check=2).stderr)
    assert not cache.exists()
    nurbs_ooc("build", source, "-o", cache, "--levels", "root")
    assert one_line(nurbs_ooc("build", source, "-o", cache, check=2).stderr)
    assert one_line(nurbs_ooc("info", tmp_path / "none", check=2).stderr)
    nurbs_ooc("build", source, "-o", cache, "--levels", "all", "--resume")


@pytest.mark.data
def test_as1_is_built(data_file: Callable[[str], Path], tmp_path: Path) -> None:
    report = json.loads(
        nurbs_ooc("build", data_file("as1-oc-214.stp"), "-o", tmp_path / "cache", "--json").stdout
    )  # fmt: skip
    assert report["surfaces"] == 53
    assert report["placed_surfaces"] == 160
    assert report["faces"]["failed"] == 0
    assert report["tiles"] == report["nodes"]


@pytest.mark.long
def test_trackball_is_built(example_file: Path, tmp_path: Path) -> None:
    report = json.loads(nurbs_ooc("build", example_file, "-o", tmp_path / "cache", "--json").stdout)
    assert report["surfaces"] == 1813
    assert report["faces"]["failed"] == 0
    assert report["tiles"] == report["nodes"]


@pytest.mark.long
def test_ctrl_c_stops_within_seconds_and_resumes(example_file: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    command = [sys.executable, "-m", "nurbs_ooc", "build", str(example_file), "-o", str(cache)]
    process = subprocess.Popen(command, env=ENV, stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "cache.partial" / "data.mdb").exists():
        time.sleep(0.1)
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    start = time.monotonic()
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "--resume" in error
    assert time.monotonic() - start < 5.0  # about one; the machine may be busy
    assert not cache.exists()
    nurbs_ooc("build", example_file, "-o", cache, "--resume")
