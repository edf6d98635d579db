"""Camera paths: the file's schema, interpolation, frames, the automatic path."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nurbs_cache.errors import InputFileError, UsageError
from nurbs_client.path import CameraPath, auto_path, chosen_frames, load_path, slerp

TWO: list[dict[str, Any]] = [
    {"time": 0, "eye": [100, 0, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 30},
    {"time": 2, "eye": [0, 100, 0], "target": [0, 0, 10]},
    {"time": 3, "eye": [-100, 0, 50], "target": [0, 0, 10], "fov": 60},
]


def written(folder: Path, content: Any) -> Path:
    file = folder / "path.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return file


def test_passes_through_its_keyframes(tmp_path: Path) -> None:
    path = load_path(written(tmp_path, {"keyframes": TWO, "frames": 7}))
    for key in TWO:
        camera = path.camera(key["time"], (64, 48), 0.1)
        assert camera.eye == pytest.approx(key["eye"])
        assert camera.target == pytest.approx(key["target"])
    assert path.camera(1.0, (64, 48), 0.1).fov_deg == pytest.approx(30)
    assert path.camera(2.5, (64, 48), 0.1).fov_deg == pytest.approx(45)
    assert path.camera(-9.0, (64, 48), 0.1).eye == pytest.approx(TWO[0]["eye"])


def test_is_smooth_at_keyframes() -> None:
    path = CameraPath.model_validate(TWO)
    step = 1e-6
    before, at, after = (path.camera(t, (64, 48), 0.1).eye for t in (2 - step, 2.0, 2 + step))
    assert (at - before) / step == pytest.approx((after - at) / step, abs=1e-3)


def test_straight_even_keyframes_move_evenly() -> None:
    keys = [{"time": t, "eye": [10.0 * t, 0, 0], "target": [10.0 * t, 100, 0]} for t in range(5)]
    path = CameraPath.model_validate(keys)
    for t in np.linspace(0, 4, 23):
        assert path.camera(float(t), (64, 48), 0.1).eye == pytest.approx([10 * t, 0, 0], abs=1e-9)


def test_up_turns_on_the_great_circle() -> None:
    a, b = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    assert slerp(a, b, 0.5) == pytest.approx([0, np.sqrt(0.5), np.sqrt(0.5)])
    assert np.linalg.norm(slerp(a, -a, 0.5)) == pytest.approx(1.0)
    assert slerp(a, a, 0.3) == pytest.approx(a)


def test_frames() -> None:
    path = CameraPath.model_validate({"keyframes": TWO, "frames": 7})
    assert chosen_frames(path, None)[1] == list(range(7))
    times, numbers = chosen_frames(path, "4")
    assert times.tolist() == [0, 1, 2, 3]
    assert numbers == [0, 1, 2, 3]
    times, numbers = chosen_frames(path, "1:6:2")
    assert numbers == [1, 3, 5]
    assert times == pytest.approx([0.5, 1.5, 2.5])
    assert chosen_frames(path, "5:")[1] == [5, 6]
    assert CameraPath.model_validate(TWO).n_frames == 37
    assert CameraPath.model_validate(TWO[:1]).n_frames == 1
    assert CameraPath.model_validate(TWO[:1]).camera(0, (8, 8), 0.1).eye == pytest.approx([100, 0, 0])


@pytest.mark.parametrize("text", ["0", "-3", "x", "1:2:0", "9:12", "1:x"])
def test_impossible_frames(text: str) -> None:
    with pytest.raises(UsageError, match="frames"):
        chosen_frames(CameraPath.model_validate({"keyframes": TWO, "frames": 7}), text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "path.json"),
        ({"keyframes": []}, "keyframes"),
        ([{"eye": [0, 0, 0], "target": [0, 0, 0]}], "same point"),
        ([{"eye": [0, 0], "target": [0, 0, 1]}], "eye"),
        ([{"eye": [0, 0, "a"], "target": [0, 0, 1]}], "eye"),
        ([{"eye": [0, 0, 1], "target": [0, 0, 0], "fov": 190}], "fov"),
        ([{"eye": [0, 0, 1], "target": [0, 0, 0], "roll": 3}], "roll"),
        ([{"time": 1, "eye": [0, 0, 1], "target": [0, 0, 0]}] * 2, "increase"),
        ([{"eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 0, 0]}], "direction"),
        ('[{"eye": [0, 0, 1e999], "target": [0, 0, 0]}]', "eye"),
        ({"keyframes": TWO, "frames": 0}, "frames"),
        ("3", "path.json"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, content: Any, words: str) -> None:
    with pytest.raises(InputFileError, match=words) as caught:
        load_path(written(tmp_path, content))
    assert "\n" not in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="No such file"):
        load_path(tmp_path / "none.json")


@pytest.mark.parametrize("size", [(1.0, 1.0, 1.0), (1000.0, 10.0, 1.0), (0.0, 0.0, 5.0), (2.0, 300.0, 0.0)])
@pytest.mark.parametrize("aspect", [16 / 9, 0.5])
def test_auto_path_shows_all_then_comes_closer(size: tuple[float, float, float], aspect: float) -> None:
    low = np.array([5e5, -3.0, 20.0])
    high = low + size
    path = auto_path(low, high, aspect)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    resolution = (round(400 * aspect), 400)
    for key in path.keyframes[:9]:
        pixels = path.camera(key.time, resolution, 1e-6).project(corners)
        assert ((pixels > 0) & (pixels < np.array(resolution))).all()
    distances = [np.linalg.norm(np.subtract(key.eye, key.target)) for key in path.keyframes]
    assert distances[-1] < 0.5 * distances[0]
    assert chosen_frames(path, None)[1] == list(range(24))
