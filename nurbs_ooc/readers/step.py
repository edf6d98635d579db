"""STEP through the kernel: parsing once, then the root shapes in groups."""

from __future__ import annotations

from typing import Any

from OCP.collections import Sequence_TCollection_AsciiString
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPCAFControl import STEPCAFControl_Reader

from nurbs_cache.errors import InputFileError
from nurbs_ooc.readers.kernel_setup import new_document
from nurbs_ooc.readers.leftover import Leftover
from nurbs_ooc.readers.units import ASSUMED, named_unit


class StepFile:
    """A parsed STEP file.

    Roots are products that no other product uses. If there are several and none is an assembly they
    cannot share parts, so each is transferred by itself; an assembly is transferred whole.

    Args:
        path: the plain (not compressed) file.
        shown: how to name it in errors.
    """

    def __init__(self, path: str, shown: str) -> None:
        self.shown = shown
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

    def unit(self) -> tuple[str, float]:
        """Name and size in mm of the file's length unit."""
        lengths, angles, solid_angles = (Sequence_TCollection_AsciiString() for _ in range(3))
        self.reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
        names = [str(name.ToCString()) for name in lengths]
        return named_unit(names[0]) if names else (ASSUMED, 1.0)

    def groups(self) -> list[list[int]]:
        """Root numbers (from 1) that have to be transferred together."""
        roots = list(range(1, self.n_roots + 1))
        return [roots] if self.n_roots == 1 or self._has_assemblies() else [[root] for root in roots]

    def _has_assemblies(self) -> bool:
        model = self.reader.ChangeReader().StepModel()
        kinds = (type(model.Value(i)).__name__ for i in range(1, model.NbEntities() + 1))
        return any(kind == "StepRepr_NextAssemblyUsageOccurrence" for kind in kinds)

    def leftovers(self) -> list[Leftover]:
        """Nothing yet."""
        return []

    def transfer(self, roots: list[int]) -> Any:
        """A document with the given roots, or None if the kernel refuses them."""
        document = new_document()
        if len(roots) == self.n_roots:
            return document if self.reader.Transfer(document) else None
        done = [self.reader.TransferOneRoot(root, document) for root in roots]
        return document if any(done) else None
