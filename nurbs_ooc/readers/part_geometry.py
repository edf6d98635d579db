"""All faces of one part as a ``GeometryBatch``, and the parts one after the other behind a fork."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from OCP.BRepTools import BRepTools_PurgeLocations
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS

from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.readers.colours import FACE
from nurbs_ooc.readers.faces import FaceReader, add_failed
from nurbs_ooc.readers.isolation import PART_LIMIT_S, WorkDiedError, run_isolated

SCALE_ROUNDING = 1e-12  # a placement inside a shape with more than this is applied to the geometry


@dataclass(frozen=True)
class PartSource:
    """A part that is still to be recorded.

    Attributes:
        materials: row of the material of each face.
        record: makes the part's geometry; may crash the process.
    """

    name: str
    materials: list[int]
    record: Callable[[], GeometryBatch]


def part_geometry(shape: Any, materials: Sequence[int], name: str) -> GeometryBatch:
    """Record every face of ``shape`` in the order of the kernel's map of faces.

    Args:
        materials: row of the material of each face.
        name: goes into ``sources``, as "name/face 1" and on.
    """
    builder = BatchBuilder()
    reader = FaceReader(builder)
    for index, face in enumerate(_faces(shape)):
        reader.read(TopoDS.Face(face), materials[index], f"{name}/face {index + 1}")
    return builder.build()


def _faces(shape: Any) -> list[Any]:
    faces = _map(shape)
    if not any(_is_scaled(face.Location()) for face in faces):
        return list(faces)
    purge = BRepTools_PurgeLocations()
    purge.Perform(shape)
    return list(_map(purge.GetResult()))


def _map(shape: Any) -> ShapeMap:
    faces = ShapeMap()
    TopExp.MapShapes_s(shape, FACE, faces)
    return faces


def _is_scaled(location: Any) -> bool:
    if location.IsIdentity():
        return False
    return bool(abs(abs(location.Transformation().ScaleFactor()) - 1.0) > SCALE_ROUNDING)


def crashed_part(n_faces: int, name: str, materials: Sequence[int] = ()) -> GeometryBatch:
    """Stands for a part on which the kernel crashed: that many failed faces."""
    builder = BatchBuilder()
    for index in range(n_faces):
        material = materials[index] if materials else 0
        add_failed(builder, FaceReason.KERNEL_CRASHED, material, f"{name}/face {index + 1}")
    return builder.build()


def isolated_parts(parts: Sequence[PartSource], limit_s: float = PART_LIMIT_S) -> Iterator[bytes]:
    """``GeometryBatch.to_bytes()`` of each part; one that kills or hangs its process is only marked.

    One forked process takes the parts in turn; a new one goes on behind a part that ended it.
    """
    done = 0
    while done < len(parts):
        start = done

        def work(send: Callable[[bytes], None], start: int = start) -> None:
            for part in parts[start:]:
                send(part.record().to_bytes())

        try:
            for data in run_isolated(work, limit_s):
                done += 1
                yield data
        except WorkDiedError:
            part = parts[done]
            done += 1
            yield crashed_part(len(part.materials), part.name, part.materials).to_bytes()
