"""Where the shipped example lies: beside the packages in a checkout, in ``share/`` where a wheel is installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import nurbs_ooc
from nurbs_cache.errors import InputFileError

ASSEMBLY = "trackball_assembly.step.gz"
CAMERA_PATH = "trackball_path.json"


def example_path(name: str) -> Path:
    """Path of a shipped file.

    Raises:
        InputFileError: it was not shipped.
    """
    checkout = Path(nurbs_ooc.__file__).parent.parent / "examples" / name
    for path in (checkout, *_installed(name)):
        if path.is_file():
            return path
    raise InputFileError(f"{name}: the example is neither in {checkout.parent} nor among the installed files")


def _installed(name: str) -> list[Path]:
    """What the installed distribution has under this name; nothing if it is not installed."""
    try:
        listed = files("nurbs-ooc") or []
    except PackageNotFoundError:
        return []
    return [Path(str(file.locate())).resolve() for file in listed if file.name == name]
