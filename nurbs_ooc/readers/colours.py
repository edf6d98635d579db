"""Colours of labels and sub-shapes in the kernel's document, and the table of materials made of them."""

from __future__ import annotations

from typing import Any

from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import Sequence_TDF_Label
from OCP.Quantity import Quantity_Color, Quantity_ColorRGBA, Quantity_TypeOfColor
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.XCAFDoc import XCAFDoc_ColorTool, XCAFDoc_ColorType, XCAFDoc_ShapeTool

from nurbs_cache.scene_record import DEFAULT_MATERIAL, Material

Rgb = tuple[float, float, float]
Rgba = tuple[float, float, float, float]
COLOUR_KINDS = (XCAFDoc_ColorType.XCAFDoc_ColorSurf, XCAFDoc_ColorType.XCAFDoc_ColorGen)
FACE = TopAbs_ShapeEnum.TopAbs_FACE


def label_colour(label: Any) -> Rgba | None:
    """Linear red, green, blue and opacity of ``label``, its surface colour before its general one."""
    colour = Quantity_ColorRGBA()
    for kind in COLOUR_KINDS:
        if XCAFDoc_ColorTool.GetColor_s(label, kind, colour):
            rgb = colour.GetRGB()  # the kernel keeps colours linear
            return (rgb.Red(), rgb.Green(), rgb.Blue(), colour.Alpha())
    return None


def face_colours(label: Any, faces: ShapeMap) -> dict[int, Rgba]:
    """Colour by index in ``faces`` (from 1) of faces that have one of their own or of their shell or solid."""
    children = Sequence_TDF_Label()
    XCAFDoc_ShapeTool.GetSubShapes_s(label, children)
    coloured = []
    for child in children:
        rgba = label_colour(child)
        if rgba is not None:
            shape = XCAFDoc_ShapeTool.GetShape_s(child)
            coloured.append((int(shape.ShapeType()), shape, rgba))
    coloured.sort(key=lambda entry: entry[0])  # compounds, solids, shells, faces: the finer one wins
    found: dict[int, Rgba] = {}
    for _, shape, rgba in coloured:
        members = ShapeMap()
        TopExp.MapShapes_s(shape, FACE, members)
        for face in members:
            index = faces.FindIndex(face)
            if index:
                found[index] = rgba
    return found


class MaterialTable:
    """Materials by colour; row 0 is the default for what has none."""

    def __init__(self) -> None:
        self.materials: list[Material] = [DEFAULT_MATERIAL]
        self._rows: dict[Rgba | None, int] = {None: 0}

    def row(self, rgba: Rgba | None) -> int:
        """Row of the material with this colour."""
        if rgba is not None and rgba not in self._rows:
            self._rows[rgba] = len(self.materials)
            self.materials.append(Material(_hex_name(rgba), rgba))
        return self._rows[rgba]


def linear(rgb: Rgb) -> Rgba:
    """An opaque colour given in sRGB."""
    colour = Quantity_Color(*rgb, Quantity_TypeOfColor.Quantity_TOC_sRGB)
    return (colour.Red(), colour.Green(), colour.Blue(), 1.0)


def _hex_name(rgba: Rgba) -> str:
    """The colour as designers write it, "#rrggbb" in sRGB."""
    colour = Quantity_Color(*rgba[:3], Quantity_TypeOfColor.Quantity_TOC_RGB)
    name = str(Quantity_Color.ColorToHex_s(colour).ToCString()).lower()
    return name if rgba[3] >= 1.0 else f"{name} {rgba[3]:.2f}"
