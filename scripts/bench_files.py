#!/usr/bin/env python3
"""Every STEP and IGES file of a folder the whole way: build, verify, fly, by the public commands alone.

    NURBS_OOC_DATA=… scripts/bench_files.py -o out/files [--docs docs/benchmarks.md] [FILE ...]

Each command runs in a process of its own with a time limit. A file's outcome is kept in OUT/NAME.json,
and a later run takes up what is there (``--again`` starts over). The table gives faces by status, the
reasons of all that are not exact, seconds per stage, bytes, and the worst measured share of a certified
error; one picture per file lies in OUT, all of them together in OUT/files.png.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import click
from docs_section import replace_section
from PIL import Image, ImageDraw

from nurbs_cache.store import Store
from nurbs_cache.surface_record import FaceReason, FaceStatus

SUFFIXES = (".stp", ".step", ".stpz", ".igs", ".iges", ".stp.gz", ".step.gz", ".igs.gz", ".iges.gz")
PICTURE = (320, 180)  # px, in the sheet of all files
COLUMNS = 5


def run(command: list[str], limit_s: float) -> tuple[dict[str, Any] | None, str, float]:
    """Run ``nurbs-ooc`` with ``--json``: its report (None if there is none), its last line of stderr, wall seconds."""
    start = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "nurbs_ooc", *command], capture_output=True, text=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return None, f"not done in {limit_s:.0f} s", time.perf_counter() - start
    seconds = time.perf_counter() - start
    lines = [text for text in done.stdout.splitlines() if text.startswith("{")]
    report = json.loads(lines[-1]) if lines else None
    error = "" if done.returncode == 0 else (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
    return report, error, seconds


def reasons_of(cache: Path) -> dict[str, int]:
    """How many faces are not exact, by status and reason."""
    with Store.open(cache) as store:
        rows = store.get_face_report()
    rows = rows[rows["status"] > FaceStatus.EXACT]
    counted = Counter(zip(rows["status"].tolist(), rows["reason"].tolist(), strict=True))
    return {f"{FaceStatus(s).name.lower()} {FaceReason(r).name}": n for (s, r), n in sorted(counted.items())}


def whole_way(path: Path, folder: Path, samples: int, frames: int, limit_s: float) -> dict[str, Any]:
    """Build, verify and fly one file; everything that came out."""
    cache, flight = folder / "cache", folder / "flight"
    result: dict[str, Any] = {"file": path.name, "input_bytes": path.stat().st_size, "errors": {}, "wall_s": {}}

    def step(name: str, command: list[str]) -> dict[str, Any] | None:
        report, error, seconds = run(command, limit_s)
        result["wall_s"][name] = seconds
        if error:
            result["errors"][name] = error
        return report

    result["build"] = step("build", ["build", str(path), "-o", str(cache), "--force", "--json"])
    if result["build"] is None:
        return result
    result["reasons"] = reasons_of(cache)
    result["verify"] = step("verify", ["verify", str(cache), "--samples", str(samples), "--json"])
    options = ["--size", "960x540", "--frames", str(frames), "--json"]
    result["fly"] = step("fly", ["fly", str(cache), "-o", str(flight), *options])
    pictures = sorted(flight.glob("frame_*.png"))
    if pictures:
        shutil.copy(pictures[0], folder.parent / f"{path.name}.png")
    shutil.rmtree(cache, ignore_errors=True)
    return result


HEAD = (
    "| file | faces | exact | healed | degraded | failed | read s | build s | verify s | fly s | nodes | tiles | cache "
    "| worst measured/certified | violations |\n|---|" + "--:|" * 14
)


def row(result: dict[str, Any]) -> str:
    """A file's line of the table."""
    build = result.get("build")
    if not build:
        return f"| {result['file']} | " + "| " * 13 + f"| {result['errors'].get('build', '')} |"
    faces, wall = build["faces"], result["wall_s"]
    total = sum(faces[k] for k in ("exact", "healed", "degraded", "failed"))
    verify = result.get("verify") or {}
    cells = [result["file"], total, *(faces[k] for k in ("exact", "healed", "degraded", "failed"))]
    cells += [
        f"{build['seconds'].get('read', 0.0):.1f}",
        *(f"{wall.get(k, 0):.1f}" for k in ("build", "verify", "fly")),
    ]
    cells += [build["nodes"], build["tiles"], f"{build['bytes'] / 2**20:.1f} MiB"]
    worst = verify.get("worst_measured_over_certified")
    cells += [f"{worst:.3f}" if worst is not None else "–", len(verify["violations"]) if verify else "–"]
    return "| " + " | ".join(str(c) for c in cells) + " |"


def notes(results: list[dict[str, Any]]) -> list[str]:
    """Faces that are not exact, with their reasons, and what went wrong."""
    lines = []
    for result in results:
        for reason, n in result.get("reasons", {}).items():
            lines.append(f"- {result['file']}: {n} {reason}")
        for stage, error in result["errors"].items():
            lines.append(f"- {result['file']}: {stage}: {error}")
    return lines


def contact_sheet(results: list[dict[str, Any]], folder: Path) -> None:
    """All pictures on one sheet, with their names."""
    found = [r["file"] for r in results if (folder / f"{r['file']}.png").exists()]
    if not found:
        return
    width, height = PICTURE
    rows = -(-len(found) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * width, rows * (height + 16)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, name in enumerate(found):
        x, y = i % COLUMNS * width, i // COLUMNS * (height + 16)
        with Image.open(folder / f"{name}.png") as picture:
            sheet.paste(picture.convert("RGB").resize(PICTURE, Image.Resampling.LANCZOS), (x, y))
        draw.text((x + 4, y + height + 2), name, fill="black")
    sheet.save(folder / "files.png", optimize=True)


def files_of(data: Path) -> list[Path]:
    """All STEP and IGES files of the folder and its folder ``edge``."""
    found = [*data.iterdir(), *(data / "edge").glob("*")]
    return sorted(p for p in found if p.name.lower().endswith(SUFFIXES))


@click.command()
@click.argument("files", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="Folder for outcomes and pictures.")
@click.option("--docs", type=click.Path(path_type=Path, exists=True), help="Page whose section `files` is replaced.")
@click.option("--samples", default=48, help="Samples a surface and tile for verify.")
@click.option("--frames", default=4, help="Frames of the flight.")
@click.option("--limit", default=1800.0, help="Seconds a command may take.")
@click.option("--again", is_flag=True, help="Do not take up earlier outcomes.")
def main(
    files: tuple[Path, ...], out: Path, docs: Path | None, samples: int, frames: int, limit: float, again: bool
) -> None:
    """Take FILES, or all of $NURBS_OOC_DATA, the whole way."""
    results = []
    print(HEAD)
    for path in list(files) or files_of(Path(os.environ["NURBS_OOC_DATA"])):
        folder = out / path.name
        folder.mkdir(parents=True, exist_ok=True)
        kept = out / f"{path.name}.json"
        if again or not kept.exists():
            kept.write_text(json.dumps(whole_way(path, folder, samples, frames, limit), indent=1))
        results.append(json.loads(kept.read_text()))
        print(row(results[-1]), flush=True)
    lines = notes(results)
    print("\n".join(lines))
    contact_sheet(results, out)
    if docs:
        table = "\n".join([HEAD, *(row(r) for r in results)])
        replace_section(
            docs, "files", table + "\n\nFaces that are not exact, and errors:\n\n" + "\n".join(lines or ["none"])
        )


if __name__ == "__main__":
    main()
