"""Flies a camera along a path and writes what it sees: a PNG and a CSV row per frame, and a report.

Two ways to fly. *Waiting*, each frame is drawn when everything that shows is there: stills at full
quality. *Streaming*, frames follow one another and each shows what has arrived: that is what a person
at an interactive viewer would see, and what frame rates are measured with.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from nurbs_client.camera import Camera
from nurbs_client.contact_sheet import write_contact_sheet
from nurbs_client.frame_rate import FrameRateControl
from nurbs_client.path import NEAR_PER_DIAGONAL, CameraPath
from nurbs_client.renderer.context import Context, create_context
from nurbs_client.renderer.frame_target import FrameTarget
from nurbs_client.renderer.renderer import Renderer
from nurbs_client.report import FrameRow, summary, write_csv
from nurbs_client.transport import Transport
from nurbs_client.viewer import Drawn, Viewer, open_scene

PNG_LEVEL = 4  # of zlib: a third smaller than 1 at the same wall time, since it runs beside the next frame
MAX_PENDING_PNGS = 4  # uncompressed images kept in memory at most


@dataclass(frozen=True)
class FlightSettings:
    """How to fly.

    Attributes:
        size: width and height of the frames, pixels.
        error_px: allowed error on screen, pixels.
        target_fps: frames per second to hold by raising the error; None: the error is held.
        samples: per pixel.
        wait: draw each frame only when it is complete.
        memory_bytes: graphics memory for tiles.
    """

    size: tuple[int, int] = (1280, 720)
    error_px: float = 0.5
    target_fps: float | None = None
    samples: int = 4
    wait: bool = True
    memory_bytes: int = 1 << 30


@dataclass(eq=False)
class Flight:
    """One flight, from the first frame to the report.

    Attributes:
        output: folder for ``frame_NNNNN.png``, ``frames.csv`` and ``contact_sheet.png``.
        on_frame: called after each frame.
    """

    transport: Transport
    output: Path
    settings: FlightSettings = field(default_factory=FlightSettings)
    on_frame: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        self._start = time.perf_counter()
        self.scene = open_scene(self.transport)
        self.seconds = {"open": time.perf_counter() - self._start}
        self.rows: list[FrameRow] = []
        self.frames: list[Path] = []
        self.full_quality_s: float | None = None

    def fly(self, path: CameraPath, times: npt.NDArray[np.float64], numbers: Sequence[int]) -> dict[str, Any]:
        """Draw the frames at ``times``, named by ``numbers``; returns the report."""
        self.output.mkdir(parents=True, exist_ok=True)
        context = create_context()
        try:
            renderer = Renderer(context)
            settings = self.settings
            viewer = Viewer(
                self.scene,
                self.transport,
                renderer,
                settings.error_px,
                settings.memory_bytes,
                hysteresis=not settings.wait,
            )
            try:
                self._fly(context, viewer, path, times, numbers)
            finally:
                viewer.close()
            return self._report(context, viewer)
        finally:
            context.release()

    def _fly(
        self,
        context: Context,
        viewer: Viewer,
        path: CameraPath,
        times: npt.NDArray[np.float64],
        numbers: Sequence[int],
    ) -> None:
        target = FrameTarget(context, self.settings.size, self.settings.samples)
        fps = self.settings.target_fps
        control = FrameRateControl(fps, self.settings.error_px) if fps else None
        near = max(self.scene.diagonal * NEAR_PER_DIAGONAL, 1e-9)
        viewer.rehearse(path.camera(float(times[0]), self.settings.size, near), target)
        self.seconds["prepare"] = time.perf_counter() - self._start - self.seconds["open"]
        viewer.load_roots()
        self.seconds["roots"] = time.perf_counter() - self._start - sum(self.seconds.values())
        pending: list[Future[None]] = []
        with ThreadPoolExecutor(1, thread_name_prefix="png") as writer:
            for at, number in zip(times.tolist(), numbers, strict=True):
                image = self._frame(viewer, target, path.camera(at, self.settings.size, near), number, at)
                file = self.output / f"frame_{number:05d}.png"
                self.frames.append(file)
                pending.append(writer.submit(_write_png, image, file))
                if len(pending) > MAX_PENDING_PNGS:
                    pending.pop(0).result()
                if control:
                    viewer.ask_for(control.update(self.rows[-1].frame_ms / 1e3))
                self.on_frame()
            for future in pending:
                future.result()
        target.release()

    def _frame(
        self, viewer: Viewer, target: FrameTarget, camera: Camera, number: int, at: float
    ) -> npt.NDArray[np.uint8]:
        """Select, draw and read back one frame, and note how it went."""
        before = viewer.renderer.counters.as_dict()
        start = time.perf_counter()
        wait_s = viewer.settle(camera) if self.settings.wait else 0.0
        settled = self.settings.wait or viewer.step(camera)
        start += wait_s
        selected = time.perf_counter()
        drawn = viewer.draw(camera, target)
        image = target.read()
        end = time.perf_counter()
        if settled and self.full_quality_s is None:
            self.full_quality_s = end - self._start
        after = viewer.renderer.counters.as_dict()
        made = {name: after[name] - before[name] for name in after}
        self.rows.append(self._row(viewer, number, at, drawn, made, (start, selected, end), wait_s))
        return image

    def _row(
        self,
        viewer: Viewer,
        number: int,
        at: float,
        drawn: Drawn,
        made: dict[str, int],
        clock: tuple[float, float, float],
        wait_s: float,
    ) -> FrameRow:
        chosen = viewer.selection
        if chosen is None:
            raise RuntimeError("a row comes after a step")
        start, selected, end = clock
        errors = np.minimum(drawn.screen_error_px, math.hypot(*self.settings.size))
        return FrameRow(
            frame=number,
            time_s=at,
            frame_ms=(end - start) * 1e3,
            select_ms=(selected - start) * 1e3,
            draw_ms=(end - selected) * 1e3,
            wait_ms=wait_s * 1e3,
            error_target_px=viewer.effective_px,
            screen_error_px_mean=float(errors.mean()) if len(errors) else 0.0,
            screen_error_px_max=float(errors.max()) if len(errors) else 0.0,
            complete=chosen.is_complete,
            nodes_drawn=len(chosen.nodes),
            surfaces_drawn=len(chosen.items),
            substitutes=drawn.n_substitutes,
            holes=drawn.n_holes,
            culled_frustum=chosen.n_culled,
            culled_occlusion=0,
            triangles=made["triangles"],
            lines=made["lines"],
            points=made["points"],
            bytes_streamed=self.transport.bytes_received,
            resident_bytes=viewer.table.used_bytes,
        )

    def _report(self, context: Context, viewer: Viewer) -> dict[str, Any]:
        """Write the rows and the contact sheet; returns the figures."""
        write_csv(self.rows, self.output / "frames.csv")
        write_contact_sheet(self.frames, self.output / "contact_sheet.png")
        self.seconds["total"] = time.perf_counter() - self._start
        return {
            "gl_renderer": context.renderer,
            "size": list(self.settings.size),
            "samples": self.settings.samples,
            "mode": "wait" if self.settings.wait else "stream",
            "error_px": self.settings.error_px,
            **summary(self.rows),
            "seconds_to_full_quality": self.full_quality_s,
            "effects": {},
            "memory_budget_bytes": self.settings.memory_bytes,
            "error_target_raised_by_memory": viewer.governor.was_raised,
            "evicted_tiles": viewer.table.n_evicted,
            "failed_tiles": [
                {"node": key.node, "surface": key.surface, "level": key.level, "reason": reason}
                for key, reason in viewer.failures.items()
            ],
            "counters": viewer.renderer.counters.as_dict(),
            "seconds": self.seconds,
        }


def _write_png(image: npt.NDArray[np.uint8], path: Path) -> None:
    Image.fromarray(image).save(path, compress_level=PNG_LEVEL)
