"""Faces that a file has but the kernel does not give out."""

from __future__ import annotations

from collections.abc import Callable

from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.readers.faces import add_failed

Leftover = tuple[str, tuple[float, float, float] | None, Callable[[int], GeometryBatch]]
"""Name, sRGB colour if any, and what records it with a given row of materials."""


def refused(name: str) -> Leftover:
    """A face of which nothing but its name can be given."""

    def record(material: int) -> GeometryBatch:
        builder = BatchBuilder()
        add_failed(builder, FaceReason.KERNEL_REFUSED, material, name)
        return builder.build()

    return name, None, record
