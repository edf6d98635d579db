"""Faces whose loops run around a closed surface without a seam, repaired by the kernel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from OCP.ShapeFix import ShapeFix_Face
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS


def repaired_faces(face: Any) -> Iterator[Any]:
    """What the kernel makes of ``face`` when it adds seams and poles: one face or several."""
    fix = ShapeFix_Face(face)
    fix.FixMissingSeamMode = 1
    fix.FixPeriodicDegeneratedMode = 1
    fix.Perform()
    explorer = TopExp_Explorer(fix.Result(), TopAbs_ShapeEnum.TopAbs_FACE)
    while explorer.More():
        yield TopoDS.Face(explorer.Current())
        explorer.Next()
