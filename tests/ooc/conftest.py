"""Fixtures of the pipeline's tests."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).with_name("gltf_validator.js")
INSTALL_TIMEOUT_S = 120


@pytest.fixture(scope="session")
def gltf_issues(pytestconfig: pytest.Config) -> Callable[[Path], dict[str, Any]]:
    """What Khronos' gltf-validator says of a file; skips where node or the validator cannot be had."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        pytest.skip("gltf-validator needs node and npm")
    folder = Path(pytestconfig.cache.mkdir("gltf-validator"))
    if not (folder / "node_modules" / "gltf-validator").is_dir():
        command = [npm, "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(folder), "gltf-validator"]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=INSTALL_TIMEOUT_S)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            pytest.skip(f"gltf-validator cannot be installed: {error}")

    def issues(path: Path) -> dict[str, Any]:
        environment = {**os.environ, "NODE_PATH": str(folder / "node_modules")}
        run = subprocess.run([node, SCRIPT, path], env=environment, capture_output=True, text=True, check=True)
        report: dict[str, Any] = json.loads(run.stdout)
        return report

    return issues
