"""``nurbs-ooc serve``: a cache over HTTP until Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from nurbs_cache.errors import InputFileError
from nurbs_ooc.cli.console import Console, run_command

if TYPE_CHECKING:
    from nurbs_server.serve import Server

EXIT_GRACE_S = 0.3  # for a build that is about to end, within the second that stopping may take


@click.command()
@click.argument("cache", type=click.Path(path_type=Path))
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on; 0.0.0.0 for all.")
@click.option("--port", default=8080, show_default=True, type=click.IntRange(0, 65535), help="0 takes a free port.")
@click.option(
    "--edit-token-file",
    type=click.Path(path_type=Path),
    help="File with the token that edits will need. Checked only: this version takes no edits.",
)
@click.option("--json", "as_json", is_flag=True, help="Say where it listens as one line of JSON.")
@run_command
def command(cache: Path, host: str, port: int, edit_token_file: Path | None, as_json: bool) -> None:
    """Serve CACHE over HTTP; missing tiles are built on demand and kept in it.

    While another process writes to CACHE, or where it cannot be written, it is served as it is.
    Ctrl-C or SIGTERM stops the server within a second; nothing is lost by it.
    """
    from nurbs_server.app import create_app
    from nurbs_server.serve import Server, bind, default_builders, open_to_serve, url_of

    console = Console(as_json)
    if edit_token_file is not None:
        _check_token(edit_token_file)
    store, refusal = open_to_serve(cache)
    with store:
        app = create_app(store, None if refusal else default_builders(), refusal=refusal)
        listener = bind(host, port)
        url, bound = url_of(listener)

        def announce() -> None:
            console.print(f"serving {cache} at {url}/api/scene, Ctrl-C stops")
            if refusal:
                console.print(f"nothing is built on demand: {refusal}")
            console.json({"url": url, "port": bound, "pid": os.getpid(), "builds": not refusal, "edits": False})

        server = Server(app, listener, announce)
        _stop_on_signals(server)
        server.serve_until_stopped()
        if not app.state.backend.settle(EXIT_GRACE_S):
            # A build in a thread cannot be interrupted, and its store must stay open under it. Nothing is lost
            # by ending: transactions are whole or not at all.
            sys.stderr.write("nurbs-ooc: stopped in the middle of a build, which the next request will start again\n")
            _exit()
    _exit()


def _check_token(path: Path) -> None:
    """Refuse a token file that could never work, and say that edits are off."""
    try:
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputFileError(f"{path}: the edit token cannot be read: {error}") from error
    if not token:
        raise InputFileError(f"{path}: the edit token is empty")
    sys.stderr.write("nurbs-ooc: this version takes no edits; the edit token is not used\n")


def _stop_on_signals(server: Server) -> None:
    """Ctrl-C and SIGTERM are the ordinary way to end a server: exit code 0."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())


def _exit() -> NoReturn:
    """End at once: taking down the interpreter with compiled kernels in it takes longer than all of stopping."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
