"""A synthetic scene of spheres with a real tree and real tiles, and a transport that serves it from memory."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.errors import CacheError, CorruptRecordError, MissingRecordError
from nurbs_cache.ledger import Ledger
from nurbs_cache.node_record import ITEM_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material
from nurbs_cache.tile import TileContent, encode_tile, tile_hash
from nurbs_client.scene import Scene, make_scene

RATIO = 64.0  # node box edge / node error: a node is refined when it covers more than some 32 pixels per pixel of error


def sphere(radius: float, error: float) -> tuple[npt.NDArray[np.float64], ...]:
    """Positions, normals, triangles of a sphere around the origin within ``error``, and its true error."""
    n = 3
    while _sphere_error(radius, n) > error and n < 256:
        n += 1
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, 2 * n + 1), indexing="ij")
    normals = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    row = np.arange(n)[:, None] * (2 * n + 1) + np.arange(2 * n)
    a, b, c, d = row, row + 1, row + 2 * n + 2, row + 2 * n + 1
    triangles = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, d, b), (b, d, c))])
    return radius * normals, normals, triangles, np.array(_sphere_error(radius, n))


def _sphere_error(radius: float, n: int) -> float:
    """R - sqrt(R^2 - rho^2), rho at most half the diagonal of the largest cell (pi/n by pi/n)."""
    rho = radius * 0.5 * math.sqrt(2.0) * math.pi / n
    return radius - math.sqrt(max(radius * radius - rho * rho, 0.0))


@dataclass(eq=False)
class World:
    """Spheres, their octree, and every tile that the tree names."""

    nodes: npt.NDArray[np.void]
    items: npt.NDArray[np.void]
    occurrences: npt.NDArray[np.void]
    materials: list[Material]
    radii: npt.NDArray[np.float64]  # per surface
    tiles: dict[str, bytes] = field(default_factory=dict)
    node_bytes: dict[int, bytes] = field(default_factory=dict)
    lods: dict[tuple[int, int], bytes] = field(default_factory=dict)

    def scene(self) -> Scene:
        return make_scene(self.nodes.copy(), self.items.copy(), self.occurrences.copy(), self.materials)

    def lod(self, surface: int, level: int) -> bytes:
        if (surface, level) not in self.lods:
            points, normals, triangles, error = sphere(float(self.radii[surface]), 0.5 * 2.0**level)
            self.lods[surface, level] = _encode(points, normals, triangles, float(error))
        return self.lods[surface, level]


def _encode(points: Any, normals: Any, triangles: Any, error: float, lines: Any = None, dots: Any = None) -> bytes:
    content = TileContent(
        positions=np.asarray(points, np.float64).reshape(-1, 3),
        normals=np.asarray(normals, np.float32).reshape(-1, 3),
        triangles=np.asarray(triangles, np.uint32).reshape(-1, 3),
        lines=np.zeros((0, 2), np.uint32) if lines is None else np.asarray(lines, np.uint32),
        points=np.zeros(0, np.uint32) if dots is None else np.asarray(dots, np.uint32),
        ledger=Ledger(surface=error),
    )
    return encode_tile(content)


def make_world(
    centres: npt.NDArray[np.float64], radii: npt.NDArray[np.float64], *, leaf: int = 2, with_tiles: bool = True
) -> World:
    """One sphere (surface of its own) per centre, in an octree whose leaves hold at most ``leaf`` directly."""
    order: list[int] = []
    rows: list[dict[str, Any]] = []
    queue: list[tuple[npt.NDArray[np.int64], int]] = [(np.arange(len(centres)), -1)]
    members: list[npt.NDArray[np.int64]] = []
    at = 0
    while at < len(queue):
        held, parent = queue[at]
        low, high = (centres - radii[:, None])[held].min(axis=0), (centres + radii[:, None])[held].max(axis=0)
        level = math.ceil(math.log2(float((high - low).max()) / RATIO))
        rows.append({"parent": parent, "aabb_min": low, "aabb_max": high, "level": level})
        members.append(held)
        if len(held) > leaf:
            middle = (low + high) / 2
            octant = ((centres[held] > middle) @ np.array([1, 2, 4])).astype(int)
            children = [held[octant == o] for o in range(8) if (octant == o).any()]
            if len(children) > 1:
                rows[-1]["first_child"], rows[-1]["n_children"] = len(queue), len(children)
                queue += [(child, at) for child in children]
        at += 1
    nodes = np.zeros(len(rows), NODE_DTYPE)
    nodes["first_child"] = 0
    for row, values in enumerate(rows):
        for name, value in values.items():
            nodes[name][row] = value
    _number_items(nodes, members, order, 0)
    items = np.zeros(len(order), ITEM_DTYPE)
    items["surface"] = np.array(order) + 1000
    items["occurrence"] = order
    items["aabb_min"], items["aabb_max"] = (centres - radii[:, None])[order], (centres + radii[:, None])[order]
    items["scale"] = 1.0
    for row in range(len(nodes)):
        first = nodes["first_item"][row]
        items["node"][first : first + nodes["n_direct"][row]] = row
    occurrences = np.zeros(len(centres), OCCURRENCE_DTYPE)
    occurrences["transform"][:, :, :3] = np.eye(3)
    occurrences["transform"][:, :, 3] = centres
    world = World(nodes, items, occurrences, [Material("red", (0.6, 0.1, 0.08, 1.0))], radii)
    _add_tiles(world, centres, members, with_tiles)
    return world


def _number_items(nodes: npt.NDArray[np.void], members: list[Any], order: list[int], row: int) -> None:
    """Items of a subtree consecutively, the node's own first."""
    nodes["first_item"][row] = len(order)
    nodes["n_items"][row] = len(members[row])
    if nodes["n_children"][row] == 0:
        nodes["n_direct"][row] = len(members[row])
        order.extend(members[row].tolist())
    for child in range(nodes["first_child"][row], nodes["first_child"][row] + nodes["n_children"][row]):
        _number_items(nodes, members, order, child)


def _add_tiles(world: World, centres: Any, members: list[Any], with_tiles: bool) -> None:
    nodes = world.nodes
    nodes["key"] = [f"0-{row}".encode() for row in range(len(nodes))]
    for row in range(len(nodes) - 1, -1, -1):
        budget = 2.0 ** int(nodes["level"][row])
        error = 0.0
        if with_tiles:
            parts = [sphere(float(world.radii[s]), 0.5 * budget) for s in members[row]]
            starts = np.cumsum([0, *(len(p[0]) for p in parts)])
            points = np.concatenate([p[0] + centres[s] for p, s in zip(parts, members[row], strict=True)])
            triangles = np.concatenate([p[2] + start for p, start in zip(parts, starts, strict=False)])
            error = max(float(p[3]) for p in parts)
            data = _encode(points, np.concatenate([p[1] for p in parts]), triangles, error)
            world.node_bytes[row] = data
            nodes["tile_hash"][row] = tile_hash(data).encode()
            world.tiles[tile_hash(data)] = data
            nodes["n_triangles"][row] = len(triangles)
        first, n = nodes["first_child"][row], nodes["n_children"][row]
        below = float(nodes["geometric_error"][first : first + n].max()) if n else 0.0
        nodes["geometric_error"][row] = max(budget, below)


@dataclass(eq=False)
class MemoryTransport:
    """Serves a world; can lose and break tiles, and counts what it gives."""

    world: World
    n_threads: int = 2
    bytes_received: int = 0
    missing: set[str] = field(default_factory=set)
    broken: set[str] = field(default_factory=set)
    gate: threading.Event | None = None  # tiles other than the roots' wait for it
    asked: list[str] = field(default_factory=list)

    def scene(self) -> dict[str, Any]:
        return {"materials": [{"name": m.name, "rgba": list(m.rgba)} for m in self.world.materials]}

    def nodes(self) -> npt.NDArray[np.void]:
        return self.world.nodes.copy()

    def items(self) -> npt.NDArray[np.void]:
        return self.world.items.copy()

    def occurrences(self) -> npt.NDArray[np.void]:
        return self.world.occurrences.copy()

    def tiles(self, names: list[str]) -> list[bytes | CacheError]:
        return [self._tile(name) for name in names]

    def _tile(self, name: str) -> bytes | CacheError:
        self.asked.append(name)
        if self.gate and name != self.world.nodes["tile_hash"][0].decode():
            self.gate.wait(30)
        if name in self.missing:
            return MissingRecordError(f"tile {name} is not there")
        data = self.world.tiles[name]
        if name in self.broken:
            return data[:-7]
        self.bytes_received += len(data)
        return data

    def node_tile(self, row: int) -> bytes:
        return self.world.node_bytes[row]

    def surface_lod(self, surface_id: int, level: int) -> bytes:
        if self.gate:
            self.gate.wait(30)
        if f"lod {surface_id}" in self.broken:
            raise CorruptRecordError(f"surface {surface_id}")
        data = self.world.lod(surface_id - 1000, level)
        self.bytes_received += len(data)
        return data

    def close(self) -> None:
        pass


@pytest.fixture(scope="session")
def world_of() -> Callable[..., World]:
    """``make_world``."""
    return make_world


@pytest.fixture(scope="session")
def transport_of() -> type[MemoryTransport]:
    """``MemoryTransport``."""
    return MemoryTransport


@pytest.fixture(scope="session")
def grid_world() -> World:
    """Sixty-four spheres of two sizes in a cube of 400 mm."""
    steps = np.linspace(-150, 150, 4)
    centres = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    radii = np.where(np.arange(64) % 3 == 0, 40.0, 22.0)
    return make_world(centres, radii)


@pytest.fixture(scope="session")
def sphere_arrays() -> Callable[[float, float], tuple[npt.NDArray[np.float64], ...]]:
    """``sphere``."""
    return sphere
