"""An assembly as one GLB: the product tree as nested nodes, parts as shared meshes, faces as feature ids.

A part's arrays are written once, however often it is placed and whatever colour a placement gives it.
``_FEATURE_ID_0`` of a vertex is the row of its face in the part; the mesh's extras give the part and the id
of its first face.

Source: Khronos Group, glTF 2.0 Specification; Cesium, EXT_mesh_features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import Material, PartInfo, Product
from nurbs_ooc.export.glb_file import GlbSpool
from nurbs_ooc.export.node_tree import NodeTree, PlacedMesh
from nurbs_ooc.export.part_mesh import PartMesh, Primitive

Json = dict[str, Any]

ROUGHNESS = 0.6  # a CAD file gives a colour only; this looks like painted metal or plastic in any viewer
POINTS, TRIANGLES = 0, 4
FEATURES = "EXT_mesh_features"


class GlbWriter:
    """Takes parts as they come; ``write`` makes the file with the scene around them.

    Args:
        folder: where temporary data may lie: the folder of the file to come.
    """

    def __init__(self, folder: Path) -> None:
        self._spool = GlbSpool(folder)
        self._parts: dict[int, tuple[PartInfo, PartMesh, list[Json]]] = {}
        self._meshes: list[Json] = []
        self._mesh_rows: dict[tuple[int, int], int] = {}
        self._materials: list[Json] = []
        self._material_rows: dict[tuple[int, bool], int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._spool.close()

    def add_part(self, index: int, info: PartInfo, mesh: PartMesh) -> None:
        """Write the arrays of part ``index`` to the spool; only figures of ``mesh`` are kept."""
        primitives = [self._add_primitive(primitive) for primitive in mesh.primitives]
        self._parts[index] = (info, replace(mesh, primitives=[]), primitives)

    def _add_primitive(self, primitive: Primitive) -> Json:
        attributes = {
            "POSITION": self._spool.add(primitive.positions, bounds=True),
            "NORMAL": self._spool.add(primitive.normals),
            "_FEATURE_ID_0": self._spool.add(primitive.features),
        }
        n_features = len(np.unique(primitive.features))
        feature_ids = [{"featureCount": n_features, "attribute": 0, "label": "face"}]
        result: Json = {"attributes": attributes, "material": primitive.material, "mode": POINTS}
        if primitive.indices is not None:
            result |= {"mode": TRIANGLES, "indices": self._spool.add(primitive.indices, is_index=True)}
        return result | {"extensions": {FEATURES: {"featureIds": feature_ids}}}

    def write(
        self,
        path: Path,
        products: Sequence[Product],
        materials: Sequence[Material],
        occurrences: npt.NDArray[np.void],
    ) -> int:
        """Write the file; returns its bytes.

        Args:
            path: the file; written in place, see ``atomic_file``.
            products: the tree, parents before children.
            materials: what the parts' primitives and the occurrences refer to.
            occurrences: ``OCCURRENCE_DTYPE``.

        Raises:
            UsageError: it does not fit a GLB.
        """
        tree = NodeTree(products, occurrences, lambda part, override: self._placed_mesh(part, override, materials))
        document: Json = {
            "asset": {"version": "2.0", "generator": "nurbs-ooc"},
            "scene": 0,
            "scenes": [{"nodes": tree.roots} if tree.roots else {}],
        }
        if self._meshes:
            document["extensionsUsed"] = [FEATURES]
        for name, rows in (("nodes", tree.nodes), ("meshes", self._meshes), ("materials", self._materials)):
            if rows:
                document[name] = rows
        return self._spool.write(path, document)

    def _placed_mesh(self, part: int, override: int, materials: Sequence[Material]) -> PlacedMesh:
        """A part in its own colours (override -1) or in one other."""
        info, mesh, primitives = self._parts[part]
        if not primitives:
            return PlacedMesh(None, info.name, np.zeros(3))
        if (part, override) not in self._mesh_rows:
            is_open = mesh.boundary_edges > 0
            coloured = [
                p | {"material": self._material_row(p["material"] if override < 0 else override, is_open, materials)}
                for p in primitives
            ]
            extras = {"part": part, "first_surface": info.first_surface}
            self._mesh_rows[part, override] = len(self._meshes)
            self._meshes.append({"name": info.name, "primitives": coloured, "extras": extras})
        return PlacedMesh(self._mesh_rows[part, override], info.name, mesh.origin)

    def _material_row(self, material: int, is_open: bool, materials: Sequence[Material]) -> int:
        """Row of the glTF material; open meshes are seen from both sides."""
        if (material, is_open) not in self._material_rows:
            self._material_rows[material, is_open] = len(self._materials)
            self._materials.append(_gltf_material(materials[material], is_open))
        return self._material_rows[material, is_open]


def _gltf_material(material: Material, double_sided: bool) -> Json:
    colour = [min(max(float(c), 0.0), 1.0) for c in material.rgba]
    surface = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    result: Json = {"name": material.name, "pbrMetallicRoughness": surface}
    if colour[3] < 1.0:
        result["alphaMode"] = "BLEND"
    if double_sided:
        result["doubleSided"] = True
    return result
