#!/usr/bin/env python3
"""Every STEP and IGES file of a folder the whole way: build, verify, fly, by the public commands alone.

    NURBS_OOC_DATA=… scripts/bench_files.py -o out/files [--docs docs/benchmarks.md] [FILE ...]

Small files come first. Each command runs in a process group of its own with a time limit; what fails or
takes too long is a row of the table, not the end. A file's outcome is kept in OUT/NAME.json, and a later
run takes up what is there: stop it when you like. ``--again`` starts over, ``--retry`` repeats files with
an error.

OUT/files.md has the table; OUT/faces.csv names every face that is not exact, with its reason and error;
OUT/NAME.png is the contact sheet of a file's flight, OUT/files.png one picture of each.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
from docs_section import replace_section
from PIL import Image, ImageDraw

from nurbs_cache.errors import NurbsOocError
from nurbs_cache.store import Store
from nurbs_cache.surface_record import FaceReason, FaceStatus

SUFFIXES = (".stp", ".step", ".stpz", ".igs", ".iges", ".stp.gz", ".step.gz", ".igs.gz", ".iges.gz")
PICTURE = (320, 180)  # px, in the sheet of all files
COLUMNS = 5
GRACE_S = 10.0  # from the polite end of a command to the hard one

Json = dict[str, Any]


def run(command: list[str], limit_s: float) -> tuple[Json | None, str, float]:
    """Run ``nurbs-ooc`` with ``--json``: its report (None if there is none), its last line of stderr, wall seconds."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "nurbs_ooc", *command, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        end(process)
        return None, f"not done in {limit_s:.0f} s", time.perf_counter() - start
    except BaseException:
        end(process)
        raise
    lines = [text for text in out.splitlines() if text.startswith("{")]
    report = json.loads(lines[-1]) if lines else None
    error = "" if process.returncode == 0 else (err.strip().splitlines() or [f"exit {process.returncode}"])[-1]
    return report, error, time.perf_counter() - start


def end(process: subprocess.Popen[str]) -> None:
    """End a command with all its children: as Ctrl-C would, then for good."""
    for number in (signal.SIGINT, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.communicate(timeout=GRACE_S)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def faces_of(cache: Path) -> list[list[Any]]:
    """Every face that is not exact: name in the file, status, reason, certified error in mm."""
    with Store.open(cache) as store:
        rows = store.get_face_report()
        rows = rows[rows["status"] > FaceStatus.EXACT]
        out, parts = [], {}
        for row in rows:
            part, at = store.locate_surface(int(row["surface"]))
            if part not in parts:
                parts = {part: store.get_part(part)}  # faces come part after part
            source = int(parts[part].surfaces["source"][at])
            name = parts[part].sources[source] if 0 <= source < len(parts[part].sources) else f"part {part} face {at}"
            status, reason = FaceStatus(row["status"]).name.lower(), FaceReason(row["reason"]).name
            out.append([name, status, reason, float(row["certified"])])
    return out


def whole_way(path: Path, folder: Path, samples: int, frames: int, limit_s: float) -> Json:
    """Build, verify and fly one file; everything that came out. The cache is removed."""
    cache, flight = folder / "cache", folder / "flight"
    result: Json = {"file": path.name, "input_bytes": path.stat().st_size, "errors": {}, "wall_s": {}}

    def step(name: str, command: list[str]) -> Json | None:
        report, error, seconds = run(command, limit_s)
        result["wall_s"][name] = seconds
        if error:
            result["errors"][name] = error.removeprefix("nurbs-ooc: ").replace(str(path), path.name)
        return report

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    result["build"] = step("build", ["build", str(path), "-o", str(cache)])
    if result["build"] is not None:
        try:
            result["not_exact"] = faces_of(cache)
        except NurbsOocError as error:
            result["errors"]["report"] = str(error)
        result["verify"] = step("verify", ["verify", str(cache), "--samples", str(samples)])
        options = ["--size", "960x540", "--frames", str(frames)]
        result["fly"] = step("fly", ["fly", str(cache), "-o", str(flight), *options])
        pictures = {"frame_00000.png": f"{path.name}.first.png", "contact_sheet.png": f"{path.name}.png"}
        for name, kept in pictures.items():
            for found in sorted(flight.glob(name)):
                shutil.copy(found, folder.parent / kept)
    shutil.rmtree(folder, ignore_errors=True)
    return result


HEAD = (
    "| file | faces | exact | healed | degraded | failed | read s | build s | verify s | fly s | nodes | triangles "
    "| cache MiB | worst measured/certified | violations | undecided |\n|---|" + "--:|" * 15
)


def row(result: Json) -> str:
    """A file's line of the table; an empty cell is what there is not."""
    build, verify, wall = result.get("build") or {}, result.get("verify") or {}, result["wall_s"]
    faces = build.get("faces", {})
    cells = [result["file"], *(faces.get(k, "") for k in ("read", "exact", "healed", "degraded", "failed"))]
    cells.append(f"{build['seconds'].get('read', 0.0):.1f}" if build else "")
    cells += [f"{wall[k]:.1f}" if k in wall else "" for k in ("build", "verify", "fly")]
    cells += [build.get("nodes", ""), build.get("triangles", ""), f"{build['bytes'] / 2**20:.1f}" if build else ""]
    worst = verify.get("worst_measured_over_certified")
    cells += ["" if worst is None else f"{worst:.3f}", len(verify["violations"]) if verify else ""]
    cells.append(verify.get("undecided", ""))
    return "| " + " | ".join(str(c) for c in cells) + " |"


def notes(results: list[Json]) -> list[str]:
    """Faces that are not exact, counted by reason, and what went wrong."""
    lines = []
    for result in results:
        reasons = (result.get("build") or {}).get("face_reasons", {})
        if reasons:
            lines.append(f"- {result['file']}: " + ", ".join(f"{n} {reason}" for reason, n in reasons.items()))
        lines += [f"- {result['file']}: **{stage}**: {error}" for stage, error in result["errors"].items()]
    return lines


def page(results: list[Json]) -> str:
    """The table with its notes."""
    total = sum(sum(result["wall_s"].values()) for result in results)
    head = f"{len(results)} files in {total / 60:.1f} min, {os.cpu_count()} processors ({platform.machine()})."
    table = "\n".join([HEAD, *(row(result) for result in results)])
    return f"{head}\n\n{table}\n\nFaces that are not exact, and errors:\n\n" + "\n".join(notes(results) or ["none"])


def write_faces(results: list[Json], path: Path) -> None:
    """Every face that is not exact as a row."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "face", "status", "reason", "certified_error_mm"])
        for result in results:
            writer.writerows([result["file"], *face] for face in result.get("not_exact", []))


def contact_sheet(results: list[Json], folder: Path) -> None:
    """First pictures of all files on one sheet, with their names."""
    found = [r["file"] for r in results if (folder / f"{r['file']}.first.png").exists()]
    if not found:
        return
    width, height = PICTURE
    rows = -(-len(found) // COLUMNS)
    sheet = Image.new("RGB", (min(COLUMNS, len(found)) * width, rows * (height + 16)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, name in enumerate(found):
        x, y = i % COLUMNS * width, i // COLUMNS * (height + 16)
        with Image.open(folder / f"{name}.first.png") as picture:
            sheet.paste(picture.convert("RGB").resize(PICTURE, Image.Resampling.LANCZOS), (x, y))
        draw.text((x + 4, y + height + 2), name, fill="black")
    sheet.save(folder / "files.png", optimize=True)


def files_of(data: Path) -> list[Path]:
    """All STEP and IGES files of the folder and its folder ``edge``, the smallest first."""
    found = [*data.iterdir(), *(data / "edge").glob("*")]
    return sorted((p for p in found if p.name.lower().endswith(SUFFIXES)), key=lambda p: (unpacked_bytes(p), p.name))


def unpacked_bytes(path: Path) -> int:
    """Bytes of a file, of a gzipped one what its last four bytes say."""
    if path.name.lower().endswith((".gz", ".stpz")):
        with path.open("rb") as file:
            file.seek(-4, os.SEEK_END)
            return int.from_bytes(file.read(4), "little")
    return path.stat().st_size


@click.command()
@click.argument("files", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="Folder for outcomes and pictures.")
@click.option("--docs", type=click.Path(path_type=Path, exists=True), help="Page whose section `files` is replaced.")
@click.option("--samples", default=300_000, show_default=True, help="Points that verify measures in a file.")
@click.option("--frames", default=4, show_default=True, help="Frames of the flight.")
@click.option("--limit", default=180.0, show_default=True, help="Seconds a command may take.")
@click.option("--again", is_flag=True, help="Do not take up earlier outcomes.")
@click.option("--retry", is_flag=True, help="Take up only earlier outcomes without an error.")
def main(
    files: tuple[Path, ...],
    out: Path,
    docs: Path | None,
    samples: int,
    frames: int,
    limit: float,
    again: bool,
    retry: bool,
) -> None:
    """Take FILES, or all of $NURBS_OOC_DATA, the whole way."""
    out.mkdir(parents=True, exist_ok=True)
    results: list[Json] = []
    print(HEAD)
    for path in list(files) or files_of(Path(os.environ["NURBS_OOC_DATA"])):
        kept = out / f"{path.name}.json"
        result = json.loads(kept.read_text()) if kept.exists() and not again else None
        if result is None or (retry and result["errors"]):
            result = whole_way(path, out / f"{path.name}.work", samples, frames, limit)
            kept.write_text(json.dumps(result, indent=1))
        results.append(result)
        print(row(result), flush=True)
        # What there is so far, in case this is stopped.
        (out / "files.md").write_text(page(results) + "\n", encoding="utf-8")
        write_faces(results, out / "faces.csv")
    contact_sheet(results, out)
    print("\n".join(notes(results)))
    if docs:
        replace_section(docs, "files", page(results))


if __name__ == "__main__":
    main()
