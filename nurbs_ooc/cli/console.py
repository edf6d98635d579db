"""What every command shares with people and machines: progress, one-line errors, stop watch, reports.

People get progress bars on stderr (only on a terminal) and short text on stdout; machines get ``--json``:
then stdout carries exactly one JSON object.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, ParamSpec, Protocol, TypeVar, overload

import numpy as np

from nurbs_cache.compile_notice import on_first_compile
from nurbs_cache.errors import NurbsOocError
from nurbs_ooc.export.atomic_file import atomic_file

P = ParamSpec("P")
R = TypeVar("R")

EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
DEFAULT_HINT = "nothing half-written is left; run the same command again"


@overload
def run_command(function: Callable[P, R]) -> Callable[P, R]: ...
@overload
def run_command(*, resume: str) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def run_command(
    function: Callable[P, R] | None = None, *, resume: str = DEFAULT_HINT
) -> Callable[P, R] | Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a command's body: our errors become one line on stderr and their exit code, Ctrl-C becomes 130.

    Use it as ``@run_command`` or, where stopping needs a better hint, ``@run_command(resume="add --resume to go on")``.
    It stands closest to the function, below click's decorators.
    """
    if function is None:
        return lambda body: _guarded(body, resume)
    return _guarded(function, resume)


def _guarded(body: Callable[P, R], resume: str) -> Callable[P, R]:
    @functools.wraps(body)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        if sys.stderr.isatty():
            on_first_compile(_say_compiling)
        try:
            with _interrupts_kept():
                return body(*args, **kwargs)
        except NurbsOocError as error:
            _fail(str(error), error.exit_code)
        except OSError as error:
            if error.errno is None:  # a library's own error dressed as OSError: a bug worth its traceback
                raise
            where = f"{error.filename}: " if error.filename else ""
            _fail(f"{where}{error.strerror}", NurbsOocError.exit_code)
        except KeyboardInterrupt:
            _fail(f"stopped by Ctrl-C; {resume}", EXIT_INTERRUPTED)

    return guarded


_interrupted = False


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Remember Ctrl-C: Python drops the exception where it comes while an object is being deleted.

    Progress raises it again (see ``_raise_if_interrupted``).
    """
    global _interrupted
    _interrupted = False
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if ours:
        signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        if ours and signal.getsignal(signal.SIGINT) is _interrupt:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(_number: int, _frame: object) -> None:
    global _interrupted
    _interrupted = True
    raise KeyboardInterrupt


def _raise_if_interrupted() -> None:
    if _interrupted:
        raise KeyboardInterrupt


def _say_compiling() -> None:
    sys.stderr.write("compiling kernels: once after an install or update, about a minute\n")
    sys.stderr.flush()


def _fail(message: str, code: int) -> NoReturn:
    """Write ``message`` as one line to stderr and leave."""
    sys.stderr.write(f"nurbs-ooc: {' '.join(message.split())}\n")
    sys.stderr.flush()
    sys.exit(code)


class Progress(Protocol):
    """What ``Console.progress`` yields."""

    def advance(self, n: float = 1) -> None:
        """Count ``n`` more units as done."""

    def set_total(self, total: float) -> None:
        """Tell how many units there are, as soon as it is known."""


class _Bar:
    """Progress with a bar of rich, or without one; either way a look at Ctrl-C."""

    def __init__(self, bar: Any = None, task: Any = None) -> None:
        self._bar, self._task = bar, task

    def advance(self, n: float = 1) -> None:
        _raise_if_interrupted()
        if self._bar is not None:
            self._bar.advance(self._task, n)

    def set_total(self, total: float) -> None:
        if self._bar is not None:
            self._bar.update(self._task, total=total)


class Console:
    """Output of one command.

    Args:
        json_mode: stdout carries only what ``json`` writes; ``print`` is silent.
    """

    def __init__(self, json_mode: bool = False) -> None:
        self.json_mode = json_mode

    @contextmanager
    def progress(self, label: str, total: float | None = None) -> Iterator[Progress]:
        """Show a bar on stderr while the block runs; nothing when stderr is not a terminal.

        Args:
            label: what is counted.
            total: how many, None while it is not known (see ``set_total``).
        """
        if not sys.stderr.isatty():
            yield _Bar()
            return
        from rich.console import Console as RichConsole
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            ProgressColumn,
            Task,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.progress import Progress as Bar
        from rich.text import Text

        class Speed(ProgressColumn):
            def render(self, task: Task) -> Text:
                return Text(f"{task.speed:.0f}/s" if task.speed else "")

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            Speed(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            TimeRemainingColumn(),
        )
        with Bar(*columns, console=RichConsole(stderr=True), transient=True) as bar:
            yield _Bar(bar, bar.add_task(label, total=total))

    def print(self, *values: object) -> None:
        """Write a line for people to stdout; ``values`` may be rich renderables (tables)."""
        if self.json_mode:
            return
        from rich.console import Console as RichConsole

        RichConsole(highlight=False, soft_wrap=True).print(*values, markup=False)

    def json(self, value: Any) -> None:
        """Write ``value`` as one line of JSON to stdout, in ``json_mode`` only."""
        if self.json_mode:
            sys.stdout.write(json.dumps(value, default=_plain, allow_nan=False) + "\n")
            sys.stdout.flush()


class Stopwatch:
    """Wall time of a command's stages, in seconds; a stage entered again adds up."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block's time as ``name``."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Count ``seconds`` as ``name``: for what was timed elsewhere."""
        self._stages[name] = self._stages.get(name, 0.0) + seconds

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage, with ``total`` since the stopwatch was made."""
        return {**self._stages, "total": time.perf_counter() - self._start}


def write_report(path: Path | str, report: Mapping[str, Any]) -> None:
    """Write ``report`` as JSON, whole or not at all; numpy values become plain numbers and lists.

    Raises:
        ValueError: a number in it is NaN or infinite: a report never hides one.
    """
    text = json.dumps(report, indent=2, default=_plain, allow_nan=False)
    with atomic_file(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _plain(value: object) -> object:
    """Plain JSON value of a numpy scalar or array, or of a path."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a report holds no {type(value).__name__}")


def peak_rss_mib() -> float:
    """Peak resident memory of this process and its children, MiB.

    The processes' own peaks are added up, so it is never lower than the true peak of the living tree; of
    children that ended, the largest counts.
    """
    import resource

    import psutil

    children = psutil.Process().children(recursive=True)
    living = sum(_peak_kib(child.pid) for child in children)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    own = _peak_kib(os.getpid()) or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(own + max(living, ended)) / 1024.0


def _peak_kib(pid: int) -> int:
    """``VmHWM`` of a process, KiB; 0 if it is gone or the system has no such file."""
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return 0
    for line in text.splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1])
    return 0
