"""Frustum, projection, reversed depth, and precision far from the origin."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_cache.errors import UsageError
from nurbs_client.camera import Camera
from nurbs_client.screen_error import boxes_mm_per_px


def camera_at(eye: tuple[float, float, float], target: tuple[float, float, float], fov: float = 50.0) -> Camera:
    return Camera(np.array(eye), np.array(target), np.array([0, 0, 1.0]), fov, 640, 480, 0.1)


def test_target_is_in_the_middle_and_up_is_up() -> None:
    camera = camera_at((10, 20, 30), (-5, 1, 2))
    assert camera.project(camera.target[None])[0] == pytest.approx([320, 240])
    above = camera.project(camera.target[None] + np.array([0, 0, 1.0]))[0]
    assert above[1] < 240
    assert above[0] == pytest.approx(320)


def test_looking_along_up_has_a_steady_answer() -> None:
    camera = camera_at((0, 0, 100), (0, 0, 0))
    assert camera.rotation @ camera.rotation.T == pytest.approx(np.eye(3))
    assert np.linalg.det(camera.rotation[[0, 1, 2]]) == pytest.approx(-1.0)  # x right, y up, z forward


def test_reversed_depth() -> None:
    camera = camera_at((0, 0, 0), (1, 0, 0))
    for z, depth in ((0.1, 1.0), (0.2, 0.5), (1e6, 1e-7)):
        clip = camera.projection @ np.array([0, 0, z, 1.0])
        assert clip[2] / clip[3] == pytest.approx(depth)


def test_frustum_culling_agrees_with_points() -> None:
    rng = np.random.default_rng(5)
    culled = 0
    for _ in range(300):
        eye = rng.normal(0, 50, 3)
        camera = Camera(eye, eye + rng.normal(0, 1, 3), rng.normal(0, 1, 3), rng.uniform(10, 120), 300, 200, 0.5)
        low = rng.normal(0, 80, 3)
        high = low + rng.uniform(0, 60, 3)
        points = low + rng.random((500, 3)) * (high - low)
        pixels, depth = camera.project(points), camera.to_view(points)[:, 2]
        with np.errstate(invalid="ignore"):
            seen = (pixels >= 0).all(axis=1) & (pixels[:, 0] <= 300) & (pixels[:, 1] <= 200) & (depth >= 0.5)
        outside = np.isinf(boxes_mm_per_px(camera.view, low[None], high[None])[0])
        planes = (points - eye) @ camera.frustum_planes[:, :3].T + camera.frustum_planes[:, 3]
        assert (seen == (planes >= -1e-9).all(axis=1)).mean() > 0.99
        assert not (outside and seen.any())
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
        signed = (corners - eye) @ camera.frustum_planes[:, :3].T + camera.frustum_planes[:, 3]
        assert outside == bool((signed < 0).all(axis=0).any())
        culled += outside
    assert 100 < culled < 295


def test_model_view_keeps_micrometres_at_a_kilometre() -> None:
    offset = np.array([1e6, -2e6, 5e5])
    camera = Camera(offset + np.array([30.0, 0, 0]), offset, np.array([0, 0, 1.0]), 40.0, 640, 480)
    local = np.random.default_rng(1).uniform(-5, 5, (100, 3))
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    transform = np.column_stack([turn, offset])
    matrix = camera.model_view(transform, np.zeros(3))
    seen = local.astype(np.float32) @ matrix[:, :3].T + matrix[:, 3]
    exact = camera.to_view(local @ turn.T + offset)
    assert np.abs(seen - exact).max() < 1e-5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fov_deg": 180.0}, "fov"),
        ({"target": np.zeros(3)}, "apart"),
        ({"eye": np.array([np.nan, 0, 0])}, "finite"),
        ({"width": 0}, "positive"),
        ({"near": 0.0}, "positive"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], words: str) -> None:
    values: dict[str, object] = {
        "eye": np.zeros(3), "target": np.ones(3), "up": np.array([0, 0, 1.0]), "fov_deg": 40.0,
        "width": 10, "height": 10, "near": 0.1,
    }  # fmt: skip
    with pytest.raises(UsageError, match=words):
        Camera(**{**values, **change})  # type: ignore[arg-type]
