"""What a flight leaves behind besides its pictures: a row per frame, and the figures of the whole."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class FrameRow:
    """One frame, as drawn.

    Times are wall time in milliseconds. ``frame_ms`` is selecting, uploading, drawing and reading the
    image back, without ``wait_ms`` (for tiles) and without writing the PNG. The errors are of the tiles
    that were drawn, from their own ledgers, at the worst point of their boxes; what is missing counts
    with its size.
    """

    frame: int
    time_s: float
    frame_ms: float
    select_ms: float
    draw_ms: float
    wait_ms: float
    error_target_px: float
    screen_error_px_mean: float
    screen_error_px_max: float
    complete: bool
    nodes_drawn: int
    surfaces_drawn: int
    substitutes: int
    holes: int
    culled_frustum: int
    culled_occlusion: int
    triangles: int
    lines: int
    points: int
    bytes_streamed: int
    resident_bytes: int


def write_csv(rows: Sequence[FrameRow], path: Path) -> None:
    """One line per frame, with a header."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(FrameRow)])
        writer.writeheader()
        for row in rows:
            values = {name: f"{v:.4f}" if isinstance(v, float) else v for name, v in asdict(row).items()}
            writer.writerow({**values, "complete": int(row.complete)})


def frame_rates(rows: Sequence[FrameRow]) -> dict[str, float]:
    """Frames per second: mean over the flight's time, and of the slowest and the slowest hundredth of frames."""
    times = np.array([row.frame_ms for row in rows]) / 1e3
    return {
        "mean": float(len(times) / times.sum()),
        "min": float(1.0 / times.max()),
        "p1": float(1.0 / np.quantile(times, 0.99)),
    }


def summary(rows: Sequence[FrameRow]) -> dict[str, Any]:
    """The report's figures that follow from the frames; per-frame counts as means."""
    last = rows[-1]
    return {
        "frames": len(rows),
        "fps": frame_rates(rows),
        "frame_ms": {
            name: float(np.mean([getattr(row, f"{name}_ms") for row in rows])) for name in ("select", "draw", "wait")
        },
        "screen_error_px": {
            "mean": float(np.mean([row.screen_error_px_mean for row in rows])),
            "max": float(max(row.screen_error_px_max for row in rows)),
        },
        "error_target_px": {"last": last.error_target_px, "max": float(max(r.error_target_px for r in rows))},
        "complete_frames": sum(row.complete for row in rows),
        "nodes_drawn": _mean(rows, "nodes_drawn"),
        "surfaces_drawn": _mean(rows, "surfaces_drawn"),
        "nodes_culled": {"frustum": _mean(rows, "culled_frustum"), "occlusion": _mean(rows, "culled_occlusion")},
        "substitutes": _mean(rows, "substitutes"),
        "holes": _mean(rows, "holes"),
        "triangles": _mean(rows, "triangles"),
        "lines": _mean(rows, "lines"),
        "points": _mean(rows, "points"),
        "bytes_streamed": last.bytes_streamed,
        "resident_bytes": last.resident_bytes,
    }


def _mean(rows: Sequence[FrameRow], name: str) -> float:
    return round(float(np.mean([getattr(row, name) for row in rows])), 3)
