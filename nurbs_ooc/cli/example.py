"""Where the shipped example lies: inside an installed package, or in the checkout it runs from."""

from __future__ import annotations

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
    package = Path(nurbs_ooc.__file__).parent
    for folder in (package / "examples", package.parent / "examples"):
        if (folder / name).is_file():
            return folder / name
    raise InputFileError(f"{name}: the example is neither in {package} nor beside it")
