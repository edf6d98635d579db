"""``nurbs-ooc accuracy``: error against time, triangles and bytes, certified and measured."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import click

from nurbs_cache.errors import UsageError
from nurbs_ooc.cli.console import Console, Stopwatch, peak_rss_mib, run_command, write_report
from nurbs_ooc.cli.options import inputs_argument, json_option


@click.command("accuracy")
@inputs_argument
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder for CSV, JSON and PNG.")
@click.option("--peers", is_flag=True, help="Also mesh the same faces with Open CASCADE.")
@click.option(
    "--samples", type=click.IntRange(min=20), default=100, show_default=True, help="Samples a face and direction."
)
@click.option(
    "--max-triangles",
    type=click.IntRange(min=1),
    default=2_000_000,
    show_default=True,
    help="Leave out settings that are expected to give more triangles.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the samples.")
@json_option
@run_command
def command(
    inputs: tuple[Path, ...], output: Path, peers: bool, samples: int, max_triangles: int, seed: int, as_json: bool
) -> None:
    """Measure what accuracy costs on CAD files.

    For errors from 1e-2 to 1e-6 of the diagonal: certified error, measured error (mm), error of the normals
    (degrees), triangles, bytes and CPU seconds of one core, for the certified tessellation, an estimate by
    samples, regular grids and, with --peers, Open CASCADE; besides, what fewer bits a coordinate and float32
    cost. INPUTS are STEP or IGES files (also gzipped) or surface stores (.nurbs).
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("accuracy draws with matplotlib, which is not installed: pip install 'nurbs-ooc[accuracy]'")
    if output.exists() and not output.is_dir():
        raise UsageError(f"{output}: is not a folder")
    from nurbs_ooc.accuracy.curves import Effort
    from nurbs_ooc.accuracy.study import draw, n_settings, study, write_tables
    from nurbs_ooc.readers.several import open_inputs

    console, stopwatch = Console(as_json), Stopwatch()
    with stopwatch.stage("read"), open_inputs(inputs) as assembly:
        parts = [part.geometry for part in assembly.parts()]
    with console.progress("settings", n_settings(peers)) as progress, stopwatch.stage("tessellate"):
        result = study(parts, peers, Effort(samples, max_triangles, seed), progress.advance)
    output.mkdir(parents=True, exist_ok=True)
    title = ", ".join(path.name for path in inputs)
    with stopwatch.stage("write"):
        write_tables(output, result)
        draw(output / "accuracy.png", title, result)
    result |= {"inputs": [str(p) for p in inputs], "seconds": stopwatch.seconds, "peak_rss_mib": peak_rss_mib()}
    write_report(output / "accuracy.json", result)
    console.json(result)
    _print_summary(console, result)


def _print_summary(console: Console, result: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table(
        "variant", "setting", "measured mm", "certified mm", "triangles", "bytes", "s", "over", "lost", box=None
    )
    for p in result["points"]:
        certified = "" if p["certified_mm"] is None else f"{p['certified_mm']:.3g}"
        table.add_row(
            p["variant"], f"{p['setting']:.3g}", f"{p['measured_max_mm']:.3g}", certified, str(p["triangles"]),
            str(p["bytes"]), f"{p['seconds']:.3g}", str(p["faces_over_request"]), str(p["lost_faces"]),
        )  # fmt: skip
    console.print(table)
    broken = sum(p["violations"] for p in result["points"])
    console.print(f"{broken} certified bounds broken; {len(result['left_out'])} settings left out")
