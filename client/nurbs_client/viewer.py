"""Shows a scene from one camera after the other: select, request, collect, draw.

All of the client's parts meet here, on the render thread. ``step`` does one round without waiting;
``settle`` repeats it until everything that shows is there at the target.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_client.camera import Camera
from nurbs_client.loader import Loader
from nurbs_client.own_distance import own_mm_per_px
from nurbs_client.prefetch import MAX_BIN, Request, prefetch_requests, visible_requests, wanted_keys
from nurbs_client.renderer.frame_target import FrameTarget
from nurbs_client.renderer.renderer import DrawList, Renderer
from nurbs_client.residency import BudgetGovernor, ResidencyTable, TileKey, TileState, drawn_lods, nearby_tiles
from nurbs_client.scene import Scene, make_scene
from nurbs_client.screen_error import screen_error_px
from nurbs_client.selection import MAX_LEVEL, MIN_LEVEL, Selection, select
from nurbs_client.tile_mesh import make_mesh
from nurbs_client.tile_source import TileSource
from nurbs_client.transport import Transport, materials_of

UPLOAD_BYTES_PER_STEP = 24 << 20  # an upload of more than this is felt as a stutter
TYPICAL_TILE_BYTES = 64 << 10  # until the first tiles have come: about 3,000 triangles
BYTES_PER_TRIANGLE = 22  # 12 of indices and 0.6 vertices of 16 bytes
FINER_PER_LOAD = 3  # levels that a surface near the eye may gain at once: its distance is known only roughly
MAX_PREFETCH = 64  # tiles in the queue that nothing shows yet
MAX_RAISES = 60  # of the error target per frame; 1.25**60 is beyond any picture


_CORNERS = np.arange(3, dtype=np.uint32)
REHEARSAL_MESH = make_mesh(  # one of each primitive
    np.zeros(3), np.eye(3, dtype=np.float32), np.eye(3, dtype=np.float32), _CORNERS, _CORNERS[:2], _CORNERS[:1], 0.0
)


class Drawn(NamedTuple):
    """How good the picture is that a selection gives."""

    screen_error_px: npt.NDArray[np.float64]  # of each tile that is drawn or missing; may be inf
    n_holes: int
    n_substitutes: int


@dataclass(eq=False)
class Viewer:
    """A scene, what of it is in graphics memory, and the threads that bring the rest.

    Attributes:
        target_px: error on screen that is asked for, pixels.
        hysteresis: coarsen later than refine, for pictures that do not pop; off, a picture depends on its view alone.
        failures: tiles that could not be had, with the reason.
    """

    scene: Scene
    transport: Transport
    renderer: Renderer
    target_px: float
    budget_bytes: int
    hysteresis: bool = True
    failures: dict[TileKey, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.table = ResidencyTable(self.scene, self.budget_bytes, self.renderer.drop)
        self.governor = BudgetGovernor(self.target_px, self.budget_bytes)
        self.loader = Loader(TileSource(self.scene, self.transport).fetch, self.transport.n_threads)
        self.frame = 0
        self.selection: Selection | None = None
        self._near_items = np.zeros(0, np.int32)
        self._measured: dict[tuple[int, TileKey], float] = {}
        self._measured_from: Camera | None = None
        self._built = self.scene.nodes["tile_hash"] != b""

    def close(self) -> None:
        """End the loader's threads."""
        self.loader.close()

    def ask_for(self, target_px: float) -> None:
        """Change the error target; what the memory's budget demands still counts."""
        raised = self.governor.effective_px / self.governor.target_px
        self.governor.target_px = target_px
        self.governor.effective_px = target_px * raised

    @property
    def effective_px(self) -> float:
        """The error target in use, pixels: more than asked for while the memory is too small."""
        return self.governor.effective_px

    def load_roots(self) -> None:
        """Wait for the roots' tiles: from then on there is always something to draw."""
        keys = [TileKey.of_node(row) for row in self.scene.roots.tolist()]
        self._queue([Request(MAX_BIN, key) for key in keys if self.table.want(key)])
        while any(self.table.state(key) == TileState.WANTED for key in keys):
            self.loader.wait(0.25)
            self._collect()

    def step(self, camera: Camera) -> bool:
        """One round; True if the selection is as good as it will get with nothing more under way."""
        self.frame += 1
        self._collect()
        chosen = self._select(camera)
        self._request(camera, chosen)
        roots = {TileKey.of_node(row) for row in self.scene.roots.tolist()}
        self.table.keep(nearby_tiles(self.scene, chosen) | roots, self.frame - 0.5)
        self.table.keep(self._drawn_keys(chosen), self.frame)
        self.table.shrink(self.frame)
        self.selection = chosen
        return self._is_settled(chosen)

    def settle(self, camera: Camera) -> float:
        """Round after round until everything that shows is there; returns the seconds before the last round."""
        first = start = time.perf_counter()
        while not self.step(camera):
            self.loader.wait(0.25)
            start = time.perf_counter()
        return start - first

    def rehearse(self, camera: Camera, target: FrameTarget) -> None:
        """Compile kernels and shaders, so that no frame's time has it in; nothing is loaded or kept."""
        select(self.scene, camera.view, self.effective_px, self.table.snapshot)
        prefetch_requests(self.scene, camera.view, self.effective_px, self.table, np.zeros_like(self._built), 0)
        slot = self.renderer.upload(REHEARSAL_MESH)
        draws = DrawList(np.array([slot]), np.eye(3, 4)[None], np.zeros((1, 3), np.float32), np.ones(1))
        self.renderer.draw(camera, target, draws)
        target.read()
        self.renderer.drop(slot)
        self.renderer.counters.reset()

    def draw(self, camera: Camera, target: FrameTarget) -> Drawn:
        """Draw what the last round has selected."""
        chosen = self.selection
        if chosen is None:
            raise RuntimeError("draw comes after step")
        node_px = screen_error_px(chosen.node_mm_per_px, self.table.node_error[chosen.nodes], camera.focal_px)
        lods = [entry for _, entry in drawn_lods(self.scene, chosen, self.table)]
        errors = np.array([lod.error for lod in lods]) * self.scene.item_arrays.scale[chosen.items]
        item_px = screen_error_px(chosen.item_mm_per_px, errors, camera.focal_px)
        slots = np.concatenate([self.table.node_slot[chosen.nodes], np.array([lod.slot for lod in lods], np.int64)])
        self.renderer.draw(camera, target, self._draw_list(chosen, slots, np.concatenate([node_px, item_px])))
        return Drawn(np.concatenate([node_px, item_px, chosen.hole_px]), chosen.n_holes, chosen.n_substitutes)

    def _collect(self) -> None:
        """Take what the loader has finished into graphics memory."""
        for loaded in self.loader.collect(UPLOAD_BYTES_PER_STEP):
            if self.table.state(loaded.key) == TileState.RESIDENT:
                continue
            if loaded.mesh is None:
                self.table.fail(loaded.key, str(loaded.error))
                self.failures[loaded.key] = str(loaded.error)
            else:
                self.table.arrive(loaded.key, self.renderer.upload(loaded.mesh), loaded.mesh)

    def _select(self, camera: Camera) -> Selection:
        """Select at the target, or at the finest one for which the memory suffices."""
        self._measure_near(camera)
        refined = self.selection.refined if self.selection and self.hysteresis else None
        for _ in range(MAX_RAISES):
            chosen = select(self.scene, camera.view, self.effective_px, self.table.snapshot, refined)
            if self._find_near(camera, chosen):
                chosen = select(self.scene, camera.view, self.effective_px, self.table.snapshot, refined)
            if not self.governor.update(self._needed_bytes(chosen)):
                break
        return chosen

    def _needed_bytes(self, chosen: Selection) -> int:
        """Graphics memory of what is drawn and of what would replace it."""
        drawn = sum(self.table.entries[key].n_bytes for key in self._drawn_keys(chosen))
        n_triangles = self.scene.nodes["n_triangles"][chosen.wanted_nodes].astype(np.int64)
        typical = self.table.used_bytes // max(self.table.n_resident, 1) or TYPICAL_TILE_BYTES
        nodes = np.where(n_triangles > 0, n_triangles * BYTES_PER_TRIANGLE, typical).sum()
        return int(drawn + nodes + typical * len(chosen.wanted_items))

    def _drawn_keys(self, chosen: Selection) -> set[TileKey]:
        lods = {key for key, _ in drawn_lods(self.scene, chosen, self.table)}
        return lods | {TileKey.of_node(row) for row in chosen.nodes.tolist()}

    def _request(self, camera: Camera, chosen: Selection) -> None:
        """Ask for what is missing, then for what may soon be."""
        requests = visible_requests(self.scene, chosen, self.table, self._limited_levels(chosen))
        if len(requests) < MAX_PREFETCH and self.table.has_room:
            more = prefetch_requests(self.scene, camera.view, self.effective_px, self.table, self._built, MAX_PREFETCH)
            asked = {request.key for request in requests}
            requests += [request for request in more if request.key not in asked]
        self._queue(requests)

    def _queue(self, requests: list[Request]) -> None:
        for key in self.loader.replace(requests):
            self.table.forget(key)

    def _is_settled(self, chosen: Selection) -> bool:
        if chosen.is_complete:
            return True
        keys = wanted_keys(self.scene, chosen, self._limited_levels(chosen))
        return all(self.table.state(key) in (TileState.FAILED, TileState.RESIDENT) for key in keys)

    def _find_near(self, camera: Camera, chosen: Selection) -> bool:
        """Find the direct surfaces whose boxes reach the eye, and measure how near they come."""
        items = np.unique(np.concatenate([chosen.items, chosen.wanted_items]))
        self._near_items = items[self._box_is_near(camera, items)]
        return self._measure_near(camera)

    def _box_is_near(self, camera: Camera, items: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Whether the boxes come nearer to the eye than they are long."""
        arrays = self.scene.item_arrays
        low, high = arrays.aabb_min[items], arrays.aabb_max[items]
        gap = np.maximum(np.maximum(low - camera.eye, camera.eye - high), 0.0)
        near: npt.NDArray[np.bool_] = np.linalg.norm(gap, axis=1) < np.linalg.norm(high - low, axis=1)
        return near

    def _measure_near(self, camera: Camera) -> bool:
        """Update the near surfaces' own distances from their finest LODs; True if one has changed."""
        if camera is not self._measured_from:
            self._measured, self._measured_from = {}, camera
        own = self.table.own_mm_per_px
        before = own[self._near_items].copy()
        own[:] = 0.0
        for item in self._near_items.tolist():
            surface = int(self.scene.item_arrays.surface[item])
            level = self.table.finest_level(surface)
            if level is None:
                continue
            key = self.table.lod_entry(surface, level)[0]
            if (item, key) not in self._measured:
                self._measured[item, key] = self._distance_measure(camera, item, key)
            own[item] = self._measured[item, key]
        return bool((own[self._near_items] != before).any())

    def _distance_measure(self, camera: Camera, item: int, key: TileKey) -> float:
        """Millimetres per pixel of a placed surface, from one of its LODs."""
        mesh = self.table.entries[key].mesh
        if mesh is None:
            return 0.0
        transform = self.scene.transforms[self.scene.items["occurrence"][item]]
        error = mesh.error * float(self.scene.item_arrays.scale[item])
        return own_mm_per_px(camera.view, transform, mesh.origin, mesh.positions, mesh.triangles, error)

    def _limited_levels(self, chosen: Selection) -> npt.NDArray[np.int32]:
        """Wanted LOD levels, those of surfaces near the eye in steps: each LOD tells the distance better."""
        levels = chosen.wanted_levels.copy()
        near = np.flatnonzero(np.isin(chosen.wanted_items, self._near_items))
        for index in near.tolist():
            item = int(chosen.wanted_items[index])
            finest = self.table.finest_level(int(self.scene.item_arrays.surface[item]))
            scale = float(self.scene.item_arrays.scale[item])
            node_level = int(self.scene.node_arrays.level[self.scene.items["node"][item]])
            coarsest = math.floor(node_level - 1 - math.log2(scale))
            limit = coarsest if finest is None else finest - FINER_PER_LOAD
            levels[index] = min(max(levels[index], limit, MIN_LEVEL), MAX_LEVEL)
        return levels

    def _draw_list(
        self, chosen: Selection, slots: npt.NDArray[np.int64], error_px: npt.NDArray[np.float64]
    ) -> DrawList:
        """Transforms and colours; points and lines twice as thick as the error that shows."""
        nodes, held = self.scene.nodes, self.scene.items[chosen.items]
        fixed = np.broadcast_to(np.eye(3, 4), (len(chosen.nodes), 3, 4))
        materials = np.concatenate([nodes["material"][chosen.nodes], nodes["material"][held["node"]]])
        return DrawList(
            slots,
            np.concatenate([fixed, self.scene.transforms[held["occurrence"]]]),
            self.scene.colours[np.clip(materials, 0, len(self.scene.colours) - 1)],
            2.0 * error_px,
        )


def open_scene(transport: Transport) -> Scene:
    """Read everything but the tiles."""
    materials = materials_of(transport.scene())
    return make_scene(transport.nodes(), transport.items(), transport.occurrences(), materials)
