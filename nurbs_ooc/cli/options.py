"""Options that several commands have in common, so that they look and read the same."""

from __future__ import annotations

import os
from pathlib import Path

import click


def available_cpus() -> int:
    """Processors this process may use: fewer than the machine's in a container or under taskset."""
    return len(os.sched_getaffinity(0))


inputs_argument = click.argument("inputs", nargs=-1, required=True, metavar="INPUT...", type=click.Path(path_type=Path))

workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=available_cpus,
    show_default="all processors",
    help="Number of threads; the result's bytes do not depend on it.",
)

report_option = click.option(
    "--report",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write a JSON report of counts, errors (mm), seconds.",
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print the report as one line of JSON.")
