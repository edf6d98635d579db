"""``nurbs-ooc fly``: frames along a camera path, from a cache or a URL."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nurbs_ooc.cli.console import Console, run_command, write_report

if TYPE_CHECKING:
    from nurbs_client.transport import Transport

MAX_SIDE = 8192  # pixels; with 4 x 4 supersampling still within OpenGL's limits


class Size(click.ParamType[tuple[int, int]]):
    """``WIDTHxHEIGHT`` in pixels."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Parse ``value``."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d+)[xX](\d+)", str(value))
        size = (int(match[1]), int(match[2])) if match else (0, 0)
        if not all(1 <= side <= MAX_SIDE for side in size):
            self.fail(f"{value!r} is not WIDTHxHEIGHT, each 1 to {MAX_SIDE} pixels", param, ctx)
        return size


@click.command(name="fly")
@click.argument("source", metavar="CACHE_OR_URL")
@click.option(
    "--path",
    "path_file",
    default="auto",
    metavar="PATH.json|auto",
    show_default=True,
    help="Camera path, see docs/client.md; auto: once around the scene, then closer.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for frame_NNNNN.png, frames.csv and contact_sheet.png.",
)
@click.option("--size", type=Size(), default="1280x720", show_default=True, help="Of the frames, pixels.")
@click.option(
    "--error-px",
    type=click.FloatRange(0, min_open=True),
    default=0.5,
    show_default=True,
    help="Allowed error on screen, pixels.",
)
@click.option(
    "--target-fps", type=click.FloatRange(0, min_open=True), help="Hold this frame rate by raising the error; streams."
)
@click.option("--frames", metavar="N|A:B[:STEP]", help="N frames evenly over the path, or some of the path's own.")
@click.option(
    "--wait/--no-wait",
    default=None,
    help="Draw each frame when all that shows has been loaded (default), or what is there (streaming).",
)
@click.option("--samples", type=click.IntRange(1, 64), default=4, show_default=True, help="Per pixel, against jaggies.")
@click.option(
    "--memory-mib",
    type=click.IntRange(1),
    default=1024,
    show_default=True,
    help="Graphics memory for tiles, MiB; if it is too small, the error grows and the report says so.",
)
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), help="Write the report as JSON.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@run_command(resume="the frames drawn so far are in the output folder")
def command(
    source: str,
    path_file: str,
    output: Path,
    size: tuple[int, int],
    error_px: float,
    target_fps: float | None,
    frames: str | None,
    wait: bool | None,
    samples: int,
    memory_mib: int,
    report: Path | None,
    as_json: bool,
) -> None:
    """Draw frames along a camera path without a display.

    CACHE_OR_URL is a cache folder, or http://HOST:PORT of a server. Lengths are millimetres.
    Says which OpenGL renderer it used; software rendering is fine, only slower.
    """
    from nurbs_cache.errors import UsageError
    from nurbs_client.flight import Flight, FlightSettings
    from nurbs_client.path import auto_path, chosen_frames, load_path

    if target_fps and wait:
        raise UsageError("--target-fps and --wait contradict one another: a frame rate is held by not waiting")
    console = Console(json_mode=as_json)
    path = None if path_file == "auto" else load_path(path_file)
    settings = FlightSettings(
        size=size,
        error_px=error_px,
        target_fps=target_fps,
        samples=samples,
        wait=target_fps is None if wait is None else wait,
        memory_bytes=memory_mib << 20,
    )
    transport = open_transport(source)
    try:
        flight = Flight(transport, output, settings)
        path = path or auto_path(*flight.scene.aabb, size[0] / size[1])
        times, numbers = chosen_frames(path, frames)
        with console.progress("frames", len(numbers)) as progress:
            flight.on_frame = progress.advance
            result = {"source": source, **flight.fly(path, times, numbers)}
    finally:
        transport.close()
    if report:
        write_report(report, result)
    _show(console, result, output)


def open_transport(source: str) -> Transport:
    """The transport for a cache folder or a URL; a cache that can be written builds missing tiles."""
    from nurbs_client.transport import CacheTransport, HttpTransport

    if re.match(r"https?://", source):
        return HttpTransport(source)
    from nurbs_ooc.build.on_demand import build_node_tile, build_surface_lod

    return CacheTransport(source, node_builder=build_node_tile, lod_builder=build_surface_lod)


def _show(console: Console, result: dict[str, Any], output: Path) -> None:
    """What the flight was like, in a few lines."""
    error, fps = result["screen_error_px"], result["fps"]
    console.print(f"{result['frames']} frames in {output}, drawn by {result['gl_renderer']}")
    console.print(
        f"screen error {error['mean']:.3f} px mean, {error['max']:.3f} px max (asked: {result['error_px']} px)"
    )
    console.print(f"{fps['mean']:.1f} frames/s mean, {fps['min']:.1f} slowest; {result['bytes_streamed']:,} bytes")
    if result["error_target_raised_by_memory"]:
        console.print(f"the memory was too small: the error target rose to {result['error_target_px']['max']:.2f} px")
    if result["failed_tiles"]:
        console.print(f"{len(result['failed_tiles'])} tiles failed: {result['failed_tiles'][0]['reason']}")
    console.json(result)
