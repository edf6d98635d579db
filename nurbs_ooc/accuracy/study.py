"""All curves of a model and the files they are written to: JSON, CSV and a page of plots."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.accuracy.curves import CurvePoint, Effort, curve, diagonal
from nurbs_ooc.accuracy.encoded import QuantisationPoint, quantisation_curve
from nurbs_ooc.accuracy.number_types import NumberPoint, number_curve
from nurbs_ooc.accuracy.variants import VARIANTS
from nurbs_ooc.export.atomic_file import atomic_file
from nurbs_ooc.tessellation.tessellate import tessellate

QUANTISED_SHARE = 1e-4  # of the diagonal: the mesh whose bits are varied


def n_settings(peers: bool) -> int:
    """How many settings a study runs through, at most."""
    return sum(len(v.settings) for v in VARIANTS if peers or not v.peer)


def study(
    parts: Sequence[GeometryBatch], peers: bool, effort: Effort, on_setting: Callable[[], None]
) -> dict[str, Any]:
    """Measure everything.

    Args:
        parts: of the model, each once.
        peers: also Open CASCADE.
        effort: how much is spent.
        on_setting: called after each setting of each variant.

    Returns:
        ``diagonal_mm``, ``points``, ``left_out``, ``quantisation`` and ``numbers``, as for JSON.

    Raises:
        UsageError: there is nothing to measure.
    """
    parts = [part for part in parts if len(part)]
    size = diagonal(parts)
    if not size > 0.0:
        raise UsageError("no face of a size above 0 to measure")
    points: list[CurvePoint] = []
    left_out = []
    for variant in VARIANTS:
        if variant.peer and not peers:
            continue
        found = list(curve(parts, variant, size, effort, on_setting))
        points += found
        left_out += [
            {
                "variant": variant.name,
                "setting": setting,
                "reason": f"more than {effort.most_triangles} triangles expected",
            }
            for setting in variant.settings[len(found) :]
        ]
    meshes = [tessellate(part, QUANTISED_SHARE * size, workers=1) for part in parts]
    return {
        "diagonal_mm": size,
        "parts": len(parts),
        "faces": sum(map(len, parts)),
        "samples_per_face": effort.samples,
        "points": [p.as_json() for p in points],
        "left_out": left_out,
        "quantised_error_mm": QUANTISED_SHARE * size,
        "quantisation": [p.as_json() for p in quantisation_curve(meshes)],
        "numbers": [p.as_json() for p in number_curve(parts, effort.seed)],
    }


def write_tables(folder: Path, result: dict[str, Any]) -> list[Path]:
    """``accuracy.csv``, ``quantisation.csv`` and ``numbers.csv`` of a study."""
    written = []
    for name, key in (("accuracy", "points"), ("quantisation", "quantisation"), ("numbers", "numbers")):
        rows = result[key]
        path = folder / f"{name}.csv"
        with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, fieldnames=list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        written.append(path)
    return written


def draw(path: Path, title: str, result: dict[str, Any]) -> None:
    """The page of plots of a study, or of its JSON read back."""
    from nurbs_ooc.accuracy.plots import draw_page

    points = [CurvePoint(**p) for p in result["points"]]
    quantisation = [QuantisationPoint(**p) for p in result["quantisation"]]
    numbers = [NumberPoint(**p) for p in result["numbers"]]
    draw_page(path, title, result["diagonal_mm"], points, quantisation, numbers)
