"""Pictures against closed forms: outlines, precision far from the origin, mirrored parts, equal bytes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_client.camera import Camera
from nurbs_client.errors import GraphicsError
from nurbs_client.renderer.arena import BufferArena
from nurbs_client.renderer.context import Context, create_context
from nurbs_client.renderer.frame_target import FrameTarget
from nurbs_client.renderer.renderer import DrawList, Renderer
from nurbs_client.tile_mesh import TileMesh, make_mesh, octahedral

SIZE = (320, 240)
Image = npt.NDArray[np.uint8]


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    made = create_context()
    yield made
    made.release()


@pytest.fixture
def renderer(context: Context) -> Renderer:
    return Renderer(context)


def mesh_of(points: Any, normals: Any, triangles: Any = (), lines: Any = (), dots: Any = ()) -> TileMesh:
    points = np.asarray(points, np.float64)
    origin = points[0].copy()
    return make_mesh(
        origin,
        (points - origin).astype(np.float32),
        np.asarray(normals, np.float32),
        np.asarray(triangles, np.uint32).reshape(-1, 3),
        np.asarray(lines, np.uint32).reshape(-1, 2),
        np.asarray(dots, np.uint32).reshape(-1),
        0.01,
    )


def picture(
    context: Context,
    renderer: Renderer,
    camera: Camera,
    meshes: list[TileMesh],
    *,
    samples: int = 1,
    transforms: Any = None,
    thickness: float = 1.0,
    colour: tuple[float, float, float] = (0.6, 0.05, 0.05),
) -> Image:
    target = FrameTarget(context, (camera.width, camera.height), samples)
    slots = np.array([renderer.upload(mesh) for mesh in meshes], dtype=np.int64)
    n = len(meshes)
    placed = np.broadcast_to(np.eye(3, 4), (n, 3, 4)) if transforms is None else np.asarray(transforms)
    draws = DrawList(slots, placed, np.tile(np.array(colour, np.float32), (n, 1)), np.full(n, thickness))
    renderer.draw(camera, target, draws)
    image = target.read()
    for slot in slots:
        renderer.drop(int(slot))
    target.release()
    return image


def camera_at(eye: Any, target: Any = (0, 0, 0), fov: float = 40.0, size: tuple[int, int] = SIZE) -> Camera:
    return Camera(np.array(eye, float), np.array(target, float), np.array([0, 0, 1.0]), fov, *size, 0.01)


def is_red(image: Image) -> npt.NDArray[np.bool_]:
    """Pixels of the model: the background is grey."""
    return np.asarray(image[..., 0].astype(int) - image[..., 1] > 20)


@pytest.mark.parametrize("off", [(0.0, 0.0), (60.0, -35.0)])
def test_sphere_covers_its_disc(
    context: Context, renderer: Renderer, sphere_arrays: Callable[..., Any], off: tuple[float, float]
) -> None:
    radius = 50.0
    points, normals, triangles, error = sphere_arrays(radius, 0.02)
    camera = camera_at((400, off[0], off[1]), (0, off[0], off[1]))
    red = is_red(picture(context, renderer, camera, [mesh_of(points, normals, triangles)]))
    rows, columns = np.mgrid[0 : SIZE[1], 0 : SIZE[0]] + 0.5
    rays = np.stack([columns - SIZE[0] / 2, SIZE[1] / 2 - rows, np.full(rows.shape, camera.focal_px)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    centre = camera.to_view(np.zeros((1, 3)))[0]
    along = rays @ centre
    distance = np.sqrt(np.maximum(centre @ centre - along**2, 0.0))
    pixel = math.sqrt(centre @ centre) / camera.focal_px
    assert red[distance < radius - float(error) - pixel].all()
    assert not red[distance > radius + pixel].any()
    exact = (distance < radius).sum()
    assert abs(red.sum() - exact) < 0.01 * exact


def test_pictures_far_from_the_origin_are_the_same(
    context: Context, renderer: Renderer, sphere_arrays: Callable[..., Any]
) -> None:
    points, normals, triangles, _ = sphere_arrays(50.0, 0.5)
    images = []
    for offset in (np.zeros(3), np.array([1e6, -1e6, 1e6])):
        eye = offset + np.array([200.0, 80, 60])
        images.append(
            picture(context, renderer, camera_at(eye, offset), [mesh_of(points + offset, normals, triangles)])
        )
    difference = np.abs(images[0].astype(int) - images[1])
    assert (difference.max(axis=-1) > 2).sum() <= 4, "a few pixels on the outline at most"


def test_mirrored_and_scaled_parts_are_lit_like_built_ones(
    context: Context, renderer: Renderer, sphere_arrays: Callable[..., Any]
) -> None:
    points, normals, triangles, _ = sphere_arrays(50.0, 0.2)
    points = points + np.array([10.0, 30.0, 0])
    linear = np.diag([1.0, -0.6, 0.6]) @ np.diag([0.8, 0.8, 0.8])
    transform = np.column_stack([linear, [5.0, 6, 7]])
    moved = points @ linear.T + transform[:, 3]
    turned = normals @ np.linalg.inv(linear)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    camera = camera_at((250, 100, 80))
    drawn = picture(context, renderer, camera, [mesh_of(points, normals, triangles)], transforms=[transform])
    built = picture(context, renderer, camera, [mesh_of(moved, turned, triangles[:, ::-1])])
    difference = np.abs(drawn.astype(int) - built).max(axis=-1)
    assert is_red(drawn).sum() > 2000
    assert (difference > 3).sum() <= 4


def test_both_sides_are_lit(context: Context, renderer: Renderer) -> None:
    square = np.array([[0, -50, -50], [0, 50, -50], [0, 50, 50], [0, -50, 50]], float)
    faces = [[0, 1, 2], [0, 2, 3]]
    camera = camera_at((200, 0, 0))
    one = picture(context, renderer, camera, [mesh_of(square, [[1, 0, 0]] * 4, faces)])
    other = picture(context, renderer, camera, [mesh_of(square, [[-1, 0, 0]] * 4, faces)])
    assert is_red(one).sum() > 3000
    assert (np.abs(one.astype(int) - other) <= 1).all()


def test_nearer_wins_and_the_near_plane_cuts(context: Context, renderer: Renderer) -> None:
    square = np.array([[0, -50, -50], [0, 50, -50], [0, 50, 50], [0, -50, 50]], float)
    faces = [[0, 1, 2], [0, 2, 3]]
    tiles = [mesh_of(square + np.array([x, 0, 0]), [[1, 0, 0]] * 4, faces) for x in (0.0, 1e-3)]
    camera = camera_at((2000, 0, 0), fov=4.0)
    target = FrameTarget(context, SIZE, 1)
    slots = np.array([renderer.upload(tile) for tile in tiles])
    colours = np.array([[0, 0, 0.8], [0.8, 0, 0]], np.float32)
    for order in ([0, 1], [1, 0]):
        draws = DrawList(slots[order], np.broadcast_to(np.eye(3, 4), (2, 3, 4)), colours[order], np.ones(2))
        renderer.draw(camera, target, draws)
        middle = target.read()[SIZE[1] // 2, SIZE[0] // 2]
        assert middle[0] > middle[2], "a micrometre nearer, two metres away"
    behind = picture(context, renderer, camera_at((-1e-3, 0, 0), (-1, 0, 0)), tiles[:1])
    assert not is_red(behind).any()


def test_lines_fill_a_gap_but_cover_nothing(context: Context, renderer: Renderer) -> None:
    gap = 0.3  # mm, a third of a pixel
    left = np.array([[0, -50, -50], [0, -gap / 2, -50], [0, -gap / 2, 50], [0, -50, 50]])
    right = left * [1, -1, 1]
    faces, edge = [[0, 1, 2], [0, 2, 3]], [[1, 2]]
    camera = camera_at((300, 0, 0))
    normals = [[1, 0, 0]] * 4
    plain = [mesh_of(left, normals, faces), mesh_of(right, normals, faces)]
    lined = [mesh_of(left, normals, faces, edge), mesh_of(right, normals, faces, edge)]
    open_gap = picture(context, renderer, camera, plain, samples=64)
    closed = picture(context, renderer, camera, lined, samples=64)
    middle = slice(SIZE[1] // 2 - 20, SIZE[1] // 2 + 20), slice(SIZE[0] // 2 - 2, SIZE[0] // 2 + 2)
    flat = closed[SIZE[1] // 2, SIZE[0] // 2 - 10].astype(int)
    assert np.abs(open_gap[middle].astype(int) - flat).max() > 8
    assert np.abs(closed[middle].astype(int) - flat).max() <= 2
    over = mesh_of([[-0.1, -40, 0], [-0.1, -10, 0]], [[0, 0, 1]] * 2, lines=[[0, 1]])
    assert (picture(context, renderer, camera, [plain[0], over]) == picture(context, renderer, camera, plain[:1])).all()


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_points_and_lines_are_lit_like_the_surface_they_lie_on(
    context: Context, renderer: Renderer, mirror: float
) -> None:
    square = np.array([[0, -50, -50], [0, 50, -50], [0, 50, 50], [0, -50, 50]], float)
    normals = [[0.6, mirror * 0.64, 0.48]] * 4
    camera = camera_at((300, 0, 0))
    transform = [np.column_stack([np.diag([1.0, mirror, 1.0]), np.zeros(3)])]
    faces = picture(context, renderer, camera, [mesh_of(square, normals, [[0, 1, 2], [0, 2, 3]])], transforms=transform)
    want = faces[SIZE[1] // 2, SIZE[0] // 2].astype(int)
    middle = mesh_of([[0, -30, 0], [0, 30, 0]], normals[:2], lines=[[0, 1]], dots=[0])
    thin = picture(context, renderer, camera, [middle], transforms=transform, thickness=6.0)
    pixels = thin[is_red(thin)].astype(int)
    assert len(pixels) > 100
    assert (np.abs(pixels - want).max(axis=-1) < 12).all()


def test_points_have_their_size(context: Context, renderer: Renderer) -> None:
    dot = mesh_of([[0, 0.3, 0.3]], [[1, 0, 0]], dots=[0])
    areas = [
        is_red(picture(context, renderer, camera_at((300, 0, 0)), [dot], thickness=t)).sum() for t in (0.2, 1, 8, 1e9)
    ]
    assert areas[:2] == [1, 1], "never less than a pixel"
    assert 40 <= areas[2] <= 64
    assert areas[3] <= 256, "nor all of the picture"


def test_normals_without_direction_do_no_harm(context: Context, renderer: Renderer) -> None:
    square = np.array([[0, -50, -50], [0, 50, -50], [0, 50, 50], [0, -50, 50]], float)
    image = picture(
        context, renderer, camera_at((200, 0, 0)), [mesh_of(square, np.zeros((4, 3)), [[0, 1, 2], [0, 2, 3]])]
    )
    assert is_red(image).sum() > 3000


def test_octahedral_normals_keep_their_direction() -> None:
    normals = np.random.default_rng(0).normal(size=(5000, 3))
    normals = np.concatenate([normals / np.linalg.norm(normals, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    e = octahedral(normals.astype(np.float32)) / 32767.0
    decoded = np.column_stack([e, 1 - np.abs(e).sum(axis=1)])
    fold = np.maximum(-decoded[:, 2], 0)[:, None]
    decoded[:, :2] -= np.where(decoded[:, :2] >= 0, fold, -fold)
    decoded /= np.linalg.norm(decoded, axis=1, keepdims=True)
    assert np.arccos(np.clip((decoded * normals).sum(axis=1), -1, 1)).max() < 1e-4


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_the_same_bytes_every_time(
    context: Context, renderer: Renderer, sphere_arrays: Callable[..., Any], samples: int
) -> None:
    points, normals, triangles, _ = sphere_arrays(50.0, 0.5)
    mesh = mesh_of(points, normals, triangles)
    first, second = (picture(context, renderer, camera_at((200, 80, 60)), [mesh], samples=samples) for _ in range(2))
    assert (first == second).all()
    edges = len(np.unique(first[..., 1][is_red(first)]))
    assert edges > 50


@pytest.mark.parametrize(("samples", "msaa", "factor"), [(4, 4, 1), (16, 4, 2)])
def test_samples_of_the_card_give_the_same_picture(
    context: Context, renderer: Renderer, sphere_arrays: Callable[..., Any], monkeypatch: pytest.MonkeyPatch,
    samples: int, msaa: int, factor: int,
) -> None:  # fmt: skip
    points, normals, triangles, _ = sphere_arrays(50.0, 0.5)
    mesh = mesh_of(points, normals, triangles)
    averaged = picture(context, renderer, camera_at((200, 80, 60)), [mesh], samples=samples)
    monkeypatch.setattr(Context, "is_software", False)
    target = FrameTarget(context, SIZE, samples)
    assert (target.msaa, target.factor, target.samples) == (msaa, factor, samples)
    target.release()
    sampled = picture(context, renderer, camera_at((200, 80, 60)), [mesh], samples=samples)
    difference = np.abs(sampled.astype(int) - averaged).max(axis=-1)
    assert (difference > 6).mean() < 0.02, "on the outline only"
    assert difference.max() < 110


def test_empty_scene_is_background(context: Context, renderer: Renderer) -> None:
    image = picture(context, renderer, camera_at((200, 80, 60)), [])
    assert image.min() > 200
    assert image[0].mean() > image[-1].mean(), "lighter above"
    assert not is_red(image).any()


def test_counters_tell_what_was_drawn(context: Context, renderer: Renderer) -> None:
    square = np.array([[0, -50, -50], [0, 50, -50], [0, 50, 50], [0, -50, 50]], float)
    mesh = mesh_of(square, [[1, 0, 0]] * 4, [[0, 1, 2], [0, 2, 3]], [[0, 1]], [2, 3])
    picture(context, renderer, camera_at((200, 0, 0)), [mesh, mesh, mesh])
    counters = renderer.counters
    assert (counters.draws, counters.triangles, counters.lines, counters.points) == (3, 6, 3, 6)
    assert (counters.uploads, counters.programs, counters.draw_calls) == (3, 3, 3)
    assert counters.upload_bytes == 3 * mesh.n_bytes


def test_programs_are_compiled_only_when_something_is_drawn_with_them(context: Context, renderer: Renderer) -> None:
    picture(context, renderer, camera_at((200, 0, 0)), [])
    assert renderer.counters.programs == 1
    picture(context, renderer, camera_at((200, 0, 0)), [mesh_of(np.eye(3), np.eye(3), [[0, 1, 2]])])
    assert renderer.counters.programs == 2


def test_arena_reuses_gaps_and_grows(context: Context) -> None:
    arena = BufferArena(context.gl, 4)
    rng = np.random.default_rng(3)
    held: dict[int, npt.NDArray[np.uint32]] = {}
    for _ in range(300):
        if held and rng.random() < 0.45:
            first = int(rng.choice(list(held)))
            arena.drop(first, len(held.pop(first)))
        else:
            data = rng.integers(0, 2**32, int(rng.integers(1, 30000)), dtype=np.uint32)
            held[arena.put(data.tobytes(), len(data))] = data
    spans = sorted((first, len(data)) for first, data in held.items())
    assert all(a + n <= b for (a, n), (b, _) in pairwise(spans))
    for first, data in held.items():
        assert (np.frombuffer(arena.buffer.read(len(data) * 4, offset=first * 4), np.uint32) == data).all()
    for first, data in held.items():
        arena.drop(first, len(data))
    assert arena.put(b"\0" * arena.n_bytes, arena.n_bytes // 4) == 0, "all gaps have merged"


def test_missing_opengl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(**_: object) -> None:
        raise Exception("cannot load libEGL.so.1")

    monkeypatch.setattr("moderngl.create_context", broken)
    with pytest.raises(GraphicsError, match="libegl1 libgl1 libgl1-mesa-dri") as caught:
        create_context()
    assert "\n" not in str(caught.value)


def test_too_large_images_are_refused(context: Context) -> None:
    with pytest.raises(GraphicsError, match="16384"):
        FrameTarget(context, (9000, 10), 16)
