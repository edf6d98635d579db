#!/usr/bin/env python3
"""Our tessellator beside Open CASCADE's mesher: same faces, same deflections, one core each, one run.

    NURBS_OOC_DATA=… scripts/bench_tessellate.py [MODEL ...] [--out bench.json]

For every model and deflection: CPU seconds (median of the warm runs, and the first call by itself),
faces/s, triangles/s, triangles, and the largest sampled distance of the exact surfaces to the
triangles of their face. Ours is measured by ``nurbs_ooc.measure`` (samples over the whole trimmed face,
boundary included, the worst climb), theirs more kindly (see ``open_cascade_peer``).
"""

from __future__ import annotations

import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
from docs_section import replace_section
from open_cascade_peer import ANGLE, attack_theirs, faces_of, mesh_theirs, read_shape
from tessellate_tables import CAR_BODY_HEAD, HEAD, car_body_line, line, markdown

from nurbs_cache.surface_record import FaceStatus, GeometryBatch
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.trim_region import TrimRegion

MODELS = (
    "d150_aircraft.step.gz",
    "nist_mbe_pmi_2.stp.gz",
    "occt_bearing.iges.gz",
    "tigl_nacelle.stp",
    "pygeo_fan_surfaces.igs",
    "occ_top_housing.step.gz",
    "trackball_assembly.step.gz",
    "occt_hammer.iges",
    "occt_linkrods.step.gz",
)
COARSEST = 20.0  # times the deflection: where theirs has lost its surface, ours is not made as bad
WARM_S = 0.3  # of CPU time for the median of a model at one deflection, at least
SHOWN, GAP = 0.1, 0.1  # of the deflection: faces certified for less are flat, with larger gaps not smooth
CAR_BODY_MM = (5.0, 0.5, 0.1)


def machine() -> dict[str, Any]:
    """What the numbers were taken on."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        name = names[0] if names else name
    return {"cpu": name, "cores": os.cpu_count(), "python": platform.python_version(), "numpy": np.__version__}


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Result and CPU seconds of this process."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def warm(call: Callable[[], Any], runs: int) -> float:
    """Median CPU seconds of ``runs`` calls, and of more while they are over in no time."""
    seconds: list[float] = []
    while len(seconds) < runs or sum(seconds) < WARM_S:
        seconds.append(timed(call)[1])
    return statistics.median(seconds)


def read_ours(path: Path) -> list[GeometryBatch]:
    """The parts' geometry."""
    from nurbs_ooc.readers import open_assembly

    with open_assembly(path) as assembly:
        return [part.geometry for part in assembly.parts()]


def diagonal(parts: list[GeometryBatch], seed: int) -> float:
    """Of the box around all surfaces' samples, mm: the largest part's, so that placements do not matter."""
    largest = 0.0
    for geometry in parts:
        if len(geometry):
            samples = sample_faces(TrimRegion(geometry, np.arange(len(geometry)), 1.0), 40, seed)
            points = samples.points[np.isfinite(samples.points).all(1)]
            largest = max(largest, float(np.linalg.norm(np.ptp(points, axis=0))))
    return largest


def mesh_ours(parts: list[GeometryBatch], deflection: float) -> list[Any]:
    """Tessellate every part on one core."""
    from nurbs_ooc.tessellation.tessellate import tessellate

    return [tessellate(geometry, deflection, workers=1) for geometry in parts if len(geometry)]


def first_call(model: Path, share: float) -> dict[str, float]:
    """Seconds of a fresh process from importing the tessellator to its first mesh, with kernels compiled before."""
    code = (
        "import sys, time; from pathlib import Path; from nurbs_cache.surface_record import GeometryBatch\n"
        "g = GeometryBatch.from_bytes(Path(sys.argv[1]).read_bytes())\n"
        "a, b = time.perf_counter(), time.process_time()\n"
        "from nurbs_ooc.tessellation.tessellate import tessellate\n"
        "tessellate(g, float(sys.argv[2])); print(time.perf_counter() - a, time.process_time() - b)"
    )
    parts = [g for g in read_ours(model) if len(g)]
    with tempfile.NamedTemporaryFile() as record:
        record.write(parts[0].to_bytes())
        record.flush()
        command = [sys.executable, "-c", code, record.name, str(share * diagonal(parts, 0))]
        subprocess.run(command, check=True, capture_output=True)  # fills the kernel cache
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    wall, cpu = map(float, done.stdout.split())
    return {"wall_s": wall, "cpu_s": cpu}


def attack_ours(
    parts: list[GeometryBatch], meshes: list[Any], deflection: float, samples: int, seed: int
) -> dict[str, Any]:
    """The full attack on every part."""
    geometry = [g for g in parts if len(g)]
    reports = [attack_mesh(g, m, samples, seed, deflection) for g, m in zip(geometry, meshes, strict=True)]
    status = np.concatenate([m.status for m in meshes])
    found = [r.as_json() for r in reports]
    tight = np.concatenate([r.certified / np.maximum(r.measured, 1e-300) for r in reports])
    shown = np.concatenate([r.measured > 1e-6 * deflection for r in reports])
    certified, gap = (np.concatenate(a) for a in ([r.certified for r in reports], [m.pcurve_error for m in meshes]))
    smooth = tight[shown & (certified - gap > SHOWN * deflection) & (gap < GAP * deflection)]
    return {
        "triangles": int(sum(len(m.triangles) for m in meshes)),
        "statuses": {s.name.lower(): int((status == s).sum()) for s in FaceStatus},
        "samples": sum(f["samples"] for f in found),
        "error_mm": max(f["surface_to_mesh_max_mm"] for f in found),
        "back_mm": max(f["mesh_to_surface_max_mm"] for f in found),
        "certified_mm": max(f["certified_max_mm"] for f in found),
        "faces_over_request": sum(f["faces_over_request"] for f in found),
        "median_certified_over_measured": float(np.median(tight[shown])) if shown.any() else None,
        "smooth_faces": len(smooth),
        "median_of_smooth": float(np.median(smooth)) if len(smooth) else None,
        "largest_of_smooth": float(smooth.max()) if len(smooth) else None,
        "undecided": sum(f["undecided"] for f in found),
        "violations": [v for f in found for v in f["violations"]],
    }


def at_their_error(
    parts: list[GeometryBatch], ours: dict[str, Any], theirs: dict[str, Any], samples: int, seed: int
) -> dict[str, Any]:
    """Our triangles when ours too may be measured as far off as theirs are."""
    goal = theirs["error_mm"]
    asked = ours["deflection_mm"] * min(goal / ours["error_mm"], COARSEST)
    while True:
        found = attack_ours(parts, mesh_ours(parts, asked), asked, samples, seed)
        if found["error_mm"] <= goal:
            return {"asked_mm": asked, "error_mm": found["error_mm"], "triangles": found["triangles"]}
        asked *= 0.9 * goal / found["error_mm"]


def compare(path: Path, shares: list[float], runs: int, samples: int, seed: int) -> Iterator[dict[str, Any]]:
    """One row per deflection."""
    shape = read_shape(path)
    their_faces, parts = faces_of(shape), read_ours(path)
    n_faces, size = sum(map(len, parts)), diagonal(parts, seed)
    for share in shares:
        deflection = share * size
        meshes, first = timed(lambda d=deflection: mesh_ours(parts, d))
        ours = {"first_call_s": first, "s": warm(lambda d=deflection: mesh_ours(parts, d), runs)}
        _, first = timed(lambda d=deflection: mesh_theirs(shape, d))
        theirs = {"first_call_s": first, "s": warm(lambda d=deflection: mesh_theirs(shape, d), runs)}
        ours |= attack_ours(parts, meshes, deflection, samples, seed)
        theirs |= attack_theirs(their_faces, samples, seed)
        for side, faces in ((ours, n_faces), (theirs, len(their_faces))):
            side |= {"faces": faces, "faces_per_s": faces / side["s"], "triangles_per_s": side["triangles"] / side["s"]}
            side["error_over_deflection"] = side["error_mm"] / deflection
            side["deflection_mm"] = deflection
        equal = at_their_error(parts, ours, theirs, samples, seed)
        yield {
            "model": path.name,
            "diagonal_mm": size,
            "deflection_over_diagonal": share,
            "deflection_mm": deflection,
            "ours": ours,
            "open_cascade": theirs,
            "ours_at_their_error": equal,
            "speedup": ours["faces_per_s"] / theirs["faces_per_s"],
        }


def threads_gain(call: Callable[[int], Any], runs: int) -> float:
    """How many times as fast two threads are as one: wall seconds, the least of runs in turns.

    What else the machine does makes runs longer, never shorter, and two threads suffer more from it than one.
    """
    least = {1: math.inf, 2: math.inf}
    for _ in range(runs):
        for workers in least:
            start = time.perf_counter()
            call(workers)
            least[workers] = min(least[workers], time.perf_counter() - start)
    return least[1] / least[2]


def car_body_rows(runs: int, samples: int, seed: int) -> Iterator[dict[str, Any]]:
    """The synthetic car body: CPU seconds of one core, wall seconds of two threads beside one."""
    from nurbs_ooc.synth.car_body import car_body
    from nurbs_ooc.tessellation.tessellate import tessellate

    geometry = car_body(seed)
    for deflection in CAR_BODY_MM:
        mesh = tessellate(geometry, deflection)
        ours = warm(lambda d=deflection: tessellate(geometry, d), 2 * runs)
        gain = threads_gain(lambda w, d=deflection: tessellate(geometry, d, workers=w), 5 * runs)
        found = attack_ours([geometry], [mesh], deflection, samples, seed)
        yield {
            "deflection_mm": deflection,
            "faces": len(geometry),
            "triangles": len(mesh.triangles),
            "faces_per_s": len(geometry) / ours,
            "two_threads": gain,
            "error_over_deflection": found["error_mm"] / deflection,
            "violations": found["violations"],
            "samples": found["samples"],
        }


@click.command()
@click.argument("models", nargs=-1)
@click.option("--out", type=click.Path(path_type=Path), help="Write everything as JSON.")
@click.option("--deflection", "shares", multiple=True, type=float, default=[1e-3, 1e-4], help="Share of the diagonal.")
@click.option("--runs", default=3, help="Warm runs, of which the median counts, at least.")
@click.option("--samples", default=300, help="Samples a face and direction.")
@click.option("--seed", default=0)
@click.option(
    "--docs", type=click.Path(path_type=Path, exists=True), help="Page whose section `tessellate` is replaced."
)
def main(
    models: tuple[str, ...],
    out: Path | None,
    shares: list[float],
    runs: int,
    samples: int,
    seed: int,
    docs: Path | None,
) -> None:
    """Compare on MODELS (paths, or names in $NURBS_OOC_DATA)."""
    data = Path(os.environ.get("NURBS_OOC_DATA", "."))
    result: dict[str, Any] = {"machine": machine(), "angle_rad": ANGLE, "runs": runs, "samples": samples, "rows": []}
    result["car_body"] = []
    print(json.dumps(result["machine"]))
    paths = [Path(name) if Path(name).exists() else data / name for name in models or MODELS]
    result["fresh_process"] = first_call(next(p for p in paths if p.exists()), shares[0])
    print(f"first call in a fresh process: {result['fresh_process']}")
    print(HEAD, flush=True)
    for path in paths:
        if not path.exists():
            print(f"{path}: not there, left out", file=sys.stderr)
            continue
        for row in compare(path, list(shares), runs, samples, seed):
            result["rows"].append(row)
            print(line(row), flush=True)
            if out:
                out.write_text(json.dumps(result, indent=1))
    if not models:
        print(CAR_BODY_HEAD)
        for row in car_body_rows(runs, samples // 4, seed):
            result["car_body"].append(row)
            print(car_body_line(row), flush=True)
        if out:
            out.write_text(json.dumps(result, indent=1))
    if docs:
        replace_section(docs, "tessellate", markdown(result))


if __name__ == "__main__":
    main()
