"""The wheel: built, looked into, installed into an empty environment and run away from the repository."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

PACKAGES = ("nurbs_ooc", "nurbs_cache", "nurbs_server", "nurbs_client")


@pytest.fixture(scope="module")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout, built with the hatchling at hand."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=repository, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``bin`` of a new environment that holds the wheel; its dependencies are those installed here."""
    folder = tmp_path_factory.mktemp("venv")
    venv.create(folder, with_pip=False)
    target = Path(sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)}))
    # --ignore-installed: pip would otherwise remove the project from this environment
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--no-compile",
        "--ignore-installed",
    ]
    subprocess.run([*install, "--prefix", str(folder), str(wheel)], check=True, capture_output=True)
    shared = Path(sysconfig.get_path("purelib"))
    # A .pth line would run the editable install's own .pth too: a plain path entry does not.
    (target / "dependencies.pth").write_text(f"{shared}\n")
    return folder / "bin"


def run(environment: Path, *arguments: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the environment's command as a stranger would: nothing of this process's import path."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    command = [str(environment / "python"), str(environment / "nurbs-ooc"), *arguments]
    return subprocess.run(command, cwd=cwd, env=kept | variables, capture_output=True, text=True, check=False)


def test_wheel_holds_the_four_packages(repository: Path, wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    for package, folder in zip(PACKAGES, ("nurbs_ooc", "cache", "server", "client"), strict=True):
        source = repository / ("" if folder == package else folder) / package
        for path in source.rglob("*.py"):
            assert f"{package}/{path.relative_to(source).as_posix()}" in names
        assert f"{package}/py.typed" in names
    assert {name.split("/")[0] for name in names} - {*PACKAGES} == {"nurbs_ooc-0.1.0.dist-info", "nurbs_ooc-0.1.0.data"}
    example = "nurbs_ooc-0.1.0.data/data/share/nurbs-ooc/examples/trackball_assembly.step.gz"
    assert example in names
    licences = {name.rsplit("/", 1)[1] for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "NOTICE"}


def test_installed_command_shows_its_commands(environment: Path, tmp_path: Path) -> None:
    result = run(environment, "--help", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "Usage: nurbs-ooc" in result.stdout


def test_installed_command_meshes_a_file(environment: Path, small_step: Path, tmp_path: Path) -> None:
    # As plain Python: another folder means other machine code, and compiling it again would take minutes.
    arguments = ["tessellate", str(small_step), "-o", "small.glb", "--error", "0.5", "--json"]
    result = run(environment, *arguments, cwd=tmp_path, NUMBA_DISABLE_JIT="1")
    assert result.returncode == 0, result.stderr
    report = json.loads(result.stdout)
    assert report["faces"] == {"read": 8, "exact": 8, "healed": 0, "degraded": 0, "failed": 0}
    assert report["boundary_edges"] == 0
    assert (tmp_path / "small.glb").stat().st_size == report["bytes"]


def test_packages_come_from_the_wheel(environment: Path, tmp_path: Path) -> None:
    code = f"import json, {', '.join(PACKAGES)}; print(json.dumps([m.__file__ for m in ({', '.join(PACKAGES)})]))"
    command = [str(environment / "python"), "-c", code]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, env={})
    for name in json.loads(result.stdout):
        assert Path(name).is_relative_to(environment.parent)


def test_example_is_found_when_installed(environment: Path, tmp_path: Path) -> None:
    code = "from nurbs_ooc.cli.example import ASSEMBLY, example_path; print(example_path(ASSEMBLY))"
    command = [str(environment / "python"), "-c", code]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, env={})
    assert Path(result.stdout.strip()).is_relative_to(environment.parent)
