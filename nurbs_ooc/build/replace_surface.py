"""Replacing a surface of a finished cache: its boxes, the boxes of the nodes above it, and nothing else.

Every placement of the surface stays in the node that holds it, whose box and whose ancestors' boxes become the union
of what they hold again; so every surface stays in exactly one place and boxes stay nested. A surface that has grown
may now be held deeper than a build from scratch would put it. That costs speed, not correctness: a node's error
follows from its box as ever.

Exactly the nodes that contain the surface lose their tiles: with the surface they are all that shows it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.edit_tables import SurfaceEdit
from nurbs_cache.errors import UsageError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.surface_record import GeometryBatch
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.forest import Forest, Rows
from nurbs_ooc.build.open_forest import changing, note_edit, open_forest
from nurbs_ooc.geometry.replaced import with_surface
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.hierarchy.boxes import PartSketch, placed_items, sketch_part
from nurbs_ooc.hierarchy.lazy_octree import level_of_edge


def replace_surface(store: TypedStore, surface_id: int, one: GeometryBatch) -> Rows:
    """Replace a surface wherever it is placed, and mark the nodes that contain it as stale, in one transaction.

    ``build.rebuild_stale`` builds their tiles again, or whoever first asks for one. Its levels of detail are
    dropped. What it costs follows from the surface, its placements and their ancestors.

    Args:
        store: open for writing, its trees built.
        surface_id: which.
        one: the new surface alone, mm, in part space; its material is ignored. An edge that is one of the
            part's, number for number, stays shared with the surfaces beside it.

    Returns:
        Ascending rows of all nodes that contain the surface: their boxes are new, they have no tiles.

    Raises:
        MissingRecordError: there is no such surface.
        UsageError: ``one`` is not one surface, nothing of it can be tessellated, or the old one is in no node
            because that was so of it; then the cache must be built again.
    """
    part, row = store.locate_surface(surface_id)
    with changing(store):
        geometry = with_surface(store.get_part(part), row, one, part)
        sketch = sketch_part(subset(geometry, [row]))
        if not sketch.drawable[0]:
            raise UsageError(f"surface {surface_id}: nothing of what shall replace it can be tessellated")
        forest = open_forest(store)
        rows = forest.items_of(surface_id)
        if not len(rows):
            raise UsageError(f"surface {surface_id}: is in no node, so that it has no place to be replaced in")
        items = _placed(forest, rows, sketch, surface_id)
        nodes = ancestors(forest.nodes, forest.items["node"][rows])
        records = _refitted(forest, nodes, rows, items, float(store.tree_params()["edge_over_error"]))
        store.put_edit(SurfaceEdit(surface_id, part, geometry, rows, items, nodes, records, _face(sketch, surface_id)))
        forest.replace(rows, items, nodes, records)
        note_edit(store, forest)
    return nodes


def ancestors(nodes: npt.NDArray[np.void], rows: npt.NDArray[np.integer]) -> Rows:
    """Ascending rows of nodes and of all that are above them."""
    found = [np.zeros(0, np.int64)]
    here = np.unique(rows).astype(np.int64)
    while len(here):
        found.append(here)
        above = nodes["parent"][here]
        here = np.unique(above[above >= 0]).astype(np.int64)
    return np.unique(np.concatenate(found))


def _placed(forest: Forest, rows: Rows, sketch: PartSketch, surface_id: int) -> npt.NDArray[np.void]:
    """The new records of a surface's items."""
    occurrences = forest.items["occurrence"][rows]
    items = placed_items(sketch, surface_id, occurrences, forest.placements.points[occurrences])
    items["node"] = forest.items["node"][rows]
    return items


def _refitted(
    forest: Forest, nodes: Rows, rows: Rows, items: npt.NDArray[np.void], edge_over_error: float
) -> npt.NDArray[np.void]:
    """Records of ``nodes`` (ascending, with all ancestors) once the items in ``rows`` are ``items``, without tiles."""
    records = forest.nodes[nodes].copy()
    changed = dict(zip(nodes.tolist(), records, strict=True))
    for record in reversed(list(changed.values())):  # children have larger rows than their parents
        first, n_direct = int(record["first_item"]), int(record["n_direct"])
        direct = forest.items[first : first + n_direct].copy()
        mine = (rows >= first) & (rows < first + n_direct)
        direct[rows[mine] - first] = items[mine]
        children = range(int(record["first_child"]), int(record["first_child"]) + int(record["n_children"]))
        _refit(record, direct, [changed.get(child, forest.nodes[child]) for child in children], edge_over_error)
    return records


def _refit(record: np.void, direct: npt.NDArray[np.void], children: list[np.void], edge_over_error: float) -> None:
    """Box, level and error of a node from what it holds; no tile."""
    record["aabb_min"] = np.min([*direct["aabb_min"], *(child["aabb_min"] for child in children)], axis=0)
    record["aabb_max"] = np.max([*direct["aabb_max"], *(child["aabb_max"] for child in children)], axis=0)
    record["level"] = level_of_edge((record["aabb_max"] - record["aabb_min"]).max(), edge_over_error)
    errors = [float(child["geometric_error"]) for child in children]
    record["geometric_error"] = max([float(np.ldexp(1.0, record["level"])), *errors])
    record["tile_hash"], record["tile_bytes"] = b"", 0
    record["n_triangles"] = record["n_lines"] = record["n_points"] = 0


def _face(sketch: PartSketch, surface_id: int) -> npt.NDArray[np.void]:
    """The surface's row of the face report."""
    face = np.zeros(1, FACE_REPORT_DTYPE)
    face["surface"], face["status"], face["reason"] = surface_id, sketch.status, sketch.reason
    face["certified"] = sketch.error
    return face
