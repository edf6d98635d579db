"""The command's frame: lazy commands, one-line errors, exit codes, reports."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from nurbs_cache.errors import InputFileError, PromiseBrokenError, UsageError
from nurbs_ooc.cli.console import Console, Stopwatch, run_command, write_report
from nurbs_ooc.cli.main import COMMANDS, main
from nurbs_ooc.export.atomic_file import atomic_file


def existing_commands() -> list[str]:
    return main.list_commands(None)  # type: ignore[arg-type]


def test_help_lists_every_command_and_imports_none() -> None:
    code = (
        "import sys; from nurbs_ooc.cli.main import main; main(['--help'], standalone_mode=False);"
        "assert not {'OCP', 'numba', 'fastapi', 'moderngl'} & set(sys.modules), 'a heavy import for --help'"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    for name in existing_commands():
        assert f"\n  {name} " in run.stdout


@pytest.mark.parametrize("name", existing_commands())
def test_command_has_help_and_a_known_name(name: str) -> None:
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert "Usage:" in result.output
    assert name in COMMANDS


def test_unknown_command_is_bad_usage() -> None:
    assert CliRunner().invoke(main, ["no-such-thing"]).exit_code == 2


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputFileError("a.stp: entity #7:\n no loop"), 2, "nurbs-ooc: a.stp: entity #7: no loop\n"),
        (PromiseBrokenError("2 violations"), 1, "nurbs-ooc: 2 violations\n"),
        (OSError(errno.ENOSPC, "No space left on device", "x.glb"), 2, "nurbs-ooc: x.glb: No space left on device\n"),
        (KeyboardInterrupt(), 130, "nurbs-ooc: stopped by Ctrl-C; add --resume to go on\n"),
    ],
)
def test_errors_are_one_line(error: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    @run_command(resume="add --resume to go on")
    def command() -> None:
        raise error

    with pytest.raises(SystemExit) as stopped:
        command()
    assert stopped.value.code == code
    assert capsys.readouterr().err == line


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_counts_also_where_python_drops_it(capsys: pytest.CaptureFixture[str]) -> None:
    class Dying:
        def __del__(self) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(1000):  # the handler runs here, and its exception goes nowhere
                pass

    done = []

    @run_command
    def work() -> None:
        with Console().progress("work") as bar:
            Dying()
            done.append("went on")
            bar.advance()
            done.append("and on")

    with pytest.raises(SystemExit) as stopped:
        work()
    assert (stopped.value.code, done) == (130, ["went on"])
    assert "stopped by Ctrl-C" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_own_bugs_keep_their_traceback() -> None:
    @run_command
    def command() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        command()


def test_json_mode_has_one_object_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(json_mode=True)
    console.print("for people")
    with console.progress("faces", total=3) as progress:
        progress.advance()
        progress.set_total(4)
    console.json({"triangles": np.int64(3), "error": np.float64(0.5)})
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"triangles": 3, "error": 0.5}
    assert captured.err == ""


def test_people_get_text(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console()
    console.print("[12 faces]")
    console.json({"faces": 12})
    assert capsys.readouterr().out == "[12 faces]\n"


def test_stopwatch_adds_up() -> None:
    stopwatch = Stopwatch()
    for _ in range(2):
        with stopwatch.stage("read"):
            time.sleep(0.01)
    stopwatch.add("write", 1.5)
    seconds = stopwatch.seconds
    assert list(seconds) == ["read", "write", "total"]
    assert seconds["write"] == 1.5
    assert 0.02 <= seconds["read"] <= seconds["total"]


def test_report_is_plain_json_or_nothing(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_report(path, {"faces": {"read": np.int32(4)}, "box": np.zeros(3), "path": tmp_path})
    assert json.loads(path.read_text()) == {"faces": {"read": 4}, "box": [0, 0, 0], "path": str(tmp_path)}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_report(path, {"error": float("nan")})
    assert json.loads(path.read_text())["faces"] == {"read": 4}
    assert list(tmp_path.iterdir()) == [path]


def test_peak_memory_counts_children() -> None:
    code = """
import subprocess, sys
from nurbs_ooc.cli.console import peak_rss_mib
before = peak_rss_mib()
allocate = "x = b'x' * 50_000_000; print(flush=True); input()"
child = subprocess.Popen([sys.executable, "-c", allocate], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
child.stdout.readline()
living = peak_rss_mib()
child.communicate(b"\\n")
print(before, living, peak_rss_mib())
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    before, living, ended = map(float, run.stdout.split())
    assert 10 < before < living - 45
    assert ended > before + 45


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), KeyboardInterrupt(), UsageError("no")])
def test_atomic_file_leaves_nothing_half_written(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "out.bin"
    path.write_text("before")

    def write() -> None:
        with atomic_file(path) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(type(error)):
        write()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_atomic_file_replaces_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.bin"
    with atomic_file(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with pytest.raises(UsageError, match="does not exist"), atomic_file(tmp_path / "no" / "x"):
        pass


def test_module_runs_like_the_script(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-m", "nurbs_ooc", "--version"], capture_output=True, text=True, check=True)
    assert run.stdout.startswith("nurbs-ooc, version ")


def bad_calls() -> list[tuple[str, Callable[[Path], list[str]], str]]:
    """Calls of ``tessellate`` that must end with exit code 2 and one line."""
    return [
        ("missing file", lambda d: [str(d / "no.stp"), "-o", str(d / "o.glb"), "--error", "0.1"], "no.stp"),
        ("error zero", lambda d: [str(d / "a.stp"), "-o", str(d / "o.glb"), "--error", "0"], "error"),
        ("no folder", lambda d: [str(d / "a.stp"), "-o", str(d / "x" / "o.glb"), "--error", "1"], "does not exist"),
        ("not CAD", lambda d: [str(d / "a.stp"), "-o", str(d / "o.glb"), "--error", "1"], "a.stp"),
    ]
