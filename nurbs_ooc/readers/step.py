"""STEP through the kernel: parsing once, then the root shapes in groups."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from OCP.collections import Sequence_TCollection_AsciiString
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPCAFControl import STEPCAFControl_Reader

from nurbs_cache.errors import InputFileError
from nurbs_ooc.readers.kernel_setup import new_document
from nurbs_ooc.readers.leftover import Leftover, refused
from nurbs_ooc.readers.units import ASSUMED, named_unit

FACES = ("StepShape_AdvancedFace", "StepShape_FaceSurface")
USAGE = "StepRepr_NextAssemblyUsageOccurrence"
ENTITY = re.compile(rb"#(\d+)\s*=")


class StepFile:
    """A parsed STEP file.

    Roots are products that no other product uses. If there are several and none is an assembly they
    cannot share parts, so each is transferred by itself; an assembly is transferred whole.

    Args:
        path: the plain (not compressed) file.
        shown: how to name it in errors.
    """

    def __init__(self, path: str, shown: str) -> None:
        self.path, self.shown = path, shown
        self.reader = STEPCAFControl_Reader()
        self.reader.SetGDTMode(False)
        self.reader.SetMatMode(False)
        self.reader.SetViewMode(False)
        self.reader.SetLayerMode(False)
        if self.reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise InputFileError(f"{shown}: not a readable STEP file (truncated or malformed)")
        self.n_roots = int(self.reader.NbRootsForTransfer())
        if self.n_roots == 0:
            raise InputFileError(f"{shown}: STEP file without any shape or product")
        self.faces: dict[int, Any] = {}
        self.has_assemblies = False
        self._list_entities()

    def _list_entities(self) -> None:
        """Find the faces by their number in the file's order (from 1), and whether products are nested."""
        model = self.reader.ChangeReader().StepModel()
        self.n_entities = int(model.NbEntities())
        for number in range(1, self.n_entities + 1):
            entity = model.Value(number)
            kind = type(entity).__name__
            if kind in FACES:
                self.faces[number] = entity
            elif kind == USAGE:
                self.has_assemblies = True

    def unit(self) -> tuple[str, float]:
        """Name and size in mm of the file's length unit."""
        lengths, angles, solid_angles = (Sequence_TCollection_AsciiString() for _ in range(3))
        self.reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
        names = [str(name.ToCString()) for name in lengths]
        return named_unit(names[0]) if names else (ASSUMED, 1.0)

    def groups(self) -> list[list[int]]:
        """Root numbers (from 1) that have to be transferred together."""
        roots = list(range(1, self.n_roots + 1))
        return [roots] if self.n_roots == 1 or self.has_assemblies else [[root] for root in roots]

    def transferred(self) -> set[int]:
        """Numbers, in the file's order, of the faces for which the kernel made a shape."""
        process = self.reader.ChangeReader().WS().TransferReader().TransientProcess()
        known = {id(entity): number for number, entity in self.faces.items()}
        done = set()
        for index in range(1, process.NbMapped() + 1):
            number = known.get(id(process.Mapped(index)))
            if number is not None and process.MapItem(index).HasResult():
                done.add(number)
        return done

    def leftovers(self, transferred: set[int]) -> list[Leftover]:
        """The other faces, each as a failed one named by its entity."""
        missing = [number for number in self.faces if number not in transferred]
        if not missing:
            return []
        labels = ENTITY.findall(Path(self.path).read_bytes())
        exact = len(labels) == self.n_entities  # the kernel keeps the file's order
        return [refused(f"#{int(labels[n - 1])}" if exact else f"face entity {n}") for n in missing]

    def transfer(self, roots: list[int]) -> Any:
        """A document with the given roots, or None if the kernel refuses them."""
        document = new_document()
        if len(roots) == self.n_roots:
            return document if self.reader.Transfer(document) else None
        done = [self.reader.TransferOneRoot(root, document) for root in roots]
        return document if any(done) else None
