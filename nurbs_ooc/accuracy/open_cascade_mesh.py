"""Open CASCADE's mesher on the faces of a part, its triangles in our arrays: the peer to compare with."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.accuracy.face_meshes import collect_faces
from nurbs_ooc.accuracy.open_cascade_shape import FaceNotBuiltError, ShapeBuilder
from nurbs_ooc.geometry.surface import evaluate
from nurbs_ooc.tessellation.mesh import MeshBatch

ANGLE = 0.5  # rad, its angular deflection: the usual default; it always applies one

Triangles = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class Shape:
    """A part built for Open CASCADE.

    Attributes:
        geometry: where it comes from.
        faces: by row; None if it could not be built.
        compound: all of them.
    """

    geometry: GeometryBatch
    faces: list[Any]
    compound: Any


def build_shape(geometry: GeometryBatch) -> Shape:
    """Hand a part over; faces that failed in reading or that Open CASCADE refuses are None."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Compound

    builder, compound, shapes = BRep_Builder(), TopoDS_Compound(), ShapeBuilder(geometry)
    builder.MakeCompound(compound)
    faces: list[Any] = []
    for row, s in enumerate(geometry.surfaces):
        face = None
        if s["status"] != FaceStatus.FAILED:
            try:
                face = shapes.face(row)
            except FaceNotBuiltError:
                face = None
        if face is not None:
            builder.Add(compound, face)
        faces.append(face)
    return Shape(geometry, faces, compound)


def mesh_shape(shape: Shape, deflection: float) -> tuple[MeshBatch, float]:
    """Mesh from nothing with one core.

    Args:
        shape: of ``build_shape``.
        deflection: mm, linear; the angular one is ``ANGLE``.

    Returns:
        The mesh, whose ``surface_error`` repeats the deflection, and the CPU seconds of meshing alone.
    """
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools

    BRepTools.Clean_s(shape.compound)
    start = time.process_time()
    BRepMesh_IncrementalMesh(shape.compound, deflection, False, ANGLE, False)
    seconds = time.process_time() - start
    return _collect(shape, deflection), seconds


def _triangles(face: Any) -> Triangles | None:
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    mesh = None if face is None else BRep_Tool.Triangulation_s(face, TopLoc_Location())
    if mesh is None or mesh.NbTriangles() == 0:
        return None
    n = range(1, mesh.NbNodes() + 1)
    xyz = np.array([(p.X(), p.Y(), p.Z()) for p in (mesh.Node(i) for i in n)])
    uv = np.array([(p.X(), p.Y()) for p in (mesh.UVNode(i) for i in n)])
    t = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)], np.int64) - 1
    if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        t = t[:, ::-1]
    return xyz, uv, t


def _collect(shape: Shape, deflection: float) -> MeshBatch:
    n = len(shape.faces)
    faces = []
    status, reason = np.zeros(n, np.uint8), np.zeros(n, np.uint16)
    for row, face in enumerate(shape.faces):
        found = _triangles(face)
        xyz, uv, t = found or (np.empty((0, 3)), np.empty((0, 2)), np.empty((0, 3), np.int64))
        if found is None:
            refused = face is None
            status[row] = FaceStatus.FAILED
            reason[row] = FaceReason.KERNEL_REFUSED if refused else FaceReason.NO_TRIANGLES
        faces.append((xyz, evaluate(shape.geometry, row, uv)[1], uv, t))
    return collect_faces(faces, deflection, status, reason)
