"""The product tree and its placed parts as glTF nodes.

Every placed part (occurrence) is one node below its product; a product that is nothing but one placed part
is that node itself. Names and nesting stay as in the file.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.scene_record import Product
from nurbs_ooc.export.gltf_space import matrix4, node_chain

Json = dict[str, Any]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """What a node shows: row of the glTF mesh (None: nothing to draw), its part's name and origin (3,) mm."""

    mesh: int | None
    name: str
    origin: Array


class NodeTree:
    """Builds the nodes of a scene.

    Args:
        products: the tree, parents before children.
        occurrences: ``OCCURRENCE_DTYPE``.
        mesh_of: the mesh of (part, material override).

    Attributes:
        nodes: glTF nodes.
        roots: rows of those without a parent.
    """

    def __init__(
        self,
        products: Sequence[Product],
        occurrences: npt.NDArray[np.void],
        mesh_of: Callable[[int, int], PlacedMesh],
    ) -> None:
        self.nodes: list[Json] = []
        self.roots: list[int] = []
        self._mesh_of = mesh_of
        placed: defaultdict[int, list[np.void]] = defaultdict(list)
        for occurrence in occurrences:
            placed[int(occurrence["product"])].append(occurrence)
        inner = {product.parent for product in products}
        world: list[Array] = []
        children: list[list[int]] = []
        for row, product in enumerate(products):
            is_root = product.parent < 0
            parent = np.eye(4) if is_root else world[product.parent]
            siblings = self.roots if is_root else children[product.parent]
            local = matrix4(product.transform)
            world.append(parent @ local)
            children.append([])
            if len(placed[row]) == 1 and row not in inner:
                (occurrence,) = placed[row]
                self._place(siblings, product.name, occurrence, _local(occurrence, parent, world[row], local))
            else:
                self._append(siblings, product.name, node_chain(local, np.zeros(3)), {"children": children[row]})
                for occurrence in placed[row]:
                    self._place(children[row], "", occurrence, _local(occurrence, world[row], world[row], np.eye(4)))
        for node in self.nodes:
            if node.get("children") == []:  # glTF forbids empty lists
                del node["children"]

    def _place(self, siblings: list[int], name: str, occurrence: np.void, local: Array) -> None:
        """Append the node of one placed part, called ``name`` or else as its part."""
        shown = self._mesh_of(int(occurrence["part"]), int(occurrence["material"]))
        content = {} if shown.mesh is None else {"mesh": shown.mesh}
        self._append(siblings, name or shown.name, node_chain(local, shown.origin), content)

    def _append(self, siblings: list[int], name: str, chain: list[Json], content: Json) -> None:
        """Append one node or two nested ones; the innermost gets ``content``, the outermost joins ``siblings``."""
        siblings.append(len(self.nodes))
        for properties in chain[:-1]:
            self.nodes.append({"name": name, **properties, "children": [len(self.nodes) + 1]})
        self.nodes.append({"name": name, **chain[-1], **content})


def _local(occurrence: np.void, parent: Array, expected: Array, local: Array) -> Array:
    """(4, 4) of an occurrence relative to ``parent``; exactly ``local`` where it stands as ``expected``."""
    transform = matrix4(occurrence["transform"])
    if np.array_equal(transform, expected):  # the usual case, without the rounding of an inverse
        return local
    return np.asarray(np.linalg.solve(parent, transform))
