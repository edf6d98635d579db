#!/usr/bin/env python3
"""How long a face takes whose control points have moved: ``tessellate_deformed`` on patches of 20 x 20 points.

    scripts/bench_deform.py [--docs docs/tessellation.md]

Error 1e-4 of the diagonal, median of 30 warm calls in one thread, CPU milliseconds of the whole call.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from docs_section import replace_section

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face, add_polygon_trimmed, uniform_knots
from nurbs_ooc.tessellation.deform import tessellate_deformed

POINTS = 20
SIZE = 100.0  # mm
RELATIVE_ERROR = 1e-4
CALLS = 30

Array = npt.NDArray[np.float64]


def sheet(height: float) -> Array:
    """(20, 20, 3): a square with one wave of that height, mm, in each direction."""
    x, y = np.meshgrid(*[np.linspace(0.0, SIZE, POINTS)] * 2, indexing="ij")
    return np.stack([x, y, height * np.sin(2 * np.pi * x / SIZE) * np.cos(2 * np.pi * y / SIZE)], axis=2)


def pulled(net: Array) -> Array:
    """A quarter of the points, in the middle, lifted by up to 5 mm as a round hill."""
    out = net.copy()
    hill = np.sin(np.linspace(0.0, np.pi, POINTS // 2))
    out[POINTS // 4 : -POINTS // 4, POINTS // 4 : -POINTS // 4, 2] += 5.0 * np.outer(hill, hill)
    return out


def patch(net: Array, degree: int, weights: Array | None, trimmed: bool) -> GeometryBatch:
    """One face over 0..1 x 0..1; trimmed: a circle of 24 straight sides is left out."""
    knots = uniform_knots(POINTS, degree)
    form = SurfaceForm.nurbs(degree, degree, knots, knots, net, weights)
    builder = BatchBuilder()
    if trimmed:
        turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        hole = 0.5 + 0.2 * np.column_stack([np.cos(turn), -np.sin(turn)])
        add_polygon_trimmed(builder, form, [np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]), hole])
    else:
        add_face(builder, form)
    return builder.build()


def median_ms(geometry: GeometryBatch, net: Array, error: float) -> tuple[float, int, float]:
    """Median CPU milliseconds, triangles, certified error in mm."""
    mesh = tessellate_deformed(geometry, 0, net, error)
    times = []
    for _ in range(CALLS):
        start = time.process_time()
        tessellate_deformed(geometry, 0, net, error)
        times.append(time.process_time() - start)
    return 1e3 * statistics.median(times), len(mesh.triangles), float(mesh.certified_error.max())


@click.command()
@click.option("--docs", type=click.Path(path_type=Path), help="Page whose section 'deform' gets the table.")
def main(docs: Path | None) -> None:
    """Print the table, or put it into a page."""
    lines = ["| face | error mm | ms | triangles | certified mm |", "|---|--:|--:|--:|--:|"]
    wave = np.sin(np.linspace(0.0, np.pi, POINTS))
    weights = 1.0 + np.outer(wave, wave)
    for name, height, degree, w, trimmed in (
        ("cubic, 2 mm waves", 2.0, 3, None, False),
        ("cubic, 10 mm waves", 10.0, 3, None, False),
        ("cubic, 2 mm waves, trimmed by 24 sides", 2.0, 3, None, True),
        ("degree 5, 2 mm waves", 2.0, 5, None, False),
        ("cubic, 2 mm waves, weights 1 to 2", 2.0, 3, weights, False),
    ):
        net = sheet(height)
        error = RELATIVE_ERROR * float(np.linalg.norm(np.ptp(net.reshape(-1, 3), axis=0)))
        ms, triangles, certified = median_ms(patch(net, degree, w, trimmed), pulled(net), error)
        lines.append(f"| {name} | {error:.4f} | {ms:.1f} | {triangles} | {certified:.4f} |")
    text = "\n".join(lines)
    if docs:
        replace_section(docs, "deform", text)
    click.echo(text)


if __name__ == "__main__":
    main()
