"""``nurbs-ooc build``: CAD files in, a cache out."""

from __future__ import annotations

import os
from pathlib import Path

import click

from nurbs_ooc.cli.byte_size import byte_size
from nurbs_ooc.cli.console import Console, Stopwatch, peak_rss_mib, run_command, write_report


@click.command(epilog="Lengths are millimetres. Ctrl-C keeps what is done in CACHE.partial; --resume goes on with it.")
@click.argument("inputs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", "cache", required=True, type=click.Path(path_type=Path), help="The cache to make.")
@click.option(
    "--levels",
    type=click.Choice(["root", "all"]),
    default="all",
    show_default=True,
    help="Nodes whose tiles are built now; the server builds the others when they are first asked for.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=os.cpu_count() or 1,
    show_default="all cores",
    help="Processes that do the work; 1: no others than this one.",
)
@click.option(
    "--memory",
    type=byte_size,
    metavar="SIZE",
    default="1GiB",
    show_default=True,
    help="For all processes together; a budget that is too small for the workers or the model is refused.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Scheduler of a Dask cluster whose workers (one thread each, sharing this file system) do the work.",
)
@click.option(
    "--codec",
    type=click.Choice(["zstd", "huffman"]),
    default="zstd",
    show_default=True,
    help="Entropy coder of the tiles; what is built later on demand uses it too.",
)
@click.option("--resume", is_flag=True, help="Go on with a build that was stopped, or add tiles to a finished cache.")
@click.option("--force", is_flag=True, help="Replace CACHE once the new one is complete.")
@click.option("--report", type=click.Path(path_type=Path), help="Write the report as JSON to this file.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as one line of JSON.")
@run_command(resume="the cache is untouched; add --resume to go on with this build")
def command(
    inputs: tuple[Path, ...],
    cache: Path,
    levels: str,
    workers: int,
    memory: int,
    dask: str | None,
    codec: str,
    resume: bool,
    force: bool,
    report: Path | None,
    as_json: bool,
) -> None:
    """Read INPUTS (STEP, IGES, also gzipped, or .nurbs stores; several make one scene) and build a cache.

    Surfaces are boxed, sorted into one lazy octree per material, and tessellated for the nodes of every
    level with a certified error.
    """
    from nurbs_cache.store import Store
    from nurbs_ooc.build.pipeline import BuildOptions, build
    from nurbs_ooc.build.report import contents

    console, watch = Console(as_json), Stopwatch()
    options = BuildOptions("root" if levels == "root" else "all", workers, resume, force, codec, memory, dask)
    build(inputs, cache, options, console.progress, watch)
    with Store.open(cache) as store:
        result = {"output": str(cache), **contents(store)}
    result |= {"workers": workers, "seconds": watch.seconds, "peak_rss_mib": peak_rss_mib()}
    if report:
        write_report(report, result)
    console.json(result)
    console.print(
        f"{cache}: {result['surfaces']} surfaces placed {result['placed_surfaces']} times, {result['nodes']} nodes, "
        f"{result['tiles']} tiles of {result['tile_bytes'] / 2**20:.1f} MiB in {watch.seconds['total']:.1f} s"
    )
    _print_bad_faces(console, result["faces"])


def _print_bad_faces(console: Console, faces: dict[str, int]) -> None:
    """One line if a face is less than exact."""
    bad = [f"{faces[name]} {name}" for name in ("healed", "degraded", "failed") if faces[name]]
    if bad:
        console.print(f"faces: {faces['exact']} exact, {', '.join(bad)}")
