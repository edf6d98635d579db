"""Builds of the papers' models: seconds by stage, memory of all processes together, bytes, nodes and tiles.

    python scripts/bench_build.py golf c-class parking-lot parking-lot-unshared -o out/build
    python scripts/bench_build.py c-class --surfaces 1000 4000 16000 -o out/build
    python scripts/bench_build.py --peers 400 -o out/build --docs docs/benchmarks.md

Every build is a process of its own, start included, with two workers. Rows are kept in ``build.json`` by model and
size, a new one replaces an old one; ``build.png`` shows all that are there. ``--peers`` times Open CASCADE's mesher on
a sample of the c-class's faces for a ladder of eight levels, each half the deflection of the one before, and scales to
all faces. Models are made once and kept in the output folder.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import platform
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
from docs_section import replace_section
from process_tree import run_measured

PAPER_S = {  # hierarchy and all HLODs, Pentium 4 of 2004, paper's table 2
    "golf": 9 * 60 + 4 + 60 + 8,
    "c-class": 84 * 60 + 15 * 60,
    "parking-lot": 19 * 3600 + 26 * 60 + 4 * 3600 + 9 * 60,
}
GOALS = {"golf": (10, None), "c-class": (60, 1024), "parking-lot": (120, 1024), "parking-lot-unshared": (900, 2048)}
STAGES = ("read", "box", "hierarchy", "tables", "tessellate", "hlod", "write")
LADDER_MM = [2.0**-k for k in range(-2, 6)]  # 4 mm to 1/32 mm: what the c-class's nodes ask for
UNSHARED = "-unshared"


def model_file(folder: Path, model: str, surfaces: int | None) -> Path:
    """The surface store of a model, made if it is not there."""
    path = folder / f"{model}{f'-{surfaces}' if surfaces else ''}.nurbs"
    if not path.exists():
        command = [sys.executable, "-m", "nurbs_ooc", "synth", model.removesuffix(UNSHARED), "-o", str(path)]
        command += ["--unshared"] if model.endswith(UNSHARED) else []
        command += ["--surfaces", str(surfaces)] if surfaces else []
        if run_measured(command, []).exit_code:
            raise SystemExit(f"{path}: could not be made")
    return path


def bench(folder: Path, model: str, surfaces: int | None, workers: int, memory: str) -> dict[str, Any]:
    """Build one model and tell what it took."""
    source, cache = model_file(folder, model, surfaces), folder / "bench.cache"
    spill = cache.with_name(cache.name + ".spill")
    command = [sys.executable, "-m", "nurbs_ooc", "build", str(source), "-o", str(cache), "--force", "--json"]
    taken = run_measured([*command, "--workers", str(workers), "--memory", memory], [spill])
    if taken.exit_code:
        raise SystemExit(f"{model}: the build ended with {taken.exit_code}")
    report = json.loads(taken.stdout)
    shutil.rmtree(cache)
    kept = ("surfaces", "placed_surfaces", "occurrences", "materials", "nodes", "tiles", "triangles", "lines", "points")
    return {
        "model": model,
        **{name: report[name] for name in (*kept, "tile_bytes", "bytes", "certified_error_mm", "seconds", "workers")},
        **{name: value for name, value in dataclasses.asdict(taken).items() if name not in ("exit_code", "stdout")},
        "memory_budget": memory,
        "machine": f"{os.cpu_count()} x {platform.machine()}",
        "load_before": os.getloadavg()[0],
    }


def bench_peer(folder: Path, n_faces: int) -> dict[str, Any]:
    """CPU seconds of Open CASCADE's mesher for the ladder, on parts with about ``n_faces`` faces together."""
    from nurbs_cache.store import Store
    from nurbs_ooc.accuracy.open_cascade_mesh import build_shape, mesh_shape

    seconds, faces = 0.0, 0
    with Store.open(model_file(folder, "c-class", None)) as store:
        total = sum(info.n_surfaces for info in store.part_infos())
        for part in np.random.default_rng(0).permutation(len(store.part_infos())).tolist():
            if faces >= n_faces:
                break
            shape = build_shape(store.get_part(part))
            faces += len(shape.faces)
            seconds += sum(mesh_shape(shape, deflection)[1] for deflection in LADDER_MM)
    return {"faces": faces, "cpu_s": seconds, "deflections_mm": LADDER_MM, "all_faces": total,
            "scaled_cpu_s": seconds * total / faces}  # fmt: skip


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Time, memory and bytes against the number of surfaces; bytes and time logarithmic."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(13, 4), constrained_layout=True)
    columns = [("cpu_s", "processor time of all processes, s", 1.0), ("peak_pss_mib", "peak memory, MiB", 1.0),
               ("bytes", "cache, MiB", 2.0**-20)]  # fmt: skip
    for axis, (name, label, factor) in zip(axes, columns, strict=True):
        for model in sorted({row["model"] for row in rows}):
            own = sorted((row["placed_surfaces"], row[name] * factor) for row in rows if row["model"] == model)
            axis.plot(*zip(*own, strict=True), marker="o", label=model)
        axis.set(xscale="log", yscale="log", xlabel="placed surfaces", ylabel=label)
        axis.grid(visible=True, which="both", alpha=0.25)
    low, high = min(row["placed_surfaces"] for row in rows), max(row["placed_surfaces"] for row in rows)
    each = max(rows, key=lambda row: row["surfaces"])
    ends = [low * each["cpu_s"] / each["surfaces"], high * each["cpu_s"] / each["surfaces"]]
    axes[0].plot([low, high], ends, "k:", label="linear")
    axes[1].set_yscale("linear")
    axes[1].set_ylim(bottom=0)
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def table(rows: list[dict[str, Any]], peer: dict[str, Any] | None) -> str:
    """The rows as Markdown."""
    head = ["model", "surfaces placed", "stored", *(f"{stage} s" for stage in STAGES), "total s", "CPU s", "goal s",
            "paper 2004 s", "peak MiB: PSS, RSS", "spill MiB", "nodes", "tiles MiB", "cache MiB"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    for row in sorted(rows, key=lambda row: (row["placed_surfaces"], row["model"])):
        full = row["model"] if row["full_size"] else ""
        goal, paper = GOALS.get(full, ("",))[0], PAPER_S.get(full.removesuffix(UNSHARED), "")
        cells = [row["model"], row["placed_surfaces"], row["surfaces"],
                 *(f"{row['seconds'].get(stage, 0.0):.1f}" for stage in STAGES),
                 f"**{row['wall_s']:.1f}**", f"{row['cpu_s']:.0f}", goal, paper,
                 f"{row['peak_pss_mib'] or 0:.0f}, {row['peak_rss_mib']:.0f}",
                 f"{row['peak_disk_mib']:.0f}", row["nodes"], f"{row['tile_bytes'] / 2**20:.0f}",
                 f"{row['bytes'] / 2**20:.0f}"]  # fmt: skip
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    text = "\n".join(lines)
    if rows:
        load = max(row["load_before"] for row in rows)
        text += (
            f"\n\nMachine: {rows[-1]['machine']}, {rows[-1]['workers']} workers; load before builds: up to {load:.1f}."
        )
    if peer:
        text += (
            f"\n\nOpen CASCADE's mesher took {peer['cpu_s']:.1f} s of processor time for {peer['faces']} faces of the "
            f"c-class at {len(peer['deflections_mm'])} deflections from {max(peer['deflections_mm']):g} to "
            f"{min(peer['deflections_mm']):g} mm; scaled to its {peer['all_faces']} stored faces that is "
            f"{peer['scaled_cpu_s']:.0f} s, for the meshes alone."
        )
    return text


def main() -> None:
    """Run the models that are named; write JSON, plot and table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", choices=[[], *GOALS], default=[])
    parser.add_argument("--surfaces", type=int, nargs="+", default=[None], help="sizes instead of the paper's")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--memory", default="1GiB")
    parser.add_argument("--peers", type=int, default=0, metavar="FACES", help="faces for Open CASCADE's mesher")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--docs", type=Path, help="page whose section 'build' gets the table")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    results = arguments.output / "build.json"
    found: dict[str, Any] = (
        json.loads(results.read_text()) if results.exists() else {"builds": {}, "open_cascade": None}
    )
    for model in arguments.models:
        for surfaces in arguments.surfaces:
            row = bench(arguments.output, model, surfaces, arguments.workers, arguments.memory)
            found["builds"][f"{model} {surfaces or 'full'}"] = {**row, "full_size": surfaces is None}
            results.write_text(json.dumps(found, indent=2) + "\n")
            seconds = {stage: round(s, 1) for stage, s in row["seconds"].items()}
            print(f"{model}: {row['wall_s']:.1f} s, CPU {row['cpu_s']:.1f} s, {row['peak_rss_mib']:.0f} MiB, {seconds}")
    if arguments.peers:
        found["open_cascade"] = bench_peer(arguments.output, arguments.peers)
        results.write_text(json.dumps(found, indent=2) + "\n")
    rows = list(found["builds"].values())
    if rows:
        plot(rows, arguments.output / "build.png")
    text = table(rows, found["open_cascade"])
    print(text)
    if arguments.docs:
        replace_section(arguments.docs, "build", text)


if __name__ == "__main__":
    main()
