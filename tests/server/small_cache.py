"""A small cache with some tiles built and others missing, builders that count, and a client of an application."""

from __future__ import annotations

import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import numpy as np
from fastapi import FastAPI

from nurbs_cache.ledger import Ledger
from nurbs_cache.node_record import ITEM_DTYPE, LOD_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_cache.store import Store
from nurbs_cache.tile import TileContent, encode_tile, tile_hash
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_patch, add_plane, add_sphere
from nurbs_server.on_demand import Builders

IDENTITY = tuple(float(x) for x in np.eye(3, 4).ravel())


def tile_of(number: int, n_triangles: int = 200) -> bytes:
    """A tile whose shape depends on ``number``: a jagged strip."""
    n = n_triangles + 2
    rng = np.random.default_rng(number)
    positions = np.column_stack([np.arange(n) * 0.5, np.arange(n) % 2, rng.uniform(0, 1, n)])
    rows = np.arange(n_triangles, dtype=np.uint32)
    content = TileContent(
        positions=positions,
        normals=np.tile(np.array([0, 0, 1], np.float32), (n, 1)),
        triangles=np.column_stack([rows, rows + 1, rows + 2]),
        lines=np.array([[0, 1]], np.uint32),
        points=np.array([0], np.uint32),
        ledger=Ledger(surface=0.25),
    )
    return encode_tile(content)


def fill(store: Store) -> None:
    """Two parts of two surfaces, three occurrences, two roots; the tiles of node 0 and 3 are built."""
    parts = []
    for index, adders in enumerate(((add_plane, add_cylinder), (add_sphere, _patch))):
        builder = BatchBuilder(index)
        for add in adders:
            add(builder)
        parts.append((index, PartInfo(f"part {index}", 2, 2 * index), builder.build()))
    store.put_parts(parts)
    occurrences = np.zeros(3, OCCURRENCE_DTYPE)
    occurrences["part"], occurrences["material"] = [0, 1, 1], -1
    occurrences["transform"] = np.eye(3, 4)
    products = [Product("assembly", -1, IDENTITY), Product("bolt Ø5", 0, IDENTITY)]
    materials = [Material("steel", (0.5, 0.5, 0.5, 1.0)), Material("red", (1.0, 0.0, 0.0, 0.5))]
    store.put_scene(products, materials, occurrences, {"file": "inch"})
    store.put_tree(_nodes(store), _items(), {"edge_over_error": 300.0})


def _patch(builder: BatchBuilder) -> int:
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    return add_patch(builder, 3, 2, np.stack([u, v, u * v], axis=-1), weights=1.0 + u)


def _nodes(store: Store) -> np.ndarray[Any, Any]:
    nodes = np.zeros(4, NODE_DTYPE)
    nodes["key"] = [b"0", b"0-1", b"0-7", b"1"]
    nodes["parent"], nodes["n_children"] = [-1, 0, 0, -1], [2, 0, 0, 0]
    nodes["first_child"], nodes["material"] = [1, 3, 3, 4], [0, 0, 0, 1]
    nodes["first_item"], nodes["n_items"], nodes["n_direct"] = [0, 1, 3, 4], [4, 2, 1, 2], [1, 2, 1, 2]
    nodes["aabb_max"] = 10.0
    nodes["geometric_error"], nodes["level"] = [1.0, 0.5, 0.25, 1.0], [0, -1, -2, 0]
    for row in (0, 3):
        data = tile_of(row)
        nodes["tile_hash"][row], nodes["tile_bytes"][row] = tile_hash(data).encode(), len(data)
        store.put_tiles([(tile_hash(data), data)])
    return nodes


def _items() -> np.ndarray[Any, Any]:
    items = np.zeros(6, ITEM_DTYPE)
    items["surface"], items["occurrence"] = [0, 1, 0, 1, 2, 3], [0, 0, 0, 0, 1, 2]
    items["node"], items["scale"] = [0, 1, 1, 2, 3, 3], 1.0
    return items


@dataclass
class CountingBuilders:
    """Builders that make a tile from a number, slowly, and count what they were asked for."""

    seconds: float = 0.02
    nodes: list[int] = field(default_factory=list)
    lods: list[tuple[int, int]] = field(default_factory=list)
    threads: set[str] = field(default_factory=set)

    def build_node(self, store: TypedStore, row: int) -> tuple[str, bytes]:
        """As ``build_node_tile``."""
        self.nodes.append(row)
        self._work()
        data = tile_of(100 + row)
        record = store.get_nodes(row, 1)
        record["tile_hash"], record["tile_bytes"] = tile_hash(data).encode(), len(data)
        store.put_tiles([(tile_hash(data), data)])
        store.update_nodes([row], record)
        parent = int(record["parent"][0])
        if parent >= 0:  # a build may find a larger error, which no ancestor may be below
            above = store.get_nodes(parent, 1)
            above["geometric_error"] += 0.125
            store.update_nodes([parent], above)
        return tile_hash(data), data

    def build_lod(self, store: TypedStore, surface: int, level: int) -> tuple[np.void, bytes]:
        """As ``build_surface_lod``."""
        self.lods.append((surface, level))
        self._work()
        data = tile_of(1000 * surface + level + 50)
        record = np.zeros(1, LOD_DTYPE)
        record["level"], record["geometric_error"] = level, 0.7 * 2.0**level
        record["tile_hash"], record["tile_bytes"] = tile_hash(data).encode(), len(data)
        store.put_tiles([(tile_hash(data), data)])
        store.put_lods(surface, record)
        return record[0], data

    def _work(self) -> None:
        self.threads.add(threading.current_thread().name)
        time.sleep(self.seconds)

    @property
    def injected(self) -> Builders:
        """For ``create_app``."""
        return Builders(node=self.build_node, lod=self.build_lod)


@asynccontextmanager
async def client_of(app: FastAPI, **options: Any) -> AsyncIterator[httpx.AsyncClient]:
    """A client of an application in this event loop, with the application's lifespan around it."""
    async with app.router.lifespan_context(app):
        transport = httpx.ASGITransport(app, **options)
        async with httpx.AsyncClient(transport=transport, base_url="http://test") as client:
            yield client
    app.state.backend.close(wait=True)


Test = Callable[[httpx.AsyncClient], Coroutine[Any, Any, None]]
Serve = Callable[[Test], None]
