"""Open CASCADE's mesher on a whole file: read, meshed from nothing, and how far its triangles are off.

It is measured more kindly than ours: points of its own surface at parameters inside its own triangles, to the nearest
of the face's triangles, no climbing.
"""

from __future__ import annotations

import gzip
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from nurbs_ooc.measure.closest import ClosestPrimitive
from nurbs_ooc.measure.mesh_sampler import sample_triangles

ANGLE = 0.5  # rad, the angular deflection: its usual default, it always applies one


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Open CASCADE writes to the file descriptor itself."""
    sys.stdout.flush()
    keep, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(keep, 1)
        os.close(keep)
        os.close(null)


def read_shape(path: Path) -> Any:
    """The whole file as one shape, in mm."""
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader

    suffixes = [s for s in path.suffixes if s != ".gz"]
    reader = IGESControl_Reader() if suffixes[-1].lower() in (".igs", ".iges") else STEPControl_Reader()
    with tempfile.TemporaryDirectory() as folder, quiet_stdout():
        plain = path
        if path.suffix == ".gz":
            plain = Path(folder) / path.stem
            plain.write_bytes(gzip.decompress(path.read_bytes()))
        reader.ReadFile(str(plain))
        reader.TransferRoots()
        return reader.OneShape()


def faces_of(shape: Any) -> list[Any]:
    """Its faces, each shared one once."""
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    cast = TopoDS.Face_s if hasattr(TopoDS, "Face_s") else TopoDS.Face
    faces: dict[int, Any] = {}
    explorer = TopExp_Explorer(shape, TopAbs_FACE)
    while explorer.More():
        face = explorer.Current().Located(TopLoc_Location())
        faces.setdefault(hash(face), cast(face))
        explorer.Next()
    return list(faces.values())


def mesh_theirs(shape: Any, deflection: float) -> None:
    """Mesh from nothing."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools

    BRepTools.Clean_s(shape)
    BRepMesh_IncrementalMesh(shape, deflection, False, ANGLE, False)


def triangulation(face: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Nodes (n, 3), their parameters (n, 2) and triangles (t, 3) of a meshed face, in its own place."""
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
    if mesh is None or mesh.NbTriangles() == 0:
        return None
    n = range(1, mesh.NbNodes() + 1)
    xyz = np.array([(p.X(), p.Y(), p.Z()) for p in (mesh.Node(i) for i in n)])
    uv = np.array([(p.X(), p.Y()) for p in (mesh.UVNode(i) for i in n)])
    return xyz, uv, np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]) - 1


def attack_theirs(faces: list[Any], samples: int, seed: int) -> dict[str, Any]:
    """Sample their own surfaces inside their own triangles."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    rng = np.random.default_rng(seed)
    worst, triangles, lost, total = 0.0, 0, 0, 0
    for face in faces:
        mesh = triangulation(face)
        if mesh is None:
            lost += 1
            continue
        xyz, uv, t = mesh
        triangles += len(t)
        e1, e2 = uv[t[:, 1]] - uv[t[:, 0]], uv[t[:, 2]] - uv[t[:, 0]]
        areas = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])
        _, pick, weight = sample_triangles(areas, np.array([0, len(t)]), samples, rng)
        inside = weight.max(1) < 1.0
        at = np.einsum("nk,nki->ni", weight[inside], uv[t[pick[inside]]])
        surface = BRepAdaptor_Surface(face, False)
        points = np.array([(p.X(), p.Y(), p.Z()) for p in (surface.Value(u, v) for u, v in at)])
        distance, _ = ClosestPrimitive(xyz, t).query(points)
        worst, total = max(worst, float(distance.max())), total + len(points)
    return {"triangles": triangles, "lost_faces": lost, "samples": total, "error_mm": worst}
