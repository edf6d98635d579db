"""IGES through the kernel, and what the kernel leaves out straight from the file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IGESCAFControl import IGESCAFControl_Reader

from nurbs_cache.errors import InputFileError
from nurbs_ooc.readers.iges_bare import IgesText
from nurbs_ooc.readers.kernel_setup import new_document
from nurbs_ooc.readers.leftover import Leftover, refused
from nurbs_ooc.readers.units import ASSUMED, UNITS_MM, named_unit

OWN_NAME_FLAG = 3  # the unit is given by name only
UNIT_FLAGS = {
    1: "inch",
    2: "millimetre",
    4: "foot",
    5: "mile",
    6: "metre",
    7: "kilometre",
    8: "mil",
    9: "micrometre",
    10: "centimetre",
    11: "microinch",
}


class IgesFile:
    """A parsed IGES file; its entities are transferred together.

    Args:
        path: the plain (not compressed) file.
        shown: how to name it in errors.
    """

    def __init__(self, path: str, shown: str) -> None:
        self.path, self.shown = path, shown
        self.reader = IGESCAFControl_Reader()
        self.reader.SetReadVisible(True)
        if self.reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise InputFileError(f"{shown}: not a readable IGES file (truncated or malformed)")
        self.model = self.reader.IGESModel()
        if self.model.NbEntities() == 0:
            raise InputFileError(f"{shown}: IGES file without entities")

    def unit(self) -> tuple[str, float]:
        """Name and size in mm of the file's length unit."""
        section = self.model.GlobalSection()
        name, flag = section.UnitName(), int(section.UnitFlag())
        if flag in UNIT_FLAGS:
            return UNIT_FLAGS[flag], UNITS_MM[UNIT_FLAGS[flag]]
        if flag == OWN_NAME_FLAG and name is not None:
            return named_unit(str(name.ToCString()))
        return ASSUMED, 1.0

    def groups(self) -> list[list[int]]:
        """All roots at once: surfaces of one body are roots of their own here."""
        return [[]]

    def transfer(self, _roots: list[int]) -> Any:
        """A document with all shapes, or None if the kernel finds none."""
        document = new_document()
        return document if self.reader.Transfer(document) else None

    def transferred(self) -> set[int]:
        """Directory numbers of the entities for which the kernel made a shape."""
        process = self.reader.WS().TransferReader().TransientProcess()
        numbers = set()
        for index in range(1, process.NbMapped() + 1):
            binder = process.MapItem(index)
            if binder is not None and binder.HasResult():
                numbers.add(int(self.model.DNum(process.Mapped(index))))
        return numbers

    def leftovers(self, transferred: set[int]) -> list[Leftover]:
        """Bare B-spline surfaces as they are in the file; trimmed ones as failed faces."""
        text, unit_mm = IgesText(Path(self.path), self.shown), self.unit()[1]
        bare: list[Leftover] = [
            (surface.name, surface.rgb, partial(surface.geometry, unit_mm))
            for surface in text.missing_surfaces(transferred)
        ]
        trimmed = text.missing_trimmed(transferred)
        return bare + [refused(f"{entity.label or 'trimmed surface'} D{entity.number}") for entity in trimmed]
