"""What a command and all processes that it starts take: seconds and memory, sampled from outside."""

from __future__ import annotations

import os
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

INTERVAL_S = 0.25


@dataclass(frozen=True)
class Taken:
    """What a command took.

    Attributes:
        exit_code: its own.
        stdout: what it wrote.
        wall_s, cpu_s: seconds, those of its ended children included.
        peak_rss_mib: largest sum of resident memory over the tree; shared pages count once a process.
        peak_pss_mib: the same with shared pages counted once; None where the system does not tell.
        peak_disk_mib: largest size of the files below ``watched``.
    """

    exit_code: int
    stdout: str
    wall_s: float
    cpu_s: float
    peak_rss_mib: float
    peak_pss_mib: float | None
    peak_disk_mib: float


def _tree(pid: int) -> list[int]:
    try:
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    except psutil.NoSuchProcess:
        return []


def _field_kib(path: str, name: str) -> int:
    try:
        for line in Path(path).read_text(encoding="ascii").splitlines():
            if line.startswith(name):
                return int(line.split()[1])
    except OSError:
        pass
    return 0


def _size(folder: Path) -> int:
    try:
        return sum(path.stat().st_blocks * 512 for path in folder.iterdir())
    except OSError:
        return 0


def run_measured(command: list[str], watched: list[Path]) -> Taken:
    """Run a command to its end.

    Args:
        command: program and arguments.
        watched: folders whose size counts as disk.
    """
    start, before = time.perf_counter(), os.times()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    rss, pss, disk = 0, 0, 0
    while process.poll() is None:
        pids = _tree(process.pid)
        rss = max(rss, sum(_field_kib(f"/proc/{pid}/status", "VmRSS:") for pid in pids))
        pss = max(pss, sum(_field_kib(f"/proc/{pid}/smaps_rollup", "Pss:") for pid in pids))
        disk = max(disk, sum(_size(folder) for folder in watched))
        time.sleep(INTERVAL_S)
    wall, after = time.perf_counter() - start, os.times()
    assert process.stdout is not None
    cpu = (after.children_user - before.children_user) + (after.children_system - before.children_system)
    return Taken(
        process.returncode, process.stdout.read(), wall, cpu, rss / 1024, pss / 1024 if pss else None, disk / 2**20
    )
