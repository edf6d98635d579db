"""Fixtures that all tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest


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
