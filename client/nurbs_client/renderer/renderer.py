"""Draws tiles: all of a frame's triangles, lines and points in one indirect call each.

The tiles' vertices and indices lie in two arenas. What differs per draw (transform to view space,
colour, point size) is an instanced attribute, found through the command's base instance, so the
number of tiles costs a few numpy operations instead of calls into the driver.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from nurbs_client.camera import Camera
from nurbs_client.renderer import shaders
from nurbs_client.renderer.arena import BufferArena
from nurbs_client.renderer.context import Context
from nurbs_client.renderer.frame_target import FrameTarget
from nurbs_client.tile_mesh import VERTEX_DTYPE, TileMesh

COMMAND_DTYPE = np.dtype([(name, "<u4") for name in ("count", "instances", "first_index", "base_vertex", "draw")])
DRAW_DTYPE = np.dtype([("rows", "<f4", (3, 4)), ("colour", "<f4", (3,)), ("size", "<f4")])
DRAW_FORMAT, DRAW_ATTRIBUTES = "4f4 4f4 4f4 4f4/i", ("row_x", "row_y", "row_z", "colour_size")

TRIANGLES, LINES, POINTS = 0, 1, 2
MODES = (moderngl.TRIANGLES, moderngl.LINES, moderngl.POINTS)
INDICES_PER_PRIMITIVE = (3, 2, 1)

BACKGROUND_BOTTOM, BACKGROUND_TOP = (0.835, 0.850, 0.870), (0.975, 0.978, 0.982)  # sRGB
MAX_THICKNESS_PX = 16.0  # a missing child is no reason to paint the image over
LINE_PUSH_PX = 1.5  # lines lie this many pixels behind: they fill gaps and never cover a surface


@dataclass
class Counters:
    """What was done since the start; differences between frames are what a frame did."""

    frames: int = 0
    draws: int = 0
    triangles: int = 0
    lines: int = 0
    points: int = 0
    draw_calls: int = 0
    uploads: int = 0
    upload_bytes: int = 0
    programs: int = 0

    def reset(self) -> None:
        """Start again at 0; compiled programs stay counted, since they stay compiled."""
        programs = self.programs
        for name in asdict(self):
            setattr(self, name, 0)
        self.programs = programs

    def as_dict(self) -> dict[str, int]:
        """By name."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class DrawList:
    """What a frame draws.

    Attributes:
        slots: (n,) int64, of ``Renderer.upload``.
        transforms: (n, 3, 4) from each tile's space to the assembly, mm.
        colours: (n, 3) linear 0 to 1.
        thickness_px: (n,) size of points and lines, pixels, at least 1.
    """

    slots: npt.NDArray[np.int64]
    transforms: npt.NDArray[np.float64]
    colours: npt.NDArray[np.float32]
    thickness_px: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.slots)


SLOT_DTYPE = np.dtype(
    [
        ("origin", "f8", (3,)),
        ("first_vertex", "i8"),
        ("n_vertices", "i8"),
        ("first_index", "i8"),  # triangles, lines, points in this order
        ("n_indices", "i8", (3,)),
    ]
)


class Renderer:
    """Holds tiles in graphics memory and draws lists of them."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._gl = context.gl
        self.counters = Counters()
        self._vertices = BufferArena(self._gl, VERTEX_DTYPE.itemsize)
        self._indices = BufferArena(self._gl, 4)
        self._slots = np.zeros(64, SLOT_DTYPE)
        self._free = list(range(63, -1, -1))
        self._draws = self._gl.buffer(reserve=DRAW_DTYPE.itemsize * 64, dynamic=True)
        self._commands = self._gl.buffer(reserve=COMMAND_DTYPE.itemsize * 64, dynamic=True)
        self._draws_generation = 0
        self._programs: dict[str, moderngl.Program] = {}
        self._arrays: dict[str, tuple[tuple[int, int, int], moderngl.VertexArray]] = {}

    def upload(self, mesh: TileMesh) -> int:
        """Take a tile into graphics memory; returns its slot."""
        if not self._free:
            n = len(self._slots)
            self._slots = np.concatenate([self._slots, np.zeros(n, SLOT_DTYPE)])
            self._free = list(range(2 * n - 1, n - 1, -1))
        slot = self._free.pop()
        indices = np.concatenate([mesh.triangles.ravel(), mesh.lines.ravel(), mesh.points])
        record = self._slots[slot]
        record["origin"] = mesh.origin
        record["n_vertices"] = len(mesh.vertices)
        record["first_vertex"] = self._vertices.put(mesh.vertices.tobytes(), len(mesh.vertices))
        record["n_indices"] = mesh.triangles.size, mesh.lines.size, mesh.points.size
        record["first_index"] = self._indices.put(indices.tobytes(), len(indices))
        self.counters.uploads += 1
        self.counters.upload_bytes += mesh.n_bytes
        return slot

    def drop(self, slot: int) -> None:
        """Give a tile's memory back."""
        record = self._slots[slot]
        self._vertices.drop(int(record["first_vertex"]), int(record["n_vertices"]))
        self._indices.drop(int(record["first_index"]), int(record["n_indices"].sum()))
        self._slots[slot] = 0
        self._free.append(slot)

    def draw(self, camera: Camera, target: FrameTarget, draws: DrawList) -> None:
        """Draw a frame into ``target``; read it with ``target.read``."""
        target.begin()
        self._background()
        if len(draws):
            order = self._write_draws(camera, target, draws)
            self._gl.enable_only(moderngl.DEPTH_TEST | moderngl.PROGRAM_POINT_SIZE)
            self._draw_kind(TRIANGLES, camera, target, draws, order)
            self._draw_kind(POINTS, camera, target, draws, order)
            self._draw_kind(LINES, camera, target, draws, order)
        self.counters.frames += 1
        self.counters.draws += len(draws)
        self._context.check("drawing a frame")

    def _write_draws(self, camera: Camera, target: FrameTarget, draws: DrawList) -> npt.NDArray[np.int64]:
        """Send transforms and colours, rounded after the eye has been subtracted; nearest tiles first."""
        origins = self._slots["origin"][draws.slots]
        linear = draws.transforms[:, :, :3]
        offsets = np.einsum("nij,nj->ni", linear, origins) + draws.transforms[:, :, 3] - camera.eye
        data = np.zeros(len(draws), DRAW_DTYPE)
        data["rows"][:, :, :3] = camera.rotation @ linear
        data["rows"][:, :, 3] = offsets @ camera.rotation.T
        data["colour"] = draws.colours
        data["size"] = np.clip(draws.thickness_px, 1.0, MAX_THICKNESS_PX) * target.factor
        self._draws = self._filled(self._draws, data)
        return np.argsort(data["rows"][:, 2, 3], kind="stable")

    def _draw_kind(
        self, kind: int, camera: Camera, target: FrameTarget, draws: DrawList, order: npt.NDArray[np.int64]
    ) -> None:
        """One indirect call; for lines one per width, since that is no attribute."""
        counts = self._slots["n_indices"][draws.slots[order], kind]
        order = order[counts > 0]
        if len(order) == 0:
            return
        widths = np.ceil(np.clip(draws.thickness_px[order], 1.0, MAX_THICKNESS_PX)) if kind == LINES else None
        if widths is not None:
            by_width = np.argsort(widths, kind="stable")
            order, widths = order[by_width], widths[by_width]
        self._commands = self._filled(self._commands, self._commands_for(kind, draws, order))
        array, program = self._array("triangles" if kind == TRIANGLES else "thin")
        f = camera.focal_px
        program["projection"] = (2.0 * f / camera.width, 2.0 * f / camera.height, camera.near)
        program["push_back"] = LINE_PUSH_PX / f if kind == LINES else 0.0
        if kind != TRIANGLES:
            program["round_points"] = kind == POINTS
        for first, count, width in _runs(widths, len(order)):
            if kind == LINES:
                self._gl.line_width = width * target.factor
            array.render_indirect(self._commands, MODES[kind], count, first=first)
            self.counters.draw_calls += 1

    def _commands_for(self, kind: int, draws: DrawList, order: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
        records = self._slots[draws.slots[order]]
        commands = np.zeros(len(order), COMMAND_DTYPE)
        commands["count"] = records["n_indices"][:, kind]
        commands["instances"] = 1
        commands["first_index"] = records["first_index"] + records["n_indices"][:, :kind].sum(axis=1)
        commands["base_vertex"] = records["first_vertex"]
        commands["draw"] = order
        n = int(commands["count"].sum(dtype=np.int64)) // INDICES_PER_PRIMITIVE[kind]
        name = ("triangles", "lines", "points")[kind]
        setattr(self.counters, name, getattr(self.counters, name) + n)
        return commands

    def _filled(self, buffer: moderngl.Buffer, data: npt.NDArray[np.void]) -> moderngl.Buffer:
        """``buffer``, or a larger one, with ``data`` at its start."""
        if buffer.size < data.nbytes:
            buffer.release()
            buffer = self._gl.buffer(reserve=2 * data.nbytes, dynamic=True)
            self._draws_generation += 1
        buffer.write(data.tobytes())
        return buffer

    def _program(self, name: str) -> moderngl.Program:
        """Compiled when first drawn with, not before."""
        if name not in self._programs:
            sources = {
                "triangles": (shaders.VERTEX, shaders.TRIANGLE_FRAGMENT),
                "thin": (shaders.VERTEX, shaders.THIN_FRAGMENT),
                "background": (shaders.BACKGROUND_VERTEX, shaders.BACKGROUND_FRAGMENT),
            }[name]
            self._programs[name] = self._gl.program(vertex_shader=sources[0], fragment_shader=sources[1])
            self.counters.programs += 1
        return self._programs[name]

    def _array(self, name: str) -> tuple[moderngl.VertexArray, moderngl.Program]:
        """The program's vertex array, bound again after one of its buffers has been replaced."""
        program = self._program(name)
        key = (self._vertices.generation, self._indices.generation, self._draws_generation)
        cached = self._arrays.get(name)
        if cached is None or cached[0] != key:
            if cached is not None:
                cached[1].release()
            content = [
                (self._vertices.buffer, "3f4 2i2", "position", "normal"),
                (self._draws, DRAW_FORMAT, *DRAW_ATTRIBUTES),
            ]
            array = self._gl.vertex_array(program, content, index_buffer=self._indices.buffer, index_element_size=4)
            self._arrays[name] = (key, array)
        return self._arrays[name][1], program

    def _background(self) -> None:
        if "background" not in self._arrays:
            program = self._program("background")
            program["bottom"], program["top"] = BACKGROUND_BOTTOM, BACKGROUND_TOP
            self._arrays["background"] = ((0, 0, 0), self._gl.vertex_array(program, []))
        self._gl.enable_only(moderngl.NOTHING)
        self._arrays["background"][1].render(moderngl.TRIANGLES, vertices=3)


def _runs(widths: npt.NDArray[np.float64] | None, n: int) -> list[tuple[int, int, float]]:
    """(first, count, width) of each run of equal widths."""
    if widths is None:
        return [(0, n, 1.0)]
    starts = np.flatnonzero(np.diff(widths, prepend=-1.0))
    ends = np.append(starts[1:], n)
    return [(int(a), int(b - a), float(widths[a])) for a, b in zip(starts, ends, strict=True)]
