"""Tiles that are built when somebody first asks for them, and kept.

The bytes are those of the batch build. Callers make sure that one tile is not built twice at a time;
building it twice is a waste, not an error.
"""

from __future__ import annotations

import threading
import weakref

import numpy as np

from nurbs_cache.errors import UsageError
from nurbs_cache.ledger import Ledger
from nurbs_cache.node_record import LOD_DTYPE
from nurbs_cache.tile import TileContent, tile_counts, tile_hash, tile_ledger
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.codec_choice import codec_of
from nurbs_ooc.build.error_order import raise_ancestors
from nurbs_ooc.build.forest import Forest
from nurbs_ooc.build.node_tiles import build_nodes, encoded
from nurbs_ooc.build.surface_meshes import mesh_surfaces
from nurbs_ooc.tessellation.tessellate import tessellate

FINEST_LOD, COARSEST_LOD = -40, 40  # ladder levels that a client may ask for: 2**level mm

_forests: weakref.WeakKeyDictionary[TypedStore, Forest] = weakref.WeakKeyDictionary()
_loading = threading.Lock()
_updating = threading.Lock()


def _forest(store: TypedStore) -> Forest:
    """The tables of a store, read once; boxes and items do not change when tiles are added."""
    with _loading:
        if store not in _forests:
            _forests[store] = Forest.load(store)
        return _forests[store]


def build_node_tile(store: TypedStore, row: int, workers: int = 1) -> tuple[str, bytes]:
    """Build the tile of a node, store it and update the node and its ancestors' errors.

    Args:
        store: open for writing.
        row: in the node table.
        workers: threads; the tile does not depend on it.

    Returns:
        The tile's hash and bytes.

    Raises:
        UsageError: there is no such node.
    """
    forest = _forest(store)
    if not 0 <= row < len(forest.nodes):
        raise UsageError(f"node {row}: the tree has {len(forest.nodes)}")
    built = build_nodes(
        forest.needs(np.array([row])),
        forest.placements,
        codec_of(store),
        lambda keys: mesh_surfaces(store, keys, forest.demand, workers),
    )
    name, data = built.tiles[0]
    store.put_tiles([(name, data)])
    with _updating:
        record = built.records.copy()
        error = float(record["geometric_error"][0])
        record["geometric_error"] = store.get_nodes(row, 1)["geometric_error"]
        store.update_nodes(row, record)
        raise_ancestors(store, row, error)
    return name, data


def build_surface_lod(store: TypedStore, surface_id: int, level: int, workers: int = 1) -> tuple[np.void, bytes]:
    """Tessellate one surface at 2**level mm in its own space, store it as a level of detail.

    A direct surface's coarsest level is half its node's error, each next one half of that; which level a
    view needs is the client's to say.

    Returns:
        The ``LOD_DTYPE`` record and the tile's bytes.

    Raises:
        MissingRecordError: there is no such surface.
        UsageError: the level is outside ``FINEST_LOD`` to ``COARSEST_LOD``, or beyond float64 for this surface.
    """
    if not FINEST_LOD <= level <= COARSEST_LOD:
        raise UsageError(f"level {level}: want {FINEST_LOD} to {COARSEST_LOD}")
    part, row = store.locate_surface(surface_id)
    chord_error = 2.0**level * (1.0 - tunables.SHARES.quantisation)
    mesh = tessellate(store.get_part(part), chord_error, faces=np.array([row]), workers=workers)
    content = TileContent(
        mesh.positions,
        mesh.normals.astype(np.float32),
        mesh.triangles.astype(np.uint32),
        mesh.segments.astype(np.uint32),
        np.arange(0 if len(mesh.triangles) else len(mesh.positions), dtype=np.uint32),
        Ledger(float(mesh.surface_error[0]), float(mesh.trim_error[0]), float(mesh.pcurve_error[0])),
    )
    data = encoded(content, level, codec_of(store))
    record = np.zeros(1, LOD_DTYPE)
    record["level"], record["geometric_error"] = level, tile_ledger(data).total
    record["tile_hash"], record["tile_bytes"] = tile_hash(data).encode(), len(data)
    record["n_triangles"] = tile_counts(data)[1]
    store.put_tiles([(tile_hash(data), data)])
    store.put_lods(surface_id, record)
    return record[0], data
