"""The benchmark runs and says what it measured; how fast is for people to read."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "bench_serve.py"


def test_it_runs(python_path: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--seconds", "0.1", "--json"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env=python_path,
    )
    report = json.loads(done.stdout)
    assert set(report["cases"]) == {"tile_route", "framework_route", "tile_route_304", "batch"}
    for case in report["cases"].values():
        assert all(value > 0 for value in case.values())
    assert report["tile_bytes"] > 1000
