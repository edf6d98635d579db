"""``nurbs-ooc verify``: attack the error bounds that a cache promises."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from nurbs_ooc.cli.console import Console, Stopwatch, run_command, write_report
from nurbs_ooc.cli.options import workers_option

if TYPE_CHECKING:
    from rich.table import Table

    from nurbs_ooc.measure.verify_cache import CacheReport

NAMED = 5  # violations in the error's one line; --json and --report have them all


@click.command("verify")
@click.argument("cache", type=click.Path(path_type=Path))
@click.option(
    "--samples",
    type=click.IntRange(min=1),
    default=2_000_000,
    show_default=True,
    help="Points to measure, spread over all tiles and their surfaces, before climbing; the time follows them.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The same seed finds the same.")
@workers_option
@click.option("--report", type=click.Path(path_type=Path), help="Write the findings as JSON to this file.")
@click.option("--json", "as_json", is_flag=True, help="Write the findings as one line of JSON to stdout.")
@run_command
def command(cache: Path, samples: int, seed: int, workers: int, report: Path | None, as_json: bool) -> None:
    """Attack the error bounds (mm) that CACHE promises, with code that shares nothing with the tessellator.

    Points of the exact trimmed surfaces are measured to what every stored tile draws, and what it draws to
    the surfaces; the worst samples climb to worse ones. Exit code 1 if one promise does not hold.
    """
    from nurbs_cache.errors import PromiseBrokenError
    from nurbs_cache.store import Store
    from nurbs_ooc.measure.verify_cache import CacheAttack

    console, watch = Console(as_json), Stopwatch()
    with Store.open(cache) as store, watch.stage("verify"):
        attack = CacheAttack(store, samples, seed, workers)
        with console.progress("verify", attack.n_jobs) as bar:
            found = attack.run(bar.advance)
    settings = {"cache": str(cache), "requested_samples": samples, "seed": seed, "workers": workers}
    result = found.as_json() | settings | {"seconds": watch.seconds}
    if report:
        write_report(report, result)
    console.json(result)
    console.print(_table(found))
    console.print(
        f"{found.nodes} nodes and {found.lods} levels of detail, {found.samples} samples, "
        f"{len(found.violations)} violations, {watch.seconds['total']:.1f} s"
    )
    if found.violations:
        named = "; ".join(str(v) for v in found.violations[:NAMED])
        raise PromiseBrokenError(f"{cache}: {len(found.violations)} violations: {named}")


def _table(found: CacheReport) -> Table:
    from rich.table import Table

    table = Table(
        "tile", "surface to tile", "tile to surface", "certified", "ratio", title="Nearest to their promise, mm"
    )
    for m in found.worst():
        numbers = (m.surface_to_tile, m.tile_to_surface, m.certified)
        table.add_row(m.where, *(f"{x:.4g}" for x in numbers), f"{m.ratio:.3f}")
    return table
