"""Whole flights over a synthetic scene: quality, streaming, failures, budget, files."""

from __future__ import annotations

import csv
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nurbs_cache.errors import CorruptRecordError
from nurbs_client.camera import Camera
from nurbs_client.errors import ServerError
from nurbs_client.flight import Flight, FlightSettings
from nurbs_client.frame_rate import FrameRateControl
from nurbs_client.own_distance import own_mm_per_px
from nurbs_client.path import CameraPath, chosen_frames
from nurbs_client.report import FrameRow, frame_rates

SIZE = (160, 120)
ZOOM = CameraPath.model_validate(
    {
        "keyframes": [
            {"eye": [1500, 900, 700], "target": [0, 0, 0], "fov": 40},
            {"eye": [420, 250, 200], "target": [0, 0, 0]},
            {"eye": [230, 160, 150], "target": [150, 150, 150]},
        ],
        "frames": 5,
    }
)


def fly(transport: Any, folder: Path, *, frames: str | None = None, **settings: Any) -> tuple[dict[str, Any], Flight]:
    flight = Flight(transport, folder, FlightSettings(**{"size": SIZE, "samples": 1, **settings}))
    return flight.fly(ZOOM, *chosen_frames(ZOOM, frames)), flight


def pictures(folder: Path) -> list[np.ndarray]:
    images = []
    for file in sorted(folder.glob("frame_*.png")):
        with Image.open(file) as image:
            images.append(np.array(image))
    return images


def test_waiting_draws_every_frame_at_the_target(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    report, flight = fly(transport_of(grid_world), tmp_path / "out")
    assert report["frames"] == report["complete_frames"] == 5
    assert report["screen_error_px"]["max"] <= 0.5
    assert 0 < report["screen_error_px"]["mean"] <= report["screen_error_px"]["max"]
    assert report["nodes_culled"]["occlusion"] == 0
    assert report["nodes_culled"]["frustum"] > 0
    assert report["effects"] == {}
    assert report["gl_renderer"]
    assert report["bytes_streamed"] > 0
    assert 0 < report["seconds_to_full_quality"] < report["seconds"]["total"]
    assert report["holes"] == report["substitutes"] == 0
    json.dumps(report, allow_nan=False)
    with (tmp_path / "out" / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == list(range(5))
    images = pictures(tmp_path / "out")
    assert [image.shape for image in images] == [(120, 160, 3)] * 5
    assert len({image.tobytes() for image in images}) == 5
    with Image.open(tmp_path / "out" / "contact_sheet.png") as sheet:
        assert sheet.width == 1600
    assert [row.surfaces_drawn for row in flight.rows][-1] > 0


def test_pictures_are_the_same_whatever_came_before(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    fly(transport_of(grid_world), tmp_path / "all")
    fly(transport_of(grid_world, n_threads=1), tmp_path / "again")
    fly(transport_of(grid_world), tmp_path / "last", frames="4:")
    first, second = pictures(tmp_path / "all"), pictures(tmp_path / "again")
    assert all((a == b).all() for a, b in zip(first, second, strict=True))
    alone = pictures(tmp_path / "last")[0]  # surfaces may have come finer on the way to the same place
    assert (np.abs(first[4].astype(int) - alone).max(axis=-1) > 40).mean() < 0.02


def test_streaming_never_waits_and_gets_better(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    still = {"keyframes": [{"eye": [420, 250, 200], "target": [0, 0, 0]}], "frames": 60}
    path = CameraPath.model_validate(still)
    flight = Flight(transport_of(grid_world), tmp_path, FlightSettings(size=SIZE, samples=1, wait=False))
    report = flight.fly(path, *chosen_frames(path, None))
    assert report["frame_ms"]["wait"] == 0
    assert report["mode"] == "stream"
    errors = [row.screen_error_px_max for row in flight.rows]
    assert errors[0] > 0.5
    assert flight.rows[0].holes == 0
    assert flight.rows[0].nodes_drawn >= 1, "the roots are there before the first frame"
    assert errors == sorted(errors, reverse=True)


def test_parents_are_drawn_while_children_load(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    transport = transport_of(grid_world, gate=threading.Event())
    flight = Flight(transport, tmp_path, FlightSettings(size=SIZE, samples=1, wait=False))
    path = CameraPath.model_validate([{"eye": [420, 250, 200], "target": [0, 0, 0]}])
    times = np.zeros(40)
    flight.on_frame = lambda: transport.gate.set() if len(flight.rows) == 38 else None
    flight.fly(path, times, list(range(40)))
    row = flight.rows[37]
    assert row.nodes_drawn == 1
    assert row.substitutes == 1
    assert row.holes == 0
    assert row.screen_error_px_max > 0.5
    assert not row.complete


def test_broken_tiles_cost_only_themselves(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    transport = transport_of(grid_world)
    broken = [row for row in range(1, 9) if grid_world.nodes["parent"][row] == 0][:2]
    for row in broken:
        transport.broken.add(grid_world.nodes["tile_hash"][row].decode())
    transport.broken.add("lod 1003")
    report, flight = fly(transport, tmp_path)
    assert {tile["node"] for tile in report["failed_tiles"]} >= set(broken)
    assert report["frames"] == 5
    assert report["screen_error_px"]["max"] > 0.5, "what is drawn instead is not hidden"
    assert flight.rows[0].holes == 0


def test_server_that_goes_away_ends_the_flight(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    class Gone(transport_of):  # type: ignore[misc]
        def tiles(self, names: list[str]) -> list[bytes]:  # noqa: ARG002
            raise ServerError("http://there: gone")

    with pytest.raises(ServerError, match="gone"):
        fly(Gone(grid_world), tmp_path)


def test_small_memory_raises_the_error_and_says_so(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    roomy, _ = fly(transport_of(grid_world), tmp_path / "roomy")
    assert not roomy["error_target_raised_by_memory"]
    budget = roomy["resident_bytes"] // 8
    report, flight = fly(transport_of(grid_world), tmp_path / "tight", memory_bytes=budget)
    assert report["error_target_raised_by_memory"]
    assert report["error_target_px"]["max"] > 0.5
    assert report["evicted_tiles"] > 0
    assert all(row.resident_bytes <= 1.1 * budget for row in flight.rows)
    assert report["screen_error_px"]["max"] <= report["error_target_px"]["max"]
    assert report["holes"] == 0


def test_viewer_inside_a_surface_box(tmp_path: Path, world_of: Any, transport_of: Any) -> None:
    """From inside a hollow sphere the near plane must not set the error: the wall is a radius away."""
    world = world_of(np.array([[0.0, 0, 0], [2000.0, 0, 0]]), np.array([100.0, 100.0]))
    path = CameraPath.model_validate([{"eye": [0, 0, 0], "target": [0, 1, 0.1], "fov": 60}])
    flight = Flight(transport_of(world), tmp_path, FlightSettings(size=SIZE, samples=1))
    report = flight.fly(path, np.zeros(1), [0])
    assert report["complete_frames"] == 1
    assert report["screen_error_px"]["max"] <= 0.5
    assert report["triangles"] < 100_000


def test_surface_beside_the_image_is_not_refined(tmp_path: Path, world_of: Any, transport_of: Any) -> None:
    """The sphere's box fills the view, the sphere itself is behind the viewer."""
    world = world_of(np.array([[0.0, 0, 0], [2000.0, 0, 0]]), np.array([100.0, 100.0]))
    path = CameraPath.model_validate([{"eye": [80, 80, 80], "target": [200, 200, 200], "fov": 40}])
    flight = Flight(transport_of(world), tmp_path, FlightSettings(size=SIZE, samples=1))
    report = flight.fly(path, np.zeros(1), [0])
    assert report["complete_frames"] == 1
    assert report["surfaces_drawn"] == report["triangles"] == 0
    assert min(level for surface, level in world.lods) >= int(world.nodes["level"].min()) - 1


def test_own_distance_of_a_wall() -> None:
    camera = Camera(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 60.0, 800, 600, 1e-4)
    wall = np.array([[50, -500, -500], [50, 500, -500], [50, 500, 500], [50, -500, 500], [-60, 3, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4]], np.uint32)
    value = own_mm_per_px(camera.view, np.eye(3, 4), np.zeros(3), wall, faces[:2], 0.0)
    assert value == pytest.approx(50 * camera.view.cos_corner / camera.focal_px)
    assert own_mm_per_px(camera.view, np.eye(3, 4), np.zeros(3), wall, faces[:0], 0.0) == np.inf
    less = own_mm_per_px(camera.view, np.eye(3, 4), np.zeros(3), wall, faces[:2], 1.0)
    assert 0.95 * value < less < value
    through = own_mm_per_px(camera.view, np.eye(3, 4), np.zeros(3), wall, faces, 0.0)
    assert through < value


def test_frame_rate_control() -> None:
    control = FrameRateControl(target_fps=20, target_px=0.5)
    assert control.update(0.06) == pytest.approx(0.525)
    assert control.update(0.045) == pytest.approx(0.525), "within the slack nothing changes"
    for _ in range(10):
        control.update(0.01)
    assert control.effective_px == 0.5
    for _ in range(500):
        control.update(1.0)
    assert control.effective_px == 64.0


def test_target_fps_trades_error_for_time(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    _, flight = fly(transport_of(grid_world), tmp_path, target_fps=100000.0, wait=False, frames="12")
    targets = [row.error_target_px for row in flight.rows]
    assert targets == pytest.approx([0.5 * 1.05**i for i in range(12)])


def test_frame_rates() -> None:
    values: dict[str, Any] = dict.fromkeys(FrameRow.__dataclass_fields__, 0)
    rows = [FrameRow(**{**values, "frame_ms": ms}) for ms in (10.0, 10.0, 20.0)]
    rates = frame_rates(rows)
    assert rates["mean"] == pytest.approx(75.0)
    assert rates["min"] == pytest.approx(50.0)
    assert rates["min"] <= rates["p1"] <= rates["mean"]


def test_corrupt_tables_end_the_flight(tmp_path: Path, grid_world: Any, transport_of: Any) -> None:
    class Broken(transport_of):  # type: ignore[misc]
        def nodes(self) -> Any:
            raise CorruptRecordError("nodes: checksum")

    with pytest.raises(CorruptRecordError):
        Flight(Broken(grid_world), tmp_path)
