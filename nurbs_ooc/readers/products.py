"""The kernel's document as product tree, parts and placements.

A leaf product becomes one part however often it is placed. Colours: a face's own before its shell's,
solid's or compound's, then the instance's, the product's, the parent's. Where some faces have their
own colour and the rest take the instance's, each such instance colour makes a part of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import Sequence_TDF_Label
from OCP.TCollection import TCollection_AsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label, TDF_Tool
from OCP.TopExp import TopExp
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from nurbs_cache.scene_record import Product
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.forms import Array
from nurbs_ooc.readers.colours import FACE, MaterialTable, Rgb, Rgba, face_colours, label_colour, linear
from nurbs_ooc.readers.messages import Placement, Scene
from nurbs_ooc.readers.part_geometry import PartSource, part_geometry

IDENTITY: Array = np.eye(4)


@dataclass
class Prototype:
    """A leaf product: its shape and the colours that the file gives it.

    Attributes:
        own: colour of the whole product, None if it has none.
        by_face: colour by index in ``faces`` of those that differ from the whole.
    """

    name: str
    shape: Any
    faces: ShapeMap
    own: Rgba | None
    by_face: dict[int, Rgba]


@dataclass
class ProductTree:
    """Walks a document once and keeps what ``scene`` and the part reader need."""

    table: MaterialTable = field(default_factory=MaterialTable)
    products: list[Product] = field(default_factory=list)
    parts: list[PartSource] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)
    _prototypes: dict[str, Prototype] = field(default_factory=dict)
    _rows: dict[tuple[str, Rgba | None], int] = field(default_factory=dict)

    def add_document(self, document: Any) -> None:
        """Take in all free shapes of ``document``."""
        tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        roots = Sequence_TDF_Label()
        tool.GetFreeShapes(roots)
        for root in roots:
            self._walk(root, -1, IDENTITY, None)

    def add_single(self, name: str, rgb: Rgb | None, record: Callable[[int], GeometryBatch]) -> None:
        """Take in one face that is not in the document; ``record`` gets its material's row, ``rgb`` is sRGB."""
        material = self.table.row(None if rgb is None else linear(rgb))
        identity = tuple(IDENTITY[:3].ravel().tolist())
        self.placements.append((len(self.parts), len(self.products), -1, identity))
        self.products.append(Product(name, -1, identity))
        self.parts.append(PartSource(name, [material], partial(record, material)))

    def scene(self) -> Scene:
        """Everything but the geometry."""
        names = [part.name for part in self.parts]
        counts = [len(part.materials) for part in self.parts]
        return Scene(self.products, self.table.materials, self.placements, names, counts)

    def _walk(self, label: Any, parent: int, placed: Array, inherited: Rgba | None) -> None:
        """``label`` is a free shape or a component; ``placed`` takes its parent to the assembly."""
        local, instance, target = IDENTITY, None, label
        if XCAFDoc_ShapeTool.IsReference_s(label):
            local = _matrix(XCAFDoc_ShapeTool.GetLocation_s(label))
            instance, target = label_colour(label), TDF_Label()
            XCAFDoc_ShapeTool.GetReferredShape_s(label, target)
        placed = placed @ local
        row = len(self.products)
        name = _name(target) or _name(label) or f"product {row}"
        self.products.append(Product(name, parent, tuple(local[:3].ravel().tolist())))
        if XCAFDoc_ShapeTool.IsAssembly_s(target):
            components = Sequence_TDF_Label()
            XCAFDoc_ShapeTool.GetComponents_s(target, components)
            for component in components:
                self._walk(component, row, placed, instance or label_colour(target) or inherited)
            return
        self._place(self._prototype(target, name), _entry(target), row, placed, instance, inherited)

    def _prototype(self, label: Any, name: str) -> Prototype:
        entry = _entry(label)
        if entry not in self._prototypes:
            shape, faces = XCAFDoc_ShapeTool.GetShape_s(label), ShapeMap()
            TopExp.MapShapes_s(shape, FACE, faces)
            own, by_face = label_colour(label), face_colours(label, faces)
            if len(by_face) == len(faces) and len(set(by_face.values())) == 1:
                own, by_face = next(iter(by_face.values())), {}
            self._prototypes[entry] = Prototype(name, shape, faces, own, by_face)
        return self._prototypes[entry]

    def _place(
        self,
        prototype: Prototype,
        entry: str,
        product: int,
        placed: Array,
        instance: Rgba | None,
        inherited: Rgba | None,
    ) -> None:
        """Add a placement, and the part if it is the first one."""
        n_faces = len(prototype.faces)
        if n_faces == 0:
            return
        whole = instance or prototype.own or inherited
        mixed = 0 < len(prototype.by_face) < n_faces
        base = whole if mixed else prototype.own
        key = (entry, base)
        if key not in self._rows:
            self._rows[key] = len(self.parts)
            rows = [self.table.row(prototype.by_face.get(i + 1, base)) for i in range(n_faces)]
            record = partial(part_geometry, prototype.shape, rows, prototype.name)
            self.parts.append(PartSource(prototype.name, rows, record))
        override = -1
        if whole != base and not prototype.by_face:
            override = self.table.row(whole)
        self.placements.append((self._rows[key], product, override, tuple(placed[:3].ravel().tolist())))


def _matrix(location: Any) -> Array:
    """4 x 4 matrix of a ``TopLoc_Location``; mirrors and scales included."""
    matrix = np.eye(4)
    if not location.IsIdentity():
        transform = location.Transformation()
        matrix[:3] = [[transform.Value(i, j) for j in range(1, 5)] for i in range(1, 4)]
    return matrix


def _name(label: Any) -> str:
    attribute = TDataStd_Name()
    if not label.FindAttribute(TDataStd_Name.GetID_s(), attribute):
        return ""
    return str(attribute.Get().ToExtString()).strip()


def _entry(label: Any) -> str:
    text = TCollection_AsciiString()
    TDF_Tool.Entry_s(label, text)
    return str(text.ToCString())
