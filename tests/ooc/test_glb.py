"""GLB: hand-made meshes with known counts, read back byte by byte, by trimesh and by Khronos' validator."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from nurbs_cache.errors import UsageError
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_ooc.export import glb_file
from nurbs_ooc.export.glb import GlbWriter
from nurbs_ooc.export.gltf_space import matrix4, node_chain, stretch
from nurbs_ooc.export.part_mesh import PartMesh, part_mesh
from nurbs_ooc.tessellation.mesh import MeshBatch

IDENTITY = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0)
RED, BLUE = Material("red", (1.0, 0.0, 0.0, 1.0)), Material("glass", (0.0, 0.0, 1.0, 0.5))
SQUARE = [[0, 1, 2], [0, 2, 3]]
CUBE_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
CUBE_FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def mesh_batch(faces: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]], first_face: int = 0) -> MeshBatch:
    """A batch of flat faces, each given by its corner positions and triangles."""
    positions, normals, triangles, starts, triangle_starts = [], [], [], [0], [0]
    for points, corners in faces:
        p = np.asarray(points, dtype=float).reshape(-1, 3)
        t = np.asarray(corners, dtype=np.int64).reshape(-1, 3)
        normal = np.cross(p[1] - p[0], p[2] - p[0]) if len(p) > 2 else np.array([0.0, 0, 1])
        length = np.linalg.norm(normal)
        normals.append(np.tile(normal / length if length else [0.0, 0, 1], (len(p), 1)))
        positions.append(p)
        triangles.append(t + starts[-1])
        starts.append(starts[-1] + len(p))
        triangle_starts.append(triangle_starts[-1] + len(t))
    n, n_vertices = len(faces), starts[-1]
    return MeshBatch(
        faces=np.arange(first_face, first_face + n),
        vertex_start=np.array(starts),
        triangle_start=np.array(triangle_starts),
        segment_start=np.zeros(n + 1, dtype=np.int64),
        positions=np.concatenate([np.zeros((0, 3)), *positions]),
        normals=np.concatenate([np.zeros((0, 3)), *normals]),
        parameters=np.zeros((n_vertices, 2)),
        triangles=np.concatenate([np.zeros((0, 3), dtype=np.int64), *triangles]),
        segments=np.zeros((0, 2), dtype=np.int64),
        surface_error=np.zeros(n),
        trim_error=np.zeros(n),
        pcurve_error=np.zeros(n),
        status=np.zeros(n, dtype=np.uint8),
        reason=np.zeros(n, dtype=np.uint16),
    )


def cube(size: float = 10.0, at: Sequence[float] = (0.0, 0.0, 0.0)) -> MeshBatch:
    """A closed cube of six faces, mm."""
    corners = CUBE_CORNERS * size + np.asarray(at)
    return mesh_batch([(corners[face], SQUARE) for face in CUBE_FACES])


def occurrences(*rows: tuple[int, int, int, npt.ArrayLike]) -> npt.NDArray[np.void]:
    """Occurrences of (part, product, material override, transform)."""
    table = np.zeros(len(rows), dtype=OCCURRENCE_DTYPE)
    for row, (part, product, material, transform) in zip(table, rows, strict=True):
        row["part"], row["product"], row["material"] = part, product, material
        row["transform"] = np.asarray(transform, dtype=float).reshape(3, 4)
    return table


def write(
    path: Path,
    parts: Sequence[PartMesh],
    products: Sequence[Product],
    placed: npt.NDArray[np.void],
    materials: Sequence[Material] = (RED, BLUE),
) -> dict[str, Any]:
    """Write a GLB and return its JSON."""
    with GlbWriter(path.parent) as writer:
        for index, part in enumerate(parts):
            writer.add_part(index, PartInfo(f"part {index}", 6, 6 * index), part)
        n_bytes = writer.write(path, products, materials, placed)
    assert path.stat().st_size == n_bytes
    return document(path)


def document(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    magic, version, total = struct.unpack_from("<4sII", data)
    assert (magic, version, total) == (b"glTF", 2, len(data))
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert length % 4 == 0
    result: dict[str, Any] = json.loads(data[20 : 20 + length])
    return result


def one_colour(mesh: MeshBatch, material: int = 0) -> PartMesh:
    return part_mesh(mesh, np.full(int(mesh.faces.max(initial=0)) + 1, material))


def drawn_mm(path: Path) -> trimesh.Trimesh:
    """All triangles of a file in the assembly's millimetres, z up."""
    scene = trimesh.load(path, force="scene", process=False)
    mesh = scene.to_geometry()
    vertices = np.asarray(mesh.vertices) * 1000.0
    return trimesh.Trimesh(np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1), mesh.faces)


def test_closed_cube(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    part = one_colour(cube())
    assert (part.boundary_edges, part.nonmanifold_edges, part.n_triangles, part.n_vertices) == (0, 0, 12, 24)
    path = tmp_path / "cube.glb"
    tree = write(path, [part], [Product("box", -1, IDENTITY)], occurrences((0, 0, -1, IDENTITY)))
    (node,) = tree["nodes"]
    assert (node["name"], node["mesh"]) == ("box", 0)
    assert tree["materials"][0]["pbrMetallicRoughness"] == {
        "baseColorFactor": [1.0, 0.0, 0.0, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.6,
    }
    assert "doubleSided" not in tree["materials"][0]
    issues = gltf_issues(path)
    assert issues["numErrors"] == 0
    assert issues["numWarnings"] == 0


def test_geometry_survives(tmp_path: Path) -> None:
    turned = [0, -1, 0, 5, 1, 0, 0, 7, 0, 0, 1, 1e6]
    path = tmp_path / "cube.glb"
    write(
        path, [one_colour(cube(2.0, (1e6, -3e5, 0.5)))], [Product("box", -1, turned)], occurrences((0, 0, -1, turned))
    )
    mesh = drawn_mm(path)
    np.testing.assert_allclose(mesh.bounds, [[3e5 + 3, 1e6 + 7, 1e6 + 0.5], [3e5 + 5, 1e6 + 9, 1e6 + 2.5]], atol=1e-6)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(8.0)


def test_mirrored_occurrence_keeps_outside(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    mirror = [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
    products = [Product("pair", -1, IDENTITY), Product("right", 0, IDENTITY), Product("left", 0, mirror)]
    path = tmp_path / "pair.glb"
    placed = occurrences((0, 1, -1, IDENTITY), (0, 2, -1, mirror))
    tree = write(path, [one_colour(cube(2.0, (1, 0, 0)))], products, placed)
    assert len(tree["meshes"]) == 1
    assert [node["name"] for node in tree["nodes"]] == ["pair", "right", "left"]
    assert tree["nodes"][0]["children"] == [1, 2]
    np.testing.assert_allclose(drawn_mm(path).bounds, [[-3, 0, 0], [3, 2, 2]], atol=1e-6)
    assert gltf_issues(path)["numErrors"] == 0


def test_sheared_occurrence_becomes_two_nodes(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    shear = [1, 0.5, 0, 1, 0, 1, 0, 2, 0, 0, 3, 3]
    path = tmp_path / "shear.glb"
    tree = write(path, [one_colour(cube(2.0))], [Product("box", -1, shear)], occurrences((0, 0, -1, shear)))
    assert len(tree["nodes"]) == 2
    np.testing.assert_allclose(drawn_mm(path).bounds, [[1, 2, 3], [4, 4, 9]], atol=1e-9)
    assert gltf_issues(path)["numErrors"] == 0


def test_product_tree_is_kept(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    def move(x: float) -> list[float]:
        return [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0]

    products = [Product("top", -1, move(1)), Product("sub", 0, move(10)), Product("two bodies", 1, move(100))]
    placed = occurrences((0, 2, -1, move(111)), (1, 2, 1, move(115)))
    path = tmp_path / "tree.glb"
    tree = write(path, [one_colour(cube(1.0)), one_colour(cube(2.0))], products, placed)
    assert [n["name"] for n in tree["nodes"]] == ["top", "sub", "two bodies", "part 0", "part 1"]
    assert [n.get("children") for n in tree["nodes"]] == [[1], [2], [3, 4], None, None]
    np.testing.assert_allclose(drawn_mm(path).bounds, [[111, 0, 0], [117, 2, 2]], atol=1e-6)
    glass = tree["materials"][tree["meshes"][1]["primitives"][0]["material"]]
    assert (glass["name"], glass["alphaMode"]) == ("glass", "BLEND")
    assert gltf_issues(path)["numErrors"] == 0


def test_materials_become_primitives_and_faces_features(tmp_path: Path) -> None:
    part = part_mesh(cube(), np.array([0, 1, 0, 1, 0, 0]))
    assert [(p.material, len(p.positions)) for p in part.primitives] == [(0, 16), (1, 8)]
    assert part.primitives[1].features.tolist() == [1.0] * 4 + [3.0] * 4
    placed = occurrences((0, 0, -1, IDENTITY), (0, 0, 1, IDENTITY))
    tree = write(tmp_path / "colours.glb", [part], [Product("box", -1, IDENTITY)], placed)
    own, glass = tree["meshes"]
    assert [p["material"] for p in own["primitives"]] == [0, 1]
    assert [p["material"] for p in glass["primitives"]] == [1, 1]
    assert own["primitives"][0]["attributes"] == glass["primitives"][0]["attributes"]
    assert own["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"] == [
        {"featureCount": 4, "attribute": 0, "label": "face"}
    ]
    assert own["extras"] == {"part": 0, "first_surface": 0}


def test_open_part_is_double_sided(tmp_path: Path) -> None:
    part = one_colour(mesh_batch([(CUBE_CORNERS[CUBE_FACES[0]], SQUARE)]))
    assert part.boundary_edges == 4
    tree = write(tmp_path / "s.glb", [part], [Product("s", -1, IDENTITY)], occurrences((0, 0, -1, IDENTITY)))
    assert tree["materials"][0]["doubleSided"] is True


def test_face_without_triangles_becomes_points(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    batch = mesh_batch([(CUBE_CORNERS[CUBE_FACES[0]], SQUARE), (CUBE_CORNERS, np.zeros((0, 3)))])
    part = one_colour(batch)
    assert (part.n_triangles, part.n_points) == (2, 8)
    path = tmp_path / "p.glb"
    tree = write(path, [part], [Product("p", -1, IDENTITY)], occurrences((0, 0, -1, IDENTITY)))
    assert [p["mode"] for p in tree["meshes"][0]["primitives"]] == [4, 0]
    assert gltf_issues(path)["numErrors"] == 0


def test_empty_scene_and_empty_part(tmp_path: Path, gltf_issues: Callable[[Path], dict[str, Any]]) -> None:
    write(tmp_path / "none.glb", [], [], occurrences())
    assert gltf_issues(tmp_path / "none.glb")["numErrors"] == 0
    empty = one_colour(mesh_batch([]))
    assert empty.float32_error == 0.0
    write(tmp_path / "empty.glb", [empty], [Product("e", -1, IDENTITY)], occurrences((0, 0, -1, IDENTITY)))
    assert gltf_issues(tmp_path / "empty.glb")["numErrors"] == 0


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e7])
def test_float32_error_is_measured(offset: float) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-50, 50, (3000, 3)) + offset
    batch = mesh_batch([(points, np.arange(3000).reshape(-1, 3))])
    part = one_colour(batch)
    assert 0.0 < part.float32_error <= np.sqrt(3) * 50 * 2.0**-24
    drawn = part.primitives[0].positions.astype(float) * 1000.0
    back = np.stack([drawn[:, 0], -drawn[:, 2], drawn[:, 1]], axis=1) + part.origin
    assert np.linalg.norm(back - points, axis=1).max() == part.float32_error


def test_triangles_that_rounding_empties_are_dropped() -> None:
    # A fan around a vertex that float32 cannot tell from the corner (0, 0): two of its triangles stay.
    points = np.array([[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0], [1e-9, 1e-9, 0]])
    fan = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    part = one_colour(mesh_batch([(points, fan)]))
    assert part.n_triangles == 2
    assert part.boundary_edges == 4


def test_collinear_triangle_is_flipped() -> None:
    # Vertex 4 lies on the edge 0-1 of the triangle (0, 1, 2): the empty triangle (1, 0, 4) closes the mesh there.
    points = np.array([[0, 0, 0], [64, 0, 0], [32, 64, 0], [32, -64, 0], [32, 0, 0]], dtype=float)
    part = one_colour(mesh_batch([(points, [[0, 1, 2], [1, 0, 4], [0, 3, 4], [3, 1, 4]])]))
    assert (part.n_triangles, part.flat_triangles, part.boundary_edges) == (4, 0, 4)
    p = part.primitives[0]
    assert p.indices is not None
    corners = p.positions.astype(float)[p.indices.reshape(-1, 3)]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(64 * 64 * 1e-6)


def test_chain_of_collinear_triangles_is_flipped() -> None:
    # Three empty triangles stacked on one line below (0, 4, apex).
    points = np.array([[0, 0, 0], [8, 0, 0], [16, 0, 0], [24, 0, 0], [32, 0, 0], [16, 32, 0]], dtype=float)
    part = one_colour(mesh_batch([(points, [[0, 4, 5], [4, 0, 1], [4, 1, 2], [4, 2, 3]])]))
    assert (part.n_triangles, part.flat_triangles, part.boundary_edges) == (4, 0, 6)


def test_collinear_triangle_at_the_rim_stays() -> None:
    points = np.array([[0, 0, 0], [64, 0, 0], [32, 64, 0], [32, 0, 0]], dtype=float)
    part = one_colour(mesh_batch([(points[:3], [[0, 1, 2]]), (points[[1, 0, 3]], [[0, 1, 2]])]))
    assert (part.n_triangles, part.flat_triangles) == (2, 1)


def test_many_vertices_use_wide_indices() -> None:
    n = 65535
    points = np.random.default_rng(2).uniform(0, 1, (n, 3))
    narrow, wide = (one_colour(mesh_batch([(points[:k], np.arange(k).reshape(-1, 3))])) for k in (n - 3, n))
    assert narrow.primitives[0].indices is not None
    assert narrow.primitives[0].indices.dtype == np.uint16
    assert wide.primitives[0].indices is not None
    assert wide.primitives[0].indices.dtype == np.uint32


def test_too_large_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(glb_file, "MAX_BYTES", 1000)
    with pytest.raises(UsageError, match="do not fit a GLB"):
        write(tmp_path / "c.glb", [one_colour(cube())], [Product("b", -1, IDENTITY)], occurrences((0, 0, -1, IDENTITY)))


def test_node_chain_multiplies_back() -> None:
    rng = np.random.default_rng(3)
    to_gltf = np.array([[1e-3, 0, 0, 0], [0, 0, 1e-3, 0], [0, -1e-3, 0, 0], [0, 0, 0, 1]])
    for _ in range(20):
        transform, origin = matrix4(rng.normal(size=12)), rng.normal(size=3)
        product = np.eye(4)
        for node in node_chain(transform, origin):
            product = product @ np.array(node["matrix"]).reshape(4, 4).T
        point = rng.normal(size=3)
        expected = to_gltf @ transform @ np.append(point, 1.0)
        drawn = product @ np.append((to_gltf @ np.append(point - origin, 1.0))[:3], 1.0)
        np.testing.assert_allclose(drawn, expected, atol=1e-14)


def test_stretch() -> None:
    assert stretch([0, -2, 0, 9, 2, 0, 0, 9, 0, 0, 2, 9]) == pytest.approx(2.0)
