"""The error on screen: never underestimated, exact where it is claimed to be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nurbs_client.camera import Camera
from nurbs_client.screen_error import boxes_mm_per_px, desired_error, screen_error_px


def random_camera(rng: np.random.Generator, fov: float) -> Camera:
    eye = rng.normal(0, 300, 3)
    width, height = int(rng.integers(200, 2000)), int(rng.integers(200, 1200))
    return Camera(eye, eye + rng.normal(0, 1, 3), rng.normal(0, 1, 3), fov, width, height, 0.01)


def visible_points(camera: Camera, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points of a box that the camera sees, corners and edges among them."""
    points = low + rng.random((4000, 3)) * (high - low)
    snapped = np.where(rng.random((4000, 3)) < 0.5, np.where(points < (low + high) / 2, low, high), points)
    points = np.concatenate([points, snapped])
    view = camera.to_view(points)
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] <= camera.width) & (pixels[:, 1] <= camera.height)
    return points[inside & (view[:, 2] >= camera.near)]


def worst_displacement(camera: Camera, points: np.ndarray, error: float, rng: np.random.Generator) -> float:
    """Most pixels that displacements of length ``error`` move any of the points, brute force."""
    worst = 0.0
    before = camera.project(points)
    forward = camera.rotation[2]
    for number in range(24):
        away = rng.normal(0, 1, points.shape)
        if number < 12:  # across the ray in the plane of ray and line of sight shows most
            ray = points - camera.eye
            away = forward - ray * ((ray @ forward) / (ray * ray).sum(axis=1))[:, None] + 0.01 * (number + 1) * away
            away *= 1 if number % 2 else -1
        away *= error / np.linalg.norm(away, axis=1, keepdims=True)
        moved = camera.project(points + away)
        worst = max(worst, float(np.nanmax(np.linalg.norm(moved - before, axis=1), initial=0.0)))
    return worst


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    fov=st.sampled_from([5.0, 40.0, 75.0, 110.0, 150.0]),
    size=st.floats(0.5, 400.0),
    target=st.sampled_from([0.25, 0.5, 3.0, 20.0]),
)
def test_error_within_the_desired_one_never_shows_more(seed: int, fov: float, size: float, target: float) -> None:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, fov)
    low = camera.eye + camera.rotation[2] * rng.uniform(-100, 400) + rng.normal(0, 150, 3)
    high = low + rng.uniform(0, size, 3)
    points = visible_points(camera, low, high, rng)
    mm_per_px = boxes_mm_per_px(camera.view, low[None], high[None])[0]
    if len(points) == 0:
        return
    assert math.isfinite(mm_per_px), "a box with visible points is never culled"
    error = desired_error(mm_per_px, target, camera.focal_px)
    assert worst_displacement(camera, points, error, rng) <= target * (1 + 1e-9)
    assert screen_error_px(np.array([mm_per_px]), np.array([error]), camera.focal_px) == pytest.approx(target)


@pytest.mark.parametrize("off", [(0.0, 0.0), (0.3, 0.1), (0.0, -0.5), (0.45, 0.45)])
def test_small_box_is_measured_exactly(off: tuple[float, float]) -> None:
    camera = Camera(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 80.0, 1000, 1000)
    z = 500.0
    point = camera.eye + camera.rotation.T @ (z * np.array([*off, 1.0]))
    mm_per_px = boxes_mm_per_px(camera.view, point[None] - 1e-6, point[None] + 1e-6)[0]
    distance = z * math.sqrt(1 + off[0] ** 2 + off[1] ** 2)
    assert mm_per_px == pytest.approx(z * z / (camera.focal_px * distance), rel=1e-6)
    error = desired_error(mm_per_px, 0.5, camera.focal_px)
    shown = worst_displacement(camera, np.tile(point, (50, 1)), error, np.random.default_rng(0))
    assert 0.49 < shown <= 0.5


def test_paper_formula_is_ours_in_the_middle_only() -> None:
    camera = Camera(np.zeros(3), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 60.0, 1280, 720)
    paper = 1000.0 * math.tan(math.radians(30.0)) / 720
    middle = camera.eye + camera.rotation.T @ np.array([0, 0, 1000.0])
    ours = desired_error(boxes_mm_per_px(camera.view, middle[None], middle[None])[0], 0.5, camera.focal_px)
    assert ours == pytest.approx(paper, rel=1e-3)
    corner = unit_ray(camera) * 1000.0
    ours = desired_error(boxes_mm_per_px(camera.view, corner[None], corner[None])[0], 0.5, camera.focal_px)
    assert ours < paper / 1.8  # with the paper's formula this corner would show 0.9 px


def unit_ray(camera: Camera) -> np.ndarray:
    """Direction to just inside the image's corner."""
    ray = camera.rotation.T @ np.array([0.999 * 640 / camera.focal_px, 0.999 * 360 / camera.focal_px, 1.0])
    return ray / np.linalg.norm(ray)


def test_viewer_inside_a_box_gets_the_near_plane() -> None:
    camera = Camera(np.zeros(3), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 60.0, 800, 600, near=0.5)
    value = boxes_mm_per_px(camera.view, -np.ones((1, 3)), np.ones((1, 3)))[0]
    assert value == pytest.approx(0.5 * camera.view.cos_corner / camera.focal_px)


def test_box_beside_the_eye_is_not_at_it() -> None:
    """It crosses the eye's plane and both side planes, so culling keeps it, but nothing of it is near."""
    camera = Camera(np.zeros(3), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 60.0, 800, 600, near=1e-6)
    low, high = np.array([[-400.0, -50, 300]]), np.array([[400.0, 800, 310]])
    value = boxes_mm_per_px(camera.view, low, high)[0]
    assert math.isfinite(value)
    assert value >= 300 * camera.view.cos_corner**2 / camera.focal_px


def test_errors_as_large_as_the_distance_have_no_bound() -> None:
    assert screen_error_px(np.ones(2), np.array([1e6, 0.0]), 500.0).tolist() == [math.inf, 0.0]
