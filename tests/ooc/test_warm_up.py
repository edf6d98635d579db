"""What workers do before their first job: all of the loading, none of the compiling."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CODE = """
import sys
from nurbs_ooc.build import box_stage
from nurbs_cache.jit import note_run
from nurbs_ooc.build.warm_up import warm_up
from nurbs_ooc.bounds import pieces
if sys.argv[1] == "compiled":
    note_run(box_stage.__file__)
warm_up()
print(len(pieces._fill.overloads), "nurbs_ooc.build.tile_stage" in sys.modules)
"""


def run(case: str, kernels: Path | None) -> list[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    if kernels:
        environment["NURBS_OOC_KERNEL_CACHE"] = str(kernels)
    done = subprocess.run(
        [sys.executable, "-c", CODE, case], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def test_kernels_are_loaded_but_not_compiled(tmp_path: Path) -> None:
    assert run("new", tmp_path) == ["0", "True"]
    assert not list(tmp_path.rglob("*.nbc"))
    assert run("compiled", None) == ["1", "True"]
