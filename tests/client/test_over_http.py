"""The client against the real server, over a socket."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nurbs_cache.node_record import LOD_DTYPE
from nurbs_cache.scene_record import PartInfo
from nurbs_cache.store import Store
from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    GeometryBatch,
)
from nurbs_cache.tile import decode_tile, tile_hash
from nurbs_client.flight import Flight, FlightSettings
from nurbs_client.path import CameraPath, chosen_frames
from nurbs_client.transport import CacheTransport, HttpTransport
from nurbs_server.on_demand import Builders
from nurbs_server.serve import serve_in_thread

PATH = CameraPath.model_validate(
    {
        "keyframes": [
            {"eye": [1500, 900, 700], "target": [0, 0, 0], "fov": 40},
            {"eye": [300, 200, 180], "target": [150, 150, 150]},
        ],
        "frames": 3,
    }
)


@pytest.fixture
def world(world_of: Any) -> Any:
    steps = np.array([-60.0, 60.0])
    centres = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    made = world_of(np.concatenate([centres, centres * 0.4 + 200.0]), np.tile([40.0, 22.0], 8))
    made.nodes["tile_hash"][-2:] = b""  # to be built on demand
    return made


@pytest.fixture
def stored(tmp_path: Path, world: Any) -> Path:
    folder = tmp_path / "cache"
    with Store.create(folder, provenance={}) as store:
        store.put_parts([(0, PartInfo("spheres", len(world.items), 1000), surfaces(len(world.items)))])
        store.put_scene([], world.materials, world.occurrences, {})
        store.put_tree(world.nodes, world.items, {})
        store.put_tiles(sorted((name, world.tiles[name]) for name in names_of(world)))
    return folder


def surfaces(n: int) -> GeometryBatch:
    """So many surfaces, with nothing that the test's builders would read."""
    loops, coedges, edges, curves = (
        np.zeros(0, dtype) for dtype in (LOOP_DTYPE, COEDGE_DTYPE, EDGE_DTYPE, CURVE_DTYPE)
    )
    return GeometryBatch(np.zeros(n, SURFACE_DTYPE), loops, coedges, edges, curves, np.zeros((0, 3)), np.zeros(0))


def names_of(world: Any) -> list[str]:
    return [name.decode() for name in world.nodes["tile_hash"] if name]


def builders_of(world: Any) -> Builders:
    def node(store: Any, row: int) -> tuple[str, bytes]:
        data = world.node_bytes[row]
        store.put_tiles([(tile_hash(data), data)])
        record = store.get_nodes(row, 1)
        record["tile_hash"] = tile_hash(data).encode()
        store.update_nodes(row, record)
        return tile_hash(data), data

    def lod(store: Any, surface: int, level: int) -> tuple[np.void, bytes]:
        data = world.lod(surface - 1000, level)
        record = np.zeros(1, LOD_DTYPE)
        record["level"], record["tile_hash"], record["tile_bytes"] = level, tile_hash(data).encode(), len(data)
        record["geometric_error"] = decode_tile(data).ledger.total
        store.put_tiles([(tile_hash(data), data)])
        return record[0], data

    return Builders(node=node, lod=lod)


def fly(transport: Any, folder: Path) -> dict[str, Any]:
    flight = Flight(transport, folder, FlightSettings(size=(160, 120), samples=1))
    try:
        return flight.fly(PATH, *chosen_frames(PATH, None))
    finally:
        transport.close()


def test_the_same_pictures_from_a_server_and_from_the_cache(tmp_path: Path, stored: Path, world: Any) -> None:
    builders = builders_of(world)
    with serve_in_thread(stored, builders=builders) as served:
        remote = fly(HttpTransport(served.url), tmp_path / "remote")
    local = fly(CacheTransport(stored, builders.node, builders.lod), tmp_path / "local")
    for report in (remote, local):
        assert report["failed_tiles"] == []
        assert report["complete_frames"] == 3
        assert report["screen_error_px"]["max"] <= 0.5
        assert report["bytes_streamed"] > 0
    for name in ("frame_00000.png", "frame_00001.png", "frame_00002.png"):
        with Image.open(tmp_path / "remote" / name) as a, Image.open(tmp_path / "local" / name) as b:
            assert (np.asarray(a) == np.asarray(b)).all()
