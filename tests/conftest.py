"""Fixtures that all tests share."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_counts() -> None:
    """Also where the tests run in the background of a shell, which lets them ignore Ctrl-C, and their children too."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of this checkout."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real models, named by NURBS_OOC_DATA."""
    name = os.environ.get("NURBS_OOC_DATA")
    if not name:
        pytest.skip("NURBS_OOC_DATA does not name a folder of real models")
    folder = Path(name)
    if not folder.is_dir():
        pytest.fail(f"NURBS_OOC_DATA: {folder} is not a folder")
    return folder


@pytest.fixture(scope="session")
def data_file(data_dir: Path) -> Callable[[str], Path]:
    """A model of ``data_dir`` by name; skips where that folder lacks it."""

    def find(name: str) -> Path:
        path = data_dir / name
        if not path.exists():
            pytest.skip(f"{path} is not there")
        return path

    return find


@pytest.fixture(scope="session")
def example_file(repository: Path) -> Path:
    """The assembly that is shipped with the project."""
    return repository / "examples" / "trackball_assembly.step.gz"


@pytest.fixture
def cache_path(tmp_path: Path) -> Path:
    """A path in a fresh folder where a cache may be made."""
    return tmp_path / "cache"


@pytest.fixture(scope="session")
def small_step(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """STEP file of a block of 20 x 20 x 10 mm with a through hole of radius 5, and a ball of radius 4 above it."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeSphere
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    block = BRepPrimAPI_MakeBox(20.0, 20.0, 10.0).Shape()
    hole = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(10.0, 10.0, -1.0), gp_Dir(0.0, 0.0, 1.0)), 5.0, 12.0).Shape()
    ball = BRepPrimAPI_MakeSphere(gp_Pnt(10.0, 10.0, 30.0), 4.0).Shape()
    writer = STEPControl_Writer()
    for shape in (BRepAlgoAPI_Cut(block, hole).Shape(), ball):
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    path = tmp_path_factory.mktemp("step") / "small.step"
    writer.Write(str(path))
    return path
