"""``nurbs-ooc demo``: the whole way on the shipped example, through the commands that anybody would type.

Each stage is its own process, so the pictures really come over HTTP and each stage's memory is its own.
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from nurbs_cache.errors import NurbsOocError, PromiseBrokenError
from nurbs_ooc.cli.console import EXIT_INTERRUPTED, Console, Stopwatch, run_command, write_report
from nurbs_ooc.cli.example import ASSEMBLY, CAMERA_PATH, example_path
from nurbs_ooc.cli.options import json_option, workers_option

Json = dict[str, Any]

STOP_TIMEOUT_S = 10.0  # a server stops within a second; longer is a hang worth an error


class StageError(NurbsOocError):
    """A stage of the demo ended with an error; it has already said which on stderr."""

    def __init__(self, stage: str, exit_code: int) -> None:
        super().__init__(f"demo: {stage} ended with exit code {exit_code}")
        self.exit_code = exit_code


@click.command("demo")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out/demo"),
    show_default=True,
    help="Folder for the cache, the pictures and report.json.",
)
@click.option("--size", default="1280x720", show_default=True, help="Size of the pictures, pixels.")
@click.option("--error-px", default=0.5, show_default=True, help="Error on the screen that is asked for, pixels.")
@workers_option
@json_option
@run_command
def command(output: Path, size: str, error_px: float, workers: int, as_json: bool) -> None:
    """Build a cache of the shipped trackball, serve it, fly through it over HTTP, verify its error bounds.

    Leaves frames and a contact sheet in OUTPUT/frames, and OUTPUT/report.json. Takes a few minutes.
    """
    console, stopwatch = Console(as_json), Stopwatch()
    output.mkdir(parents=True, exist_ok=True)
    cache, frames = output / "cache", output / "frames"
    for old in (cache, frames):
        shutil.rmtree(old, ignore_errors=True)
    report: Json = {"input": ASSEMBLY}
    with stopwatch.stage("build"):
        arguments = [example_path(ASSEMBLY), "-o", cache, "--workers", workers, "--json"]
        report["build"] = _run(console, "build", arguments)
    with _served(console, cache) as url, stopwatch.stage("fly"):
        arguments = [url, "--path", example_path(CAMERA_PATH), "-o", frames, "--size", size, "--error-px", error_px]
        report["fly"] = _run(console, "fly", [*arguments, "--json"])
    with stopwatch.stage("verify"):
        report["verify"] = _run(console, "verify", [cache, "--json"], allowed=(0, PromiseBrokenError.exit_code))
    report["seconds"] = stopwatch.seconds
    write_report(output / "report.json", report)
    console.json(report)
    _print_table(console, report)
    console.print(f"pictures in {frames}, all figures in {output / 'report.json'}")
    if report["verify"].get("violations"):
        raise PromiseBrokenError("demo: verify found violations of the promised error bounds")


def _arguments(name: str, arguments: Sequence[object]) -> list[str]:
    return [sys.executable, "-m", "nurbs_ooc", name, *map(str, arguments)]


def _run(console: Console, name: str, arguments: Sequence[object], allowed: Sequence[int] = (0,)) -> Json:
    """Run one command to its end and return its ``--json`` report; its progress bar stays visible."""
    console.print(f"$ nurbs-ooc {name} {' '.join(map(str, arguments))}")
    process = subprocess.Popen(_arguments(name, arguments), stdout=subprocess.PIPE)
    try:
        text, _ = process.communicate()
    except BaseException:  # Ctrl-C reaches the stage as well: let it clean up before we leave
        process.wait()
        raise
    if process.returncode == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    if process.returncode not in allowed:
        raise StageError(name, process.returncode)
    report: Json = json.loads(text)
    return report


@contextmanager
def _served(console: Console, cache: Path) -> Iterator[str]:
    """URL of a server of ``cache`` on a free loopback port, in a process of its own."""
    arguments = [cache, "--port", 0, "--json"]
    console.print(f"$ nurbs-ooc serve {' '.join(map(str, arguments))} &")
    with subprocess.Popen(_arguments("serve", arguments), stdout=subprocess.PIPE) as server:
        try:
            line = server.stdout.readline() if server.stdout else b""
            if not line:
                raise StageError("serve", server.wait(STOP_TIMEOUT_S))
            yield str(json.loads(line)["url"])
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait(STOP_TIMEOUT_S)


def _print_table(console: Console, report: Json) -> None:
    from rich.table import Table

    build, fly, verify, seconds = report["build"], report["fly"], report["verify"], report["seconds"]
    faces = build["faces"]
    table = Table(title=report["input"])
    table.add_column("stage")
    table.add_column("s", justify="right")
    table.add_column("what came out")
    statuses = ", ".join(f"{faces[status]} {status}" for status in ("exact", "healed", "degraded", "failed"))
    table.add_row("build", f"{seconds['build']:.1f}", f"{faces['read']} faces: {statuses}")
    for reason, n in sorted(build.get("face_reasons", {}).items(), key=lambda pair: -pair[1]):
        table.add_row("", "", f"  {n} {reason}")
    table.add_row("", "", f"{build['nodes']} nodes, {build['levels']} levels, {build['bytes'] / 1e6:.1f} MB")
    table.add_row(
        "fly", f"{seconds['fly']:.1f}", f"{fly['frames']} frames, {fly['bytes_streamed'] / 1e6:.1f} MB over HTTP"
    )
    error_px = fly["screen_error_px"]
    table.add_row(
        "", "", f"certified error on the screen: mean {error_px['mean']:.2f} px, worst {error_px['max']:.2f} px"
    )
    table.add_row("", "", f"{fly['gl_renderer']}, {fly['fps']['mean']:.1f} frames/s")
    measured = f"{verify['samples'] / 1e6:.1f} million distances, {len(verify['violations'])} violations"
    table.add_row("verify", f"{seconds['verify']:.1f}", measured)
    table.add_row("", "", f"largest measured / certified error: {verify['worst_measured_over_certified']:.3f}")
    console.print(table)
