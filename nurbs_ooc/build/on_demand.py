"""Tiles that are built when somebody first asks for them, and kept.

The bytes are those of the batch build. Callers make sure that one tile is not built twice at a time;
building it twice is a waste, not an error.
"""

from __future__ import annotations

from functools import partial

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
from nurbs_ooc.build.mesh_demand import Keys
from nurbs_ooc.build.node_tiles import BuiltNodes, build_nodes, encoded
from nurbs_ooc.build.open_forest import changing, open_forest
from nurbs_ooc.build.surface_meshes import mesh_surfaces
from nurbs_ooc.hlod.mesh_pool import MeshPool
from nurbs_ooc.tessellation.tessellate import tessellate

FINEST_LOD, COARSEST_LOD = -40, 40  # ladder levels that a client may ask for: 2**level mm


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
    while True:
        edits, forest = store.edit_count(), open_forest(store)
        if not 0 <= row < len(forest.nodes):
            raise UsageError(f"node {row}: the tree has {len(forest.nodes)}")
        built = build_nodes(
            forest.needs(np.array([row])),
            forest.placements,
            codec_of(store),
            partial(_meshes, store, forest, workers),
        )
        with changing(store, edits) as current:
            if current:
                _keep_node(store, row, built)
                return built.tiles[0]


def _meshes(store: TypedStore, forest: Forest, workers: int, keys: Keys) -> MeshPool:
    return mesh_surfaces(store, keys, forest.surface_demand, workers)


def _keep_node(store: TypedStore, row: int, built: BuiltNodes) -> None:
    """Store a node's tile, then the node that names it, then what follows for its ancestors."""
    store.put_tiles(built.tiles)
    record = built.records.copy()
    error = float(record["geometric_error"][0])
    record["geometric_error"] = store.get_nodes(row, 1)["geometric_error"]
    store.update_nodes(row, record)
    raise_ancestors(store, row, error)


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
    while True:
        edits = store.edit_count()
        data = _lod_tile(store, surface_id, level, workers)
        record = np.zeros(1, LOD_DTYPE)
        record["level"], record["geometric_error"] = level, tile_ledger(data).total
        record["tile_hash"], record["tile_bytes"] = tile_hash(data).encode(), len(data)
        record["n_triangles"] = tile_counts(data)[1]
        with changing(store, edits) as current:
            if current:
                store.put_tiles([(tile_hash(data), data)])
                store.put_lods(surface_id, record)
                return record[0], data


def _lod_tile(store: TypedStore, surface_id: int, level: int, workers: int) -> bytes:
    """The tile of a surface at a ladder level."""
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
    return encoded(content, level, codec_of(store))
