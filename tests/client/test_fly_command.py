"""``nurbs-ooc fly`` from the outside: options, files, one-line errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from nurbs_cache.store import Store
from nurbs_ooc.cli.fly import command

STILL = [{"eye": [1500, 900, 700], "target": [0, 0, 0], "fov": 40}]


def run(*arguments: Any) -> Result:
    return CliRunner().invoke(command, [str(a) for a in arguments])


@pytest.fixture
def stored(tmp_path: Path, grid_world: Any) -> Path:
    """A cache whose tiles are all there, without surfaces to build others from."""
    folder = tmp_path / "cache"
    with Store.create(folder, provenance={}) as store:
        store.put_scene([], grid_world.materials, grid_world.occurrences, {})
        store.put_tree(grid_world.nodes, grid_world.items, {})
        store.put_tiles(sorted(grid_world.tiles.items()))
    return folder


@pytest.fixture
def path_file(tmp_path: Path) -> Path:
    file = tmp_path / "path.json"
    file.write_text(json.dumps({"keyframes": STILL, "frames": 3}))
    return file


def test_frames_csv_sheet_and_report(tmp_path: Path, stored: Path, path_file: Path) -> None:
    out, report = tmp_path / "out", tmp_path / "report.json"
    result = run(stored, "--path", path_file, "-o", out, "--size", "96x64", "--frames", "0:2", "--samples", 1,
                 "--report", report, "--json")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in out.iterdir()) == [
        "contact_sheet.png", "frame_00000.png", "frame_00001.png", "frames.csv",
    ]  # fmt: skip
    with Image.open(out / "frame_00000.png") as image:
        assert image.size == (96, 64)
    content = json.loads(report.read_text())
    assert content == json.loads(result.output)
    assert {
        "gl_renderer", "frames", "fps", "screen_error_px", "nodes_drawn", "nodes_culled", "bytes_streamed",
        "seconds_to_full_quality", "effects",
    } <= content.keys()  # fmt: skip
    assert content["fps"].keys() == {"mean", "min", "p1"}
    assert content["frames"] == 2
    assert content["screen_error_px"]["max"] <= 0.5


def test_automatic_path_and_words_for_people(tmp_path: Path, stored: Path) -> None:
    result = run(stored, "-o", tmp_path / "out", "--size", "64x48", "--frames", "0:2", "--samples", 1)
    assert result.exit_code == 0, result.output
    assert "drawn by" in result.output
    assert "asked: 0.5 px" in result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "0x5"], "WIDTHxHEIGHT"),
        (["--size", "big"], "WIDTHxHEIGHT"),
        (["--size", "9000x10"], "8192"),
        (["--error-px", "0"], "error-px"),
        (["--frames", "7:9"], "frames"),
        (["--target-fps", "30", "--wait"], "contradict"),
        (["--path", "none.json"], "none.json"),
        (["--samples", "65"], "samples"),
    ],
)
def test_bad_usage_is_exit_2(tmp_path: Path, stored: Path, path_file: Path, arguments: list[str], words: str) -> None:
    result = run(stored, "--path", path_file, "-o", tmp_path / "out", *arguments)
    assert result.exit_code == 2
    assert words in result.output
    assert "Traceback" not in result.output


def test_bad_sources_are_one_line(tmp_path: Path, path_file: Path) -> None:
    empty = tmp_path / "empty"
    with Store.create(empty, provenance={}) as store:
        store.put_parts([])
    for source in (tmp_path / "none", empty, "http://127.0.0.1:9", path_file, "http://"):
        result = run(source, "--path", path_file, "-o", tmp_path / "out")
        assert result.exit_code == 2, (source, result.output)
        assert len(result.output.strip().splitlines()) == 1, result.output


def test_help_names_units() -> None:
    text = run("--help").output
    assert "millimetres" in text
    assert "pixels" in text
