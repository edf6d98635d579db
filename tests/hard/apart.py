"""Tessellation in a process of its own, for what might not end by itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.tessellation.mesh import MeshBatch

CHILD = """
import sys
from pathlib import Path
import numpy as np
from nurbs_cache.errors import NurbsOocError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.tessellation.tessellate import tessellate
try:
    mesh = tessellate(GeometryBatch.from_bytes(Path(sys.argv[1]).read_bytes()), float(sys.argv[3]))
    np.savez(sys.argv[2], **vars(mesh))
except NurbsOocError:
    pass
"""


def tessellate_apart(geometry: GeometryBatch, error: float, folder: Path, limit_s: float) -> MeshBatch | None:
    """Tessellate in a child process.

    Args:
        geometry: the part.
        error: mm.
        folder: for the record and the mesh.
        limit_s: after this the child is stopped and ``subprocess.TimeoutExpired`` raised; generous, for it
            tells only what ends from what does not.

    Returns:
        The mesh; None if the part was refused.
    """
    source, target = folder / "part", folder / "mesh.npz"
    source.write_bytes(geometry.to_bytes())
    target.unlink(missing_ok=True)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run(
        [sys.executable, "-c", CHILD, str(source), str(target), str(error)],
        check=True,
        timeout=limit_s,
        env=environment,
    )
    if not target.exists():
        return None
    with np.load(target) as arrays:
        return MeshBatch(**arrays)
