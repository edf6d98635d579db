"""The command ``nurbs-ooc``: one group whose subcommands are imported only when they are called.

``COMMANDS`` is the whole list with the line that ``--help`` shows, so that help and completion need
neither Open CASCADE nor numba. Each command lives in the module of its name as ``command``.
"""

from __future__ import annotations

import importlib
import importlib.util
from importlib.metadata import PackageNotFoundError, version

import click

COMMANDS = {
    "build": "Build a cache from CAD files: read, tessellate, make the hierarchy.",
    "info": "Show what is in a cache.",
    "verify": "Attack the error bounds that a cache promises; exit 1 on one violation.",
    "tessellate": "Mesh CAD files at a certified chord error (mm) into one GLB.",
    "accuracy": "Measure error against time, triangles and bytes.",
    "serve": "Serve a cache over HTTP.",
    "fly": "Draw frames along a camera path from a cache or a URL, without a display.",
    "export": "Write a cache as static 3D Tiles.",
    "synth": "Make a synthetic assembly as a surface store.",
    "demo": "Go the whole way on the shipped example: build, serve, fly, verify.",
}


class LazyGroup(click.Group):
    """A group that knows its commands' names and imports a command when it is run."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names in the order of ``COMMANDS``, only of commands whose module exists."""
        return [name for name in COMMANDS if importlib.util.find_spec(f"nurbs_ooc.cli.{name}")]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import ``nurbs_ooc.cli.<cmd_name>`` and return its ``command``; None for unknown names."""
        if cmd_name not in self.list_commands(ctx):
            return None
        command: click.Command = importlib.import_module(f"nurbs_ooc.cli.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands with their line of ``COMMANDS``, importing none."""
        rows = [(name, COMMANDS[name]) for name in self.list_commands(ctx)]
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)


def _version() -> str:
    """Version of the installed distribution, ``unknown`` when run from a bare checkout."""
    try:
        return version("nurbs-ooc")
    except PackageNotFoundError:
        return "unknown"


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(_version(), prog_name="nurbs-ooc")
def main() -> None:
    """Draw CAD assemblies of any size from their trimmed NURBS, with a certified error.

    Lengths are millimetres. Exit codes: 0 done; 1 done but a promise does not hold, or an internal
    error; 2 bad usage or bad input, one line on stderr; 130 stopped by Ctrl-C.
    """
