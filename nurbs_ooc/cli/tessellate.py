"""``nurbs-ooc tessellate``: one-shot mesh at a certified chord error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from nurbs_cache.errors import UsageError
from nurbs_ooc.cli.console import Console, Stopwatch, peak_rss_mib, run_command, write_report
from nurbs_ooc.cli.options import inputs_argument, json_option, report_option, workers_option


@click.command("tessellate")
@inputs_argument
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="GLB file to write.")
@click.option(
    "--error", required=True, type=float, metavar="MM", help="Chord error in mm: surface to triangles, both ways."
)
@click.option("--normal-error", type=float, metavar="DEG", help="Also bound the normals' deviation, degrees.")
@click.option(
    "--appearance",
    type=click.Choice(["normals", "curvature", "both"]),
    help="Let the error hold for distance and shading together: of normals, a colouring by curvature, or both.",
)
@workers_option
@report_option
@json_option
@run_command
def command(
    inputs: tuple[Path, ...],
    output: Path,
    error: float,
    normal_error: float | None,
    appearance: str | None,
    workers: int,
    report: Path | None,
    as_json: bool,
) -> None:
    """Mesh CAD files into one GLB whose distance to the exact surfaces is certified.

    INPUTS are STEP or IGES files (also gzipped) or surface stores (.nurbs). The GLB is in metres, y up, with one
    node per placed part; the faces' ids are in _FEATURE_ID_0.
    """
    _check_errors(error, normal_error)
    _check_output(output, inputs)
    from nurbs_ooc.export.mesh_file import MeshOptions, write_mesh_file
    from nurbs_ooc.readers.several import open_inputs
    from nurbs_ooc.tessellation.appearance import Appearance

    console, stopwatch = Console(as_json), Stopwatch()
    with stopwatch.stage("read"):
        assembly = open_inputs(inputs)
    with assembly, console.progress("faces", assembly.n_surfaces) as progress:
        look = None
        if appearance is not None:
            look = Appearance(appearance != "curvature", None if appearance == "normals" else "curvature")
        options = MeshOptions(error, normal_error, look, workers)
        result = write_mesh_file(
            assembly, output, options, stopwatch.stage, lambda part: progress.advance(len(part.geometry))
        )
    result |= {
        "output": str(output),
        "error_mm": error,
        "workers": workers,
        "seconds": {"read": 0.0, "tessellate": 0.0, "write": 0.0} | stopwatch.seconds,
        "peak_rss_mib": peak_rss_mib(),
    }
    if report:
        write_report(report, result)
    console.json(result)
    _print_summary(console, result)


def _check_errors(error: float, normal_error: float | None) -> None:
    if not (math.isfinite(error) and error > 0.0):
        raise UsageError(f"--error {error}: must be a positive number of mm")
    if normal_error is not None and not 0.0 < normal_error <= 90.0:
        raise UsageError(f"--normal-error {normal_error}: must be more than 0 and at most 90 degrees")


def _check_output(output: Path, inputs: tuple[Path, ...]) -> None:
    """Refuse what could not be written before hours are spent."""
    if not output.parent.is_dir():
        raise UsageError(f"{output}: the folder {output.parent} does not exist")
    if output.is_dir():
        raise UsageError(f"{output}: is a folder")
    if output.exists() and any(output.samefile(path) for path in inputs if path.exists()):
        raise UsageError(f"{output}: is an input")


def _print_summary(console: Console, result: dict[str, Any]) -> None:
    faces = result["faces"]
    others = ", ".join(f"{faces[s]} {s}" for s in ("healed", "degraded", "failed") if faces[s])
    console.print(
        f"{result['output']}: {faces['read']} faces ({others or 'all exact'}), {result['triangles']} triangles, "
        f"certified {result['certified_error_mm']:.3g} mm, {result['bytes']} bytes, {result['seconds']['total']:.1f} s"
    )
    if result["certified_error_mm"] > result["error_mm"]:
        console.print(f"certified error is above the {result['error_mm']:g} mm asked for; --report lists the faces")
    if "appearance_error_mm" in result:
        console.print(f"distance and shading together {result['appearance_error_mm']:.3g} mm")
    angle = result.get("certified_normal_error_deg")
    if angle is not None:
        console.print(f"normals certified within {angle:.3g} degrees")
