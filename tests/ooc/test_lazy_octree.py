"""The lazy octree against the paper's steps written out in plain Python, and its invariants."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.node_record import ITEM_DTYPE
from nurbs_ooc.hierarchy.lazy_octree import MAX_DEPTH, MIN_LEVEL, build_lazy_octree, level_of_edge

R = 256.0


def make_items(low: npt.ArrayLike, high: npt.ArrayLike) -> npt.NDArray[np.void]:
    low = np.asarray(low, float).reshape(-1, 3)
    items = np.zeros(len(low), ITEM_DTYPE)
    items["surface"] = np.arange(len(low))
    items["aabb_min"], items["aabb_max"] = low, np.asarray(high, float).reshape(-1, 3)
    return items


def random_items(seed: int, n: int, size: float = 0.02) -> npt.NDArray[np.void]:
    rng = np.random.default_rng(seed)
    centre = rng.random((n, 3)) * [100.0, 60.0, 20.0]
    half = 100 * size * rng.random((n, 3)) * 2.0 ** rng.integers(-6, 3, (n, 1))
    return make_items(centre - half, centre + half)


def reference(boxes: dict[int, tuple[list[float], list[float]]], r: float) -> tuple[set[int], dict[int, tuple]]:
    """Paper 004, 3.1, bullet for bullet: (direct surfaces, {octant: child}); axes below the error are flat."""
    low = [min(b[0][k] for b in boxes.values()) for k in range(3)]
    high = [max(b[1][k] for b in boxes.values()) for k in range(3)]
    edges = [high[k] - low[k] for k in range(3)]
    axes = [k for k in range(3) if edges[k] >= max(edges) / r]
    direct = {i for i, (a, b) in boxes.items() if any(b[k] - a[k] > edges[k] / 2 for k in axes)}
    cells: dict[int, dict[int, tuple[list[float], list[float]]]] = {}
    for i, (a, b) in boxes.items():
        if i not in direct:
            octant = sum(1 << k for k in range(3) if (a[k] / 2 + b[k] / 2) >= (low[k] / 2 + high[k] / 2))
            cells.setdefault(octant, {})[i] = (a, b)
    for octant in [o for o, held in cells.items() if len(held) == 1]:
        direct |= set(cells.pop(octant))
    if any(len(held) == len(boxes) for held in cells.values()):
        return set(boxes), {}
    return direct, {octant: reference(held, r) for octant, held in sorted(cells.items())}


def as_tree(nodes: npt.NDArray[np.void], items: npt.NDArray[np.void], row: int) -> tuple[set[int], dict[int, tuple]]:
    node = nodes[row]
    direct = set(items["surface"][node["first_item"] : node["first_item"] + node["n_direct"]].tolist())
    children = range(node["first_child"], node["first_child"] + node["n_children"])
    return direct, {int(chr(nodes["key"][c][-1])): as_tree(nodes, items, c) for c in children}


def check_invariants(nodes: npt.NDArray[np.void], items: npt.NDArray[np.void], r: float = R) -> None:
    assert sorted(items["surface"].tolist()) == list(range(len(items)))
    assert nodes["n_direct"].sum() == len(items)
    assert len(set(nodes["key"].tolist())) == len(nodes)
    for row, node in enumerate(nodes):
        held = items[node["first_item"] : node["first_item"] + node["n_items"]]
        assert (held["aabb_min"].min(axis=0) == node["aabb_min"]).all()
        assert (held["aabb_max"].max(axis=0) == node["aabb_max"]).all()
        assert (held["node"][: node["n_direct"]] == row).all()
        next_item = node["first_item"] + node["n_direct"]
        for child in nodes[node["first_child"] : node["first_child"] + node["n_children"]]:
            assert child["parent"] == row
            assert child["first_item"] == next_item
            assert child["n_items"] >= 2
            assert child["level"] <= node["level"]
            assert child["key"].startswith(node["key"])
            next_item += child["n_items"]
        assert next_item == node["first_item"] + node["n_items"]
        edges, node_edges = held["aabb_max"] - held["aabb_min"], node["aabb_max"] - node["aabb_min"]
        solid = node_edges >= node_edges.max() / r
        assert not (edges[node["n_direct"] :] > node_edges / 2)[:, solid].any()


@pytest.mark.parametrize(("seed", "n"), [(1, 2), (2, 9), (3, 60), (4, 400), (5, 1500)])
@pytest.mark.parametrize("r", [np.inf, 256.0, 8.0], ids=["exact", "fine", "coarse"])
def test_equals_the_papers_steps(seed: int, n: int, r: float) -> None:
    items = random_items(seed, n)
    nodes, placed = build_lazy_octree(items, np.zeros(n, int), r)
    boxes = {i: (row["aabb_min"].tolist(), row["aabb_max"].tolist()) for i, row in enumerate(items)}
    assert as_tree(nodes, placed, 0) == reference(boxes, r)
    check_invariants(nodes, placed, r)


def test_one_root_for_each_material_and_rows_run_on() -> None:
    items = random_items(7, 300)
    materials = np.arange(300) % 3 * 5
    nodes, placed = build_lazy_octree(items, materials, R)
    check_invariants(nodes, placed)
    roots = np.flatnonzero(nodes["parent"] < 0)
    assert nodes["material"][roots].tolist() == [0, 5, 10]
    assert nodes["key"][roots].tolist() == [b"0", b"5", b"10"]
    assert (nodes["material"][placed["node"]] == materials[placed["surface"]]).all()
    # A root's subtree is one run of rows.
    for root, end in zip(roots, [*roots[1:], len(nodes)], strict=True):
        assert (nodes["material"][root:end] == nodes["material"][root]).all()


def test_large_surface_is_a_direct_surface_of_the_root() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3)
    items = make_items(np.vstack([grid, [0, 0, 1.0]]), np.vstack([grid + 0.5, [3.0, 0.5, 1.2]]))
    nodes, placed = build_lazy_octree(items, np.zeros(65, int), R)
    assert placed["surface"][: nodes["n_direct"][0]].tolist() == [64]
    assert nodes["n_children"][0] == 8


def test_single_surface_of_an_octant_goes_to_the_parent() -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [9, 9, 9], [0, 9, 0]], float)
    nodes, placed = build_lazy_octree(make_items(corners, corners + 0.5), np.zeros(4, int), R)
    assert placed["surface"].tolist() == [2, 3, 0, 1]
    assert nodes["n_direct"].tolist() == [2, 2]
    assert nodes["key"].tolist() == [b"0", b"0-0"]


@pytest.mark.parametrize(
    ("low", "high", "n_nodes"),
    [
        ([[1, 2, 3]] * 50, [[1, 2, 3]] * 50, 1),  # the same point
        ([[1, 2, 3]] * 50, [[2, 3, 4]] * 50, 1),  # the same box
        ([[-1e300] * 3, [0] * 3, [9e299] * 3], [[-9e299] * 3, [1] * 3, [1e300] * 3], 2),  # huge
        (np.nextafter(1e9, 2e9) * np.ones((5, 3)), 1e9 * np.ones((5, 3)) + 1e-6, 1),  # one rounding step long
        ([[5, 5, 5]], [[6, 6, 6]], 1),  # one item
    ],
    ids=["point", "box", "huge", "ulp", "one"],
)
def test_degenerate(low: npt.ArrayLike, high: npt.ArrayLike, n_nodes: int) -> None:
    items = make_items(low, high)
    nodes, placed = build_lazy_octree(items, np.zeros(len(items), int), R)
    check_invariants(nodes, placed)
    assert len(nodes) == n_nodes


def test_empty() -> None:
    nodes, placed = build_lazy_octree(np.zeros(0, ITEM_DTYPE), np.zeros(0, int), R)
    assert len(nodes) == 0
    assert len(placed) == 0


def test_depth_is_bounded() -> None:
    # Two points at every scale down to the smallest numbers: each level peels off one pair.
    x = np.array([[2.0**-k, 0, 0] for k in range(200) for _ in range(2)] + [[0, 0, 0]] * 2)
    nodes, placed = build_lazy_octree(make_items(x, x), np.zeros(len(x), int), R)
    check_invariants(nodes, placed)
    assert max(len(key.partition(b"-")[2]) for key in nodes["key"].tolist()) == MAX_DEPTH


def test_flat_assembly_is_split_in_its_plane() -> None:
    x = np.stack(np.meshgrid(np.arange(16.0), np.arange(16.0), [3.0]), axis=-1).reshape(-1, 3)
    nodes, placed = build_lazy_octree(make_items(x, x + np.array([0.9, 0.9, 0.0])), np.zeros(256, int), R)
    check_invariants(nodes, placed)
    assert nodes["n_direct"][0] == 0
    assert nodes["n_children"][0] == 4


def test_thickness_below_the_error_does_not_make_direct_surfaces() -> None:
    # Flat faces whose boxes are a hair thick, as a certified error or a rotation leaves them.
    x = np.stack(np.meshgrid(np.arange(16.0), np.arange(16.0), [3.0]), axis=-1).reshape(-1, 3)
    items = make_items(x - [0, 0, 1e-7], x + np.array([0.9, 0.9, 1e-7]))
    assert build_lazy_octree(items, np.zeros(256, int), np.inf)[0]["n_direct"][0] == 256
    nodes, placed = build_lazy_octree(items, np.zeros(256, int), R)
    check_invariants(nodes, placed)
    assert nodes["n_direct"][0] == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_refuses_boxes_that_are_not_finite(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        build_lazy_octree(make_items([[0, 0, 0]], [[1, 1, bad]]), np.zeros(1, int), R)


def test_level_is_the_largest_power_of_two_within_the_budget() -> None:
    edges = np.array([256.0, 255.999, 257.0, 1.0, 0.0, 5e-324])
    assert level_of_edge(edges, 256.0).tolist() == [0, -1, 0, -8, MIN_LEVEL, MIN_LEVEL]
