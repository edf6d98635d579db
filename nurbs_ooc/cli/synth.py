"""``nurbs-ooc synth``: a synthetic assembly as a surface store."""

from __future__ import annotations

from pathlib import Path

import click

from nurbs_ooc.cli.console import Console, Stopwatch, peak_rss_mib, run_command, write_report
from nurbs_ooc.cli.options import json_option, report_option


@click.command("synth", epilog="Lengths are millimetres. docs/synth.md shows the models.")
@click.argument("model", type=click.Choice(["golf", "c-class", "parking-lot"]))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Store to make, a folder.  [default: MODEL.nurbs]"
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Equal seeds, equal bytes.")
@click.option("--surfaces", type=click.IntRange(min=1), help="Placed surfaces, instead of the paper's number.")
@click.option("--unshared", is_flag=True, help="Every placement gets surfaces of its own, moved to its place.")
@click.option("--step", is_flag=True, help="Also write a STEP file beside the store (not for the parking lot).")
@click.option("--force", is_flag=True, help="Replace what is there.")
@report_option
@json_option
@run_command
def command(
    model: str,
    output: Path | None,
    seed: int,
    surfaces: int | None,
    unshared: bool,
    step: bool,
    force: bool,
    report: Path | None,
    as_json: bool,
) -> None:
    """Make a synthetic car, or sixteen of them, with the counts of the paper's models.

    golf has 8,036 trimmed NURBS with 324,358 control points, c-class 67,571 with 5,555,006; parking-lot is
    c-class placed 16 times. Counts are of placed surfaces: parts that repeat are stored once, unless
    --unshared. What comes out is an input for build and tessellate.
    """
    from nurbs_cache.errors import UsageError
    from nurbs_ooc.synth.presets import PRESETS
    from nurbs_ooc.synth.write_store import write_synthetic

    console, watch = Console(as_json), Stopwatch()
    preset = PRESETS[model] if surfaces is None else PRESETS[model].scaled(surfaces)
    path = output or Path(f"{model}.nurbs")
    if step and preset.cars > 1:
        raise UsageError("--step: a parking lot makes no sense as a STEP file; take golf or c-class")
    with watch.stage("write"), console.progress("surfaces", None) as bar:
        result = write_synthetic(preset, seed, path, unshared=unshared, force=force, advance=bar.advance)
    if step:
        from nurbs_ooc.synth.materials import material_list
        from nurbs_ooc.synth.model import CarModel
        from nurbs_ooc.synth.step_file import write_step

        materials, roles = material_list(preset.materials, preset.paint)
        step_path = path.with_suffix(".step")
        with watch.stage("step"), console.progress("surfaces as STEP", None) as bar:
            write_step(CarModel(preset.shape, preset.size, roles, seed), model, materials, step_path, bar.advance)
        result["step"] = str(step_path)
    result = {"output": str(path), "model": model, "seed": seed, **result}
    result |= {"seconds": watch.seconds, "peak_rss_mib": peak_rss_mib()}
    if report:
        write_report(report, result)
    console.json(result)
    console.print(
        f"{path}: {result['surfaces']} surfaces ({result['stored_surfaces']} stored) with {result['control_points']} "
        f"control points in {result['parts']} parts, {result['seconds']['total']:.1f} s"
    )
