"""Whole models: the papers' counts, seeds, sharing and not, memory, and that builds take them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_cache.store import Store
from nurbs_ooc.readers import open_assembly
from nurbs_ooc.synth.presets import PRESETS
from nurbs_ooc.synth.write_store import write_synthetic
from tests.ooc.scenes import hash_of, run_build


def _write(
    path: Path, surfaces: int | None = None, seed: int = 0, *, model: str = "golf", unshared: bool = False
) -> dict:
    preset = PRESETS[model] if surfaces is None else PRESETS[model].scaled(surfaces)
    return write_synthetic(preset, seed, path, unshared=unshared, force=False, advance=lambda _: None)


def _placed(path: Path) -> dict[str, float]:
    """Totals counted from the store itself."""
    with Store.open(path) as store:
        uses = np.bincount(store.get_occurrences()["part"], minlength=len(store.part_infos()))
        surfaces = [store.get_part(part).surfaces for part in range(len(uses))]
        materials = len(store.get_materials())
    weights = np.repeat(uses, [len(s) for s in surfaces])
    s = np.concatenate(surfaces)
    return {
        "surfaces": int(weights.sum()),
        "control_points": int((weights * s["n_u"] * s["n_v"]).sum()),
        "rational": float((weights * s["rational"]).sum() / weights.sum()),
        "holed": float((weights * (s["n_loops"] > 1)).sum() / weights.sum()),
        "degrees": sorted(set(s["degree_u"].tolist()) | set(s["degree_v"].tolist())),
        "largest": int((s["n_u"] * s["n_v"]).max()),
        "materials": materials,
        "used_materials": len(np.unique(s["material"])),
    }


@pytest.mark.parametrize(
    ("model", "surfaces", "points", "materials"),
    [("golf", 8_036, 324_358, 9), pytest.param("c-class", 67_571, 5_555_006, 24, marks=pytest.mark.long)],
)
def test_the_paper_s_counts(model: str, surfaces: int, points: int, materials: int, tmp_path: Path) -> None:
    report = _write(tmp_path / "m.nurbs", model=model)
    found = _placed(tmp_path / "m.nurbs")
    assert (found["surfaces"], found["control_points"]) == (surfaces, points)
    assert (report["surfaces"], report["control_points"]) == (surfaces, points)
    assert found["materials"] == found["used_materials"] == materials
    assert found["degrees"] == [1, 2, 3, 4, 5, 6, 7]
    assert 0.3 < found["rational"] < 0.36
    assert 0.29 < found["holed"] < 0.36
    assert found["largest"] > 2000
    assert report["stored_surfaces"] < surfaces


def test_parking_lot_counts_without_writing_it() -> None:
    size, cars = PRESETS["parking-lot"].size, PRESETS["parking-lot"].cars
    assert (cars * size.surfaces, cars * size.control_points) == (1_081_136, 88_880_096)
    places = np.array([place[:, 3] for _, place in PRESETS["parking-lot"].places()])
    assert len(np.unique(places, axis=0)) == 16


def test_the_same_seed_gives_the_same_content(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        _write(tmp_path / name, 600, seed)
    assert hash_of(tmp_path / "a") == hash_of(tmp_path / "b") != hash_of(tmp_path / "c")


def test_unshared_has_every_placement_as_its_own_surfaces(tmp_path: Path) -> None:
    shared, apart = _write(tmp_path / "s", 900), _write(tmp_path / "u", 900, unshared=True)
    assert (shared["surfaces"], shared["control_points"]) == (apart["surfaces"], apart["control_points"])
    assert apart["stored_surfaces"] == apart["surfaces"] == 900 > shared["stored_surfaces"]
    assert apart["parts"] == apart["occurrences"] == shared["occurrences"]
    with Store.open(tmp_path / "s") as one, Store.open(tmp_path / "u") as two:
        assert (two.get_occurrences()["transform"] == np.eye(3, 4)).all()
        boxes = []
        for store in (one, two):
            corners = []
            for row in store.get_occurrences():
                vertices = store.get_part(int(row["part"])).vertices
                corners.append(vertices @ row["transform"][:, :3].T + row["transform"][:, 3])
            boxes.append(np.array([[c.min(axis=0), c.max(axis=0)] for c in corners]))
        assert np.abs(boxes[0] - boxes[1]).max() < 1e-9


def test_a_small_model_builds_without_a_bad_face(tmp_path: Path) -> None:
    _write(tmp_path / "m.nurbs", 400)
    run_build(tmp_path / "m.nurbs", tmp_path / "m.cache", levels="root")
    with Store.open(tmp_path / "m.cache") as store:
        assert store.n_items() == 400
        assert len(store.get_products()) > 10


@pytest.mark.parametrize(("model", "surfaces"), [("golf", 10), ("parking-lot", 10_001), ("golf", 3_000_000)])
def test_impossible_sizes_are_refused(model: str, surfaces: int) -> None:
    with pytest.raises(UsageError, match="--surfaces"):
        PRESETS[model].scaled(surfaces)


def test_command_reports_and_refuses_to_overwrite(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "nurbs_ooc",
        "synth",
        "golf",
        "--surfaces",
        "500",
        "-o",
        str(tmp_path / "g"),
        "--json",
    ]
    first = subprocess.run(command, capture_output=True, text=True, check=True)
    report = json.loads(first.stdout)
    assert (report["surfaces"], report["model"]) == (500, "golf")
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert again.stderr.count("\n") == 1


@pytest.mark.long
def test_memory_does_not_grow_with_the_model(tmp_path: Path) -> None:
    peaks = []
    for surfaces in (20_000, 160_000):
        command = [sys.executable, "-m", "nurbs_ooc", "synth", "parking-lot", "--surfaces", str(surfaces), "--unshared"]
        run = subprocess.run(
            [*command, "-o", str(tmp_path / str(surfaces)), "--json"], capture_output=True, text=True, check=True
        )
        peaks.append(json.loads(run.stdout)["peak_rss_mib"])
    assert peaks[1] < peaks[0] + 250.0


def test_step_file_reads_back_as_the_same_scene(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "nurbs_ooc", "synth", "golf", "--surfaces", "300", "--step", "--json"]
    run = subprocess.run([*command, "-o", str(tmp_path / "g.nurbs")], capture_output=True, text=True, check=True)
    report = json.loads(run.stdout)
    with open_assembly(Path(report["step"])) as assembly:
        parts = [part.geometry for part in assembly.parts()]
        uses = np.bincount(assembly.occurrences["part"], minlength=len(parts))
        assert int((uses * [len(part) for part in parts]).sum()) == 300
        names = {product.name for product in assembly.products}
    assert {"golf", "exterior", "chassis"} <= names
    points = sum(int(n) * int((g.surfaces["n_u"] * g.surfaces["n_v"]).sum()) for n, g in zip(uses, parts, strict=True))
    # Planes and cylinders may come back as such; free-form surfaces keep their nets.
    assert 0.7 * report["control_points"] < points <= report["control_points"]
