"""``nurbs-ooc tessellate``: volumes in closed form, the report, and what is left when something fails."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result

from nurbs_cache.store import Store
from nurbs_ooc.cli.main import main
from nurbs_ooc.export import mesh_file
from nurbs_ooc.readers import open_assembly

pytestmark = pytest.mark.kernel

ERROR = 0.05
BLOCK_MM3 = 20.0 * 20.0 * 10.0 - math.pi * 5.0**2 * 10.0
BALL_MM3 = 4.0 / 3.0 * math.pi * 4.0**3


def tessellate(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["tessellate", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture(scope="module")
def meshed(small_step: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """GLB of the small assembly and its report."""
    folder = tmp_path_factory.mktemp("glb")
    path = folder / "small.glb"
    result = tessellate(small_step, "-o", path, "--error", ERROR, "--report", folder / "r.json", "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report == json.loads((folder / "r.json").read_text())
    return path, report


def test_volumes(meshed: tuple[Path, dict[str, Any]]) -> None:
    scene = trimesh.load(meshed[0], force="scene", process=False)
    bodies = [trimesh.Trimesh(m.vertices * 1000.0, m.faces, process=True) for m in scene.dump()]
    assert sum(body.is_watertight for body in bodies) == len(bodies) == 2
    volumes = sorted(body.volume for body in bodies)
    areas = sorted(body.area for body in bodies)
    assert abs(volumes[0] - BALL_MM3) <= areas[0] * ERROR
    assert abs(volumes[1] - BLOCK_MM3) <= areas[1] * ERROR
    bounds = np.array(scene.bounds) * 1000.0
    np.testing.assert_allclose(bounds[0], [0, 0, -20], atol=1.1 * ERROR)
    np.testing.assert_allclose(bounds[1], [20, 34, 0], atol=1.1 * ERROR)


def test_report(meshed: tuple[Path, dict[str, Any]]) -> None:
    path, report = meshed
    assert report["faces"] == {"read": 8, "exact": 8, "healed": 0, "degraded": 0, "failed": 0}
    assert (report["surfaces"], report["occurrences"], report["boundary_edges"]) == (8, 2, 0)
    assert (report["lines"], report["points"], report["not_exact"]) == (0, 0, [])
    assert 0.2 * ERROR < report["certified_error_mm"] <= ERROR
    assert report["bytes"] == path.stat().st_size
    assert report["triangles"] == sum(part["triangles"] for part in report["parts"]) > 100
    assert set(report["seconds"]) >= {"read", "tessellate", "write", "total"}
    angles = report["smallest_angle_deg"]
    assert 0.0 < angles["min"] <= angles["p1"] + 0.05 <= angles["median"] + 0.05 <= 60.0
    assert report["peak_rss_mib"] > 50
    assert report["workers"] >= 1


def test_gltf_validator_has_no_errors(
    meshed: tuple[Path, dict[str, Any]], gltf_issues: Callable[[Path], dict[str, Any]]
) -> None:
    issues = gltf_issues(meshed[0])
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_same_bytes_for_any_number_of_workers(
    meshed: tuple[Path, dict[str, Any]], small_step: Path, tmp_path: Path
) -> None:
    assert tessellate(small_step, "-o", tmp_path / "3.glb", "--error", ERROR, "--workers", 3).exit_code == 0
    assert (tmp_path / "3.glb").read_bytes() == meshed[0].read_bytes()


def test_several_inputs_become_one(meshed: tuple[Path, dict[str, Any]], small_step: Path, tmp_path: Path) -> None:
    second = tmp_path / "second.step"
    shutil.copy(small_step, second)
    result = tessellate(small_step, second, "-o", tmp_path / "both.glb", "--error", ERROR, "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["faces"]["read"] == 16
    assert report["occurrences"] == 4
    assert report["triangles"] == 2 * meshed[1]["triangles"]
    scene = trimesh.load(tmp_path / "both.glb", force="scene", process=False)
    assert len(scene.graph.nodes_geometry) == 4


def test_surface_store_is_an_input(meshed: tuple[Path, dict[str, Any]], small_step: Path, tmp_path: Path) -> None:
    path = tmp_path / "small.nurbs"
    with open_assembly(small_step) as assembly, Store.create(path, provenance={}) as store:
        store.put_parts((part.index, part.info, part.geometry) for part in assembly.parts())
        store.put_scene(assembly.products, assembly.materials, assembly.occurrences, {"stored": "mm"})
    result = tessellate(path, "-o", tmp_path / "small.glb", "--error", ERROR)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "small.glb").read_bytes() == meshed[0].read_bytes()


def test_people_get_one_line(small_step: Path, tmp_path: Path) -> None:
    result = tessellate(small_step, "-o", tmp_path / "s.glb", "--error", 1.0)
    assert "8 faces (all exact)" in result.stdout
    assert len(result.stdout.splitlines()) == 1


@pytest.mark.parametrize("error", ["0", "-1", "nan", "inf"])
def test_bad_error_is_refused(small_step: Path, tmp_path: Path, error: str) -> None:
    result = tessellate(small_step, "-o", tmp_path / "s.glb", "--error", error)
    assert result.exit_code == 2
    assert result.stderr == f"nurbs-ooc: --error {float(error)}: must be a positive number of mm\n"


def test_bad_paths_are_refused(small_step: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.step"
    bad.write_text("not CAD at all")
    calls = {
        "no.step": [tmp_path / "no.step", "-o", tmp_path / "o.glb"],
        "bad.step": [bad, "-o", tmp_path / "o.glb"],
        "does not exist": [small_step, "-o", tmp_path / "nowhere" / "o.glb"],
        "is a folder": [small_step, "-o", tmp_path],
        "is an input": [small_step, "-o", small_step],
    }
    for expected, arguments in calls.items():
        result = tessellate(*arguments, "--error", "1")
        assert result.exit_code == 2
        assert expected in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [bad]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_nothing_is_left_when_it_fails(
    small_step: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(mesh_file.GlbWriter, "write", fail)
    result = tessellate(small_step, "-o", tmp_path / "o.glb", "--error", 1.0)
    assert result.exit_code == (130 if isinstance(error, KeyboardInterrupt) else 2)
    assert len(result.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_one_line(small_step: Path, tmp_path: Path) -> None:
    code = (
        "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "from nurbs_ooc.cli.main import main;"
        "from nurbs_ooc.export.glb_file import GlbSpool; add = GlbSpool.add\n"
        "def limited(self, *a, **k):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)); return add(self, *a, **k)\n"
        "GlbSpool.add = limited; main()"
    )
    command = [sys.executable, "-c", code, "tessellate", str(small_step), "-o", str(tmp_path / "o.glb"), "--error", "1"]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}  # a process of its own would compile everything again
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 2, run.stderr
    assert run.stderr == f"nurbs-ooc: {tmp_path / 'o.glb'}: File too large\n"
    assert list(tmp_path.iterdir()) == []
