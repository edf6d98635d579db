#!/usr/bin/env python3
"""Every hard case of tests/hard through our tessellator and through Open CASCADE's mesher, side by side.

    scripts/bench_hard.py [CASE ...] [--docs docs/hard_cases.md] [--out hard.json]

Each case is tessellated at its middle error, in a child process that is stopped after ``--limit`` seconds;
both meshes are measured alike by ``nurbs_ooc.accuracy.measured``: samples of the exact trimmed faces to the
triangles, the worst climb, and points of the triangles back to the faces. Time is CPU seconds, the better of two
runs. "Wrong" counts what contradicts the closed form of the case (area, volume, Euler number, components).
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
from docs_section import replace_section

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from nurbs_cache.errors import NurbsOocError
from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.accuracy.measured import measure_mesh
from nurbs_ooc.accuracy.open_cascade_mesh import build_shape, mesh_shape
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate
from tests.hard.case import HardCase
from tests.hard.catalogue import CASES, DEGENERATE
from tests.hard.judge import judge
from tests.hard.variants import PLAIN

SAMPLES = 200
RUNS = 2
CODE_WORDS = ("status", "certified", "vertex normals")  # lines of the judge that are about promises, not shape


Note = Callable[[dict[str, Any]], None]


def in_child(work: Callable[[Note], dict[str, Any]], limit_s: float) -> dict[str, Any]:
    """What ``work`` returns, in a fork that may hang or crash; what it notes on its way tells how far it came."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)

        def note(found: dict[str, Any]) -> None:
            os.write(write, json.dumps(found).encode() + b"\n")

        try:
            note(work(note))
        except BaseException as error:  # noqa: BLE001 - whatever it is, the parent's table shows it
            note({"failed": f"{type(error).__name__}: {error}"[:120]})
        os._exit(0)
    os.close(write)
    start, stopped = time.monotonic(), False
    while not os.waitpid(child, os.WNOHANG)[0]:
        if time.monotonic() - start > limit_s:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            stopped = True
            break
        time.sleep(0.01)
    with os.fdopen(read, encoding="utf-8") as pipe:
        lines = [json.loads(line) for line in pipe]
    if lines and "meshed_s" not in lines[-1]:
        return dict(lines[-1])
    if lines:
        return {"failed": f"meshed in {1e3 * lines[-1]['meshed_s']:.0f} ms, not measured in {limit_s:g} s"}
    return {"failed": f"did not end in {limit_s:g} s" if stopped else "crashed"}


def ours(geometry: GeometryBatch, error: float) -> tuple[MeshBatch, float]:
    """Our mesh and its CPU seconds."""
    start = time.process_time()
    mesh = tessellate(geometry, error)
    return mesh, time.process_time() - start


def theirs(geometry: GeometryBatch, error: float) -> tuple[MeshBatch, float]:
    """Open CASCADE's mesh of the same faces and its CPU seconds."""
    return mesh_shape(build_shape(geometry), error)


def run(
    case: HardCase, mesher: Callable[[GeometryBatch, float], tuple[MeshBatch, float]], note: Note
) -> dict[str, Any]:
    """Mesh, measure, judge."""
    geometry, error = case.geometry(), case.errors[len(case.errors) // 2]
    made = [mesher(geometry, error) for _ in range(RUNS)]
    mesh, seconds = made[-1][0], min(s for _, s in made)
    note({"meshed_s": seconds})
    found = measure_mesh(geometry, mesh, error, False, SAMPLES, 0)
    wrong = [line for line in judge(case, PLAIN, error, mesh) if not line.startswith(CODE_WORDS)]
    return {
        "error_mm": error,
        "lost": found.lost,
        "over": float(found.largest.max(initial=0.0)) / error,
        "floor": case.floor / error,
        "triangles": len(mesh.triangles),
        "seconds": seconds,
        "wrong": wrong,
    }


def run_degenerate(name: str, mesher: Callable[[GeometryBatch, float], tuple[MeshBatch, float]]) -> dict[str, Any]:
    """What becomes of a bad face."""
    try:
        mesh, _ = mesher(DEGENERATE[name].geometry(), 1e-2)
    except NurbsOocError as error:
        return {"outcome": f"refused: {error}"}
    text = f"{FaceStatus(int(mesh.status[0])).name.lower()}, {FaceReason(int(mesh.reason[0])).name.lower()}"
    if not (np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all()):
        text += ", NaN in its mesh"
    return {"outcome": f"{text}, {len(mesh.triangles)} triangles"}


def cells(found: dict[str, Any]) -> list[str]:
    """Lost, error over requested, triangles, ms, wrong."""
    if "failed" in found:
        return ["", found["failed"], "", "", ""]
    wrong = "; ".join(found["wrong"]) or "–"
    return [
        str(found["lost"]), f"{found['over']:.2f}", str(found["triangles"]), f"{1e3 * found['seconds']:.1f}",
        wrong.replace("|", "/"),
    ]  # fmt: skip


def table(rows: dict[str, dict[str, dict[str, Any]]], bad: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Both as Markdown."""
    head = ["case", "error mm"]
    for side in ("ours", "Open CASCADE"):
        head += [f"lost, {side}", "error / requested", "triangles", "ms", "wrong"]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    for name, row in rows.items():
        error = next((f"{side['error_mm']:g}" for side in row.values() if "error_mm" in side), "")
        lines.append("| " + " | ".join([name, error, *cells(row["ours"]), *cells(row["theirs"])]) + " |")
    lines += ["", "Input that is no surface:", "", "| case | ours | Open CASCADE |", "|---|---|---|"]
    for name, row in bad.items():
        outcome = [row[k].get("outcome", row[k].get("failed", "")) for k in ("ours", "theirs")]
        lines.append("| " + " | ".join([name, *outcome]) + " |")
    return "\n".join(lines)


@click.command()
@click.argument("names", nargs=-1)
@click.option("--limit", default=20.0, help="Seconds after which a case is stopped.")
@click.option("--docs", type=click.Path(path_type=Path, exists=True), help="Page whose section `hard` is replaced.")
@click.option("--out", type=click.Path(path_type=Path), help="Write everything as JSON.")
def main(names: tuple[str, ...], limit: float, docs: Path | None, out: Path | None) -> None:
    """Run the cases NAMES, or all."""
    for mesher in (ours, theirs):  # load kernels and libraries before the first fork
        run(CASES["sphere"], mesher, lambda _: None)
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    bad: dict[str, dict[str, dict[str, Any]]] = {}
    for name, case in CASES.items():
        if not names or name in names:
            rows[name] = {
                k: in_child(lambda note, c=case, m=m: run(c, m, note), limit)
                for k, m in (("ours", ours), ("theirs", theirs))
            }
            print(f"{name:34}", *(" ".join(f"{c:>12}" for c in cells(rows[name][k])) for k in rows[name]), flush=True)
    for name in DEGENERATE:
        if not names or name in names:
            sides = (("ours", ours), ("theirs", theirs))
            bad[name] = {k: in_child(lambda _, n=name, m=m: run_degenerate(n, m), limit) for k, m in sides}
            print(f"{name:34}", bad[name], flush=True)
    if out:
        out.write_text(json.dumps({"cases": rows, "degenerate": bad}, indent=1) + "\n", encoding="utf-8")
    if docs:
        replace_section(docs, "hard", table(rows, bad))


if __name__ == "__main__":
    main()
