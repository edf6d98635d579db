"""Small assemblies made by hand, as surface stores, and quiet builds of them: what build tests start from."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from nurbs_cache.scene_record import DEFAULT_MATERIAL, OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_cache.store import Store
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build.pipeline import BuildOptions, build
from nurbs_ooc.cli.console import Stopwatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_plane, add_sphere

RED = Material("red", (1.0, 0.0, 0.0, 1.0))
IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def peg_board(n: int = 4) -> GeometryBatch:
    """A 40 mm board with n x n pegs, each a cylinder with a ball on top; the first row is tiny."""
    builder = BatchBuilder()
    add_plane(builder, 40.0, 40.0)
    for i in range(n):
        for j in range(n):
            radius = 1.0 if i else 0.02
            at = (40.0 * (i + 0.5) / n, 40.0 * (j + 0.5) / n, 0.0)
            add_cylinder(builder, radius, 4 * radius, at)
            add_sphere(builder, radius, (at[0], at[1], 5 * radius))
    return builder.build()


def ball() -> GeometryBatch:
    """One sphere of radius 3 mm."""
    builder = BatchBuilder(part=1)
    add_sphere(builder, 3.0)
    return builder.build()


def turned(angle: float, *shift: float, scale: float = 1.0, mirror: bool = False) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    linear = scale * np.array([[c, -s, 0], [s, c, 0], [0, 0, -1.0 if mirror else 1.0]])
    return np.concatenate([linear, np.array(shift)[:, None]], axis=1)


def write_scene(path: Path, n: int = 4) -> Path:
    """Boards and balls: two parts, seven placements (turned, scaled, mirrored), two materials."""
    placements = [
        (0, -1, turned(0.0, 0, 0, 0)),
        (0, -1, turned(0.7, 100, 0, 0)),
        (0, 1, turned(0.0, 0, 90, 10, mirror=True)),
        (1, -1, turned(0.0, 50, 50, 0)),
        (1, 1, turned(0.3, 50, 60, 3, scale=2.0)),
        (1, 1, turned(0.0, 51, 70, 3)),
        (1, 1, turned(0.0, 52, 70, 3, scale=0.25)),
    ]
    occurrences = np.zeros(len(placements), OCCURRENCE_DTYPE)
    for row, (part, material, transform) in zip(occurrences, placements, strict=True):
        row["part"], row["material"], row["transform"] = part, material, transform
    parts = [peg_board(n), ball()]
    infos = [PartInfo("board", len(parts[0]), 0), PartInfo("ball", len(parts[1]), len(parts[0]))]
    with Store.create(path) as store:
        store.put_parts((i, info, part) for i, (info, part) in enumerate(zip(infos, parts, strict=True)))
        store.put_scene([Product("scene", -1, IDENTITY)], [DEFAULT_MATERIAL, RED], occurrences, {"stored": "mm"})
    return path


class _Quiet:
    def advance(self, n: float = 1) -> None:
        pass

    def set_total(self, total: float) -> None:
        pass


def run_build(source: Path | list[Path], cache: Path, **options: Any) -> dict[str, float]:
    watch = Stopwatch()
    inputs = source if isinstance(source, list) else [source]
    build(inputs, cache, BuildOptions(**options), lambda *_: nullcontext(_Quiet()), watch)
    return watch.seconds


def hash_of(cache: Path) -> str:
    with Store.open(cache) as store:
        return store.content_hash()
