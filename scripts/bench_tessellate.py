#!/usr/bin/env python3
"""Our tessellator beside Open CASCADE's mesher: same faces, same deflections, one core each, one run.

    NURBS_OOC_DATA=… scripts/bench_tessellate.py [MODEL ...] [--out bench.json]

For every model and deflection: CPU seconds (median of the warm runs, and the first call by itself),
faces/s, triangles/s, triangles, and the largest sampled distance of the exact surfaces to the
triangles of their face. Ours is measured by ``nurbs_ooc.measure`` (samples over the whole trimmed face,
boundary included, the worst climb). Theirs is measured more kindly: points of Open CASCADE's own
surface at parameters inside its own triangles, to the nearest of the face's triangles, no climbing.
"""

from __future__ import annotations

import gzip
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
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np
from docs_section import replace_section

from nurbs_cache.surface_record import FaceStatus, GeometryBatch
from nurbs_ooc.measure.attack_mesh import attack_mesh
from nurbs_ooc.measure.closest import ClosestPrimitive
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.mesh_sampler import sample_triangles
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
CAR_BODY_MM = (5.0, 0.5, 0.1)
ANGLE = 0.5  # rad, Open CASCADE's angular deflection: its usual default, it always applies one


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


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Open CASCADE writes to the file descriptor itself."""
    sys.stdout.flush()
    keep, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(keep, 1)
        os.close(keep)
        os.close(null)


# Open CASCADE.


def read_shape(path: Path) -> Any:
    """The whole file as one shape, in mm."""
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader

    suffixes = [s for s in path.suffixes if s != ".gz"]
    reader = IGESControl_Reader() if suffixes[-1].lower() in (".igs", ".iges") else STEPControl_Reader()
    with tempfile.TemporaryDirectory() as folder, quiet_stdout():
        plain = path
        if path.suffix == ".gz":
            plain = Path(folder) / path.stem
            plain.write_bytes(gzip.decompress(path.read_bytes()))
        reader.ReadFile(str(plain))
        reader.TransferRoots()
        return reader.OneShape()


def faces_of(shape: Any) -> list[Any]:
    """Its faces, each shared one once."""
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    cast = TopoDS.Face_s if hasattr(TopoDS, "Face_s") else TopoDS.Face
    faces: dict[int, Any] = {}
    explorer = TopExp_Explorer(shape, TopAbs_FACE)
    while explorer.More():
        face = explorer.Current().Located(TopLoc_Location())
        faces.setdefault(hash(face), cast(face))
        explorer.Next()
    return list(faces.values())


def mesh_theirs(shape: Any, deflection: float) -> None:
    """Mesh from nothing."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools

    BRepTools.Clean_s(shape)
    BRepMesh_IncrementalMesh(shape, deflection, False, ANGLE, False)


def triangulation(face: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Nodes (n, 3), their parameters (n, 2) and triangles (t, 3) of a meshed face, in its own place."""
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
    if mesh is None or mesh.NbTriangles() == 0:
        return None
    n = range(1, mesh.NbNodes() + 1)
    xyz = np.array([(p.X(), p.Y(), p.Z()) for p in (mesh.Node(i) for i in n)])
    uv = np.array([(p.X(), p.Y()) for p in (mesh.UVNode(i) for i in n)])
    return xyz, uv, np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]) - 1


def attack_theirs(faces: list[Any], samples: int, seed: int) -> dict[str, Any]:
    """Sample their own surfaces inside their own triangles."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    rng = np.random.default_rng(seed)
    worst, triangles, lost, total = 0.0, 0, 0, 0
    for face in faces:
        mesh = triangulation(face)
        if mesh is None:
            lost += 1
            continue
        xyz, uv, t = mesh
        triangles += len(t)
        e1, e2 = uv[t[:, 1]] - uv[t[:, 0]], uv[t[:, 2]] - uv[t[:, 0]]
        areas = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])
        _, pick, weight = sample_triangles(areas, np.array([0, len(t)]), samples, rng)
        inside = weight.max(1) < 1.0
        at = np.einsum("nk,nki->ni", weight[inside], uv[t[pick[inside]]])
        surface = BRepAdaptor_Surface(face, False)
        points = np.array([(p.X(), p.Y(), p.Z()) for p in (surface.Value(u, v) for u, v in at)])
        distance, _ = ClosestPrimitive(xyz, t).query(points)
        worst, total = max(worst, float(distance.max())), total + len(points)
    return {"triangles": triangles, "lost_faces": lost, "samples": total, "error_mm": worst}


# Ours.


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
    return {
        "triangles": int(sum(len(m.triangles) for m in meshes)),
        "statuses": {s.name.lower(): int((status == s).sum()) for s in FaceStatus},
        "samples": sum(f["samples"] for f in found),
        "error_mm": max(f["surface_to_mesh_max_mm"] for f in found),
        "back_mm": max(f["mesh_to_surface_max_mm"] for f in found),
        "certified_mm": max(f["certified_max_mm"] for f in found),
        "faces_over_request": sum(f["faces_over_request"] for f in found),
        "median_certified_over_measured": float(np.median(tight[shown])) if shown.any() else None,
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
        warm = [timed(lambda d=deflection: mesh_ours(parts, d))[1] for _ in range(runs)]
        ours = {"first_call_s": first, "s": statistics.median(warm)}
        _, first = timed(lambda d=deflection: mesh_theirs(shape, d))
        warm = [timed(lambda d=deflection: mesh_theirs(shape, d))[1] for _ in range(runs)]
        theirs = {"first_call_s": first, "s": statistics.median(warm)}
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
        ours = statistics.median(timed(lambda d=deflection: tessellate(geometry, d))[1] for _ in range(2 * runs))
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


def car_body_line(row: dict[str, Any]) -> str:
    """One row of the car body's table, in Markdown."""
    cells = [f"{row['deflection_mm']:g}", row["faces"], row["triangles"], f"{row['faces_per_s']:.0f}"]
    cells += [f"{row['two_threads']:.2f}×", f"{row['error_over_deflection']:.2f}", len(row["violations"])]
    return "| " + " | ".join(str(c) for c in cells) + " |"


CAR_BODY_HEAD = (
    "| car body, deflection mm | faces | triangles | faces/s, one core | two threads beside one "
    "| error / deflection | violations |\n|--:|--:|--:|--:|--:|--:|--:|"
)

HEAD = (
    f"{'model':28}{'defl/diag':>10} |{'faces/s':>9}{'ktri/s':>8}{'tri':>9}{'err/defl':>9}{'viol':>5}"
    f" |{'OCC f/s':>9}{'ktri/s':>8}{'tri':>9}{'err/defl':>9} |{'speed':>7}{'tri ratio':>10}{'equal err':>10}"
)


def line(row: dict[str, Any]) -> str:
    """One row of the printed table."""
    a, b = row["ours"], row["open_cascade"]
    cells = [f"{row['model'][:27]:28}{row['deflection_over_diagonal']:10.0e} |"]
    for side in (a, b):
        cells.append(f"{side['faces_per_s']:9.0f}{side['triangles_per_s'] / 1e3:8.0f}{side['triangles']:9d}")
        cells.append(f"{side['error_over_deflection']:9.2f}")
        cells.append(f"{len(a['violations']):5d} |" if side is a else " |")
    cells.append(f"{row['speedup']:6.1f}x{a['triangles'] / max(1, b['triangles']):10.2f}")
    cells.append(f"{row['ours_at_their_error']['triangles'] / max(1, b['triangles']):10.2f}")
    return "".join(cells)


MARKDOWN_HEAD = (
    "| model | faces | deflection / diagonal | faces/s, ours | theirs | faster | triangles, ours | theirs "
    "| ours/theirs | at equal measured error | error / deflection, ours | theirs | violations "
    "| certified/measured, median | first call s, ours | theirs |\n|---|" + "--:|" * 15
)


def markdown(result: dict[str, Any]) -> str:
    """The rows as a Markdown table with the machine's line."""
    cpu = result["machine"]
    fresh = result["fresh_process"]
    lines = [f"{cpu['cpu']}, one of {cpu['cores']} cores, Python {cpu['python']}. First call in a fresh process with"]
    lines += [f"compiled kernels, imports included: {fresh['wall_s']:.1f} s wall, {fresh['cpu_s']:.1f} s CPU.", ""]
    lines.append(MARKDOWN_HEAD)
    for r in result["rows"]:
        a, b = r["ours"], r["open_cascade"]
        cells = [r["model"], a["faces"], f"{r['deflection_over_diagonal']:.0e}", f"{a['faces_per_s']:.0f}"]
        cells += [f"{b['faces_per_s']:.0f}", f"{r['speedup']:.1f}×", a["triangles"], b["triangles"]]
        equal = r["ours_at_their_error"]["triangles"]
        cells += [f"{n / max(1, b['triangles']):.2f}" for n in (a["triangles"], equal)]
        cells += [f"{a['error_over_deflection']:.2f}", f"{b['error_over_deflection']:.2f}", len(a["violations"])]
        cells.append(f"{a['median_certified_over_measured']:.2f}")
        cells += [f"{side['first_call_s']:.2f}" for side in (a, b)]
        lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    samples = sum(r["ours"]["samples"] for r in result["rows"]) + sum(r["samples"] for r in result["car_body"])
    lines += ["", f"{samples:,} distances were measured on our meshes.", "", CAR_BODY_HEAD]
    return "\n".join([*lines, *map(car_body_line, result["car_body"])])


@click.command()
@click.argument("models", nargs=-1)
@click.option("--out", type=click.Path(path_type=Path), help="Write everything as JSON.")
@click.option("--deflection", "shares", multiple=True, type=float, default=[1e-3, 1e-4], help="Share of the diagonal.")
@click.option("--runs", default=3, help="Warm runs, of which the median counts.")
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
