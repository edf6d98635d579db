"""Clustering and primitives: what they charge against distances measured by brute force."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_ooc.hlod.budget import NodeBudget, Shares
from nurbs_ooc.hlod.cluster import Clusters, cluster_vertices
from nurbs_ooc.hlod.node import FEWEST, reduced
from nurbs_ooc.hlod.primitives import simplify
from nurbs_ooc.hlod.soup import Soup
from tests.ooc.distances import samples_of, to_drawn

NO_LINES, NO_POINTS = np.zeros((0, 2), np.int32), np.zeros(0, np.int32)


def soup_of(positions: npt.ArrayLike, triangles: npt.ArrayLike, lines: npt.ArrayLike = NO_LINES) -> Soup:
    p = np.asarray(positions, float).reshape(-1, 3)
    t = np.asarray(triangles, np.int32).reshape(-1, 3)
    normals = np.zeros((len(p), 3), np.float32)
    normals[:, 2] = 1
    return Soup(p, normals, t, np.asarray(lines, np.int32).reshape(-1, 2), NO_POINTS)


def sphere(n: int) -> Soup:
    """2n x n grid over the unit sphere, seam and poles with vertices of their own."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n + 1), np.linspace(0, np.pi, n + 1), indexing="ij")
    p = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    i, j = (g.ravel() for g in np.meshgrid(np.arange(2 * n), np.arange(n), indexing="ij"))
    a = i * (n + 1) + j
    b = a + n + 1
    triangles = np.concatenate([np.stack([a, b, a + 1], axis=1), np.stack([b, b + 1, a + 1], axis=1)])
    return Soup(p, p.astype(np.float32), triangles.astype(np.int32), NO_LINES, NO_POINTS)


def reduce(soup: Soup, error: float, small_area: float | None = None) -> tuple[Soup, float]:
    area = 12 * error**2 if small_area is None else small_area
    clusters = cluster_vertices(soup.positions, soup.normals, soup.positions.min(axis=0), error / np.sqrt(0.75))
    return simplify(soup, clusters, area, error)


def check_within(before: Soup, after: Soup, charged: float) -> None:
    """Symmetric distance of the two soups <= what was charged, sampled."""
    a = (before.positions, before.triangles, before.lines, before.points)
    b = (after.positions, after.triangles, after.lines, after.points)
    assert to_drawn(samples_of(*a), *b).max() <= charged + 1e-12
    assert to_drawn(samples_of(*b), *a).max() <= charged + 1e-12


@pytest.mark.parametrize("error", [1e-6, 0.05, 0.2, 0.5, 3.0])
def test_sphere_moves_no_further_than_charged(error: float) -> None:
    before = sphere(6)
    after, charged = reduce(before, error)
    assert charged <= error * (1 + 1e-12)
    check_within(before, after, charged)


@pytest.mark.parametrize("most", [0, 300, 10_000])
def test_a_bound_of_primitives_holds_and_what_it_costs_is_charged(most: int) -> None:
    shares = Shares(tessellation_levels=1, quantisation=0.01, point_diagonal=1.0, coarsest_mesh=4)
    before, budget = sphere(10), NodeBudget.of_level(-9, shares)
    whole, _ = reduced(before, before.positions.min(axis=0), budget, 10**9)
    assert len(whole.triangles) > 300
    after, charged = reduced(before, before.positions.min(axis=0), budget, most)
    n = len(after.triangles) + len(after.lines) + len(after.points)
    assert n <= max(most, FEWEST)
    assert (charged <= budget.allowance * (1 + 1e-12)) == (most == 10_000)
    assert charged < 3.0  # no coarser than the sphere itself
    check_within(before, after, charged)
    if most == 10_000:
        assert (after.positions == whole.positions).all()


def test_a_bound_holds_where_cells_are_far_apart() -> None:
    """Ten thousand scattered specks have no surface whose primitives fall with the square of the cell."""
    random = np.random.default_rng(2)
    places = random.uniform(0.0, 1000.0, (10_000, 3))
    corners = places[:, None] + random.uniform(0.0, 1e-3, (10_000, 3, 3))
    before = soup_of(corners, np.arange(30_000))
    shares = Shares(tessellation_levels=1, quantisation=0.01, point_diagonal=1.0, coarsest_mesh=4)
    after, charged = reduced(before, before.positions.min(axis=0), NodeBudget.of_level(0, shares), 500)
    assert 0 < len(after.triangles) + len(after.lines) + len(after.points) <= 500
    drawn = after.positions, after.triangles, after.lines, after.points
    assert to_drawn(places[::50], *drawn).max() <= charged + 1e-2


@pytest.mark.parametrize("seed", range(6))
def test_random_triangles_move_no_further_than_charged(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.random((40, 1, 3))
    corners = centre + rng.normal(size=(40, 3, 3)) * 10.0 ** rng.uniform(-3, -0.5, (40, 1, 1))
    p = corners.reshape(-1, 3)
    lines = rng.integers(0, 120, (10, 2))
    before = soup_of(p, np.arange(120), lines)
    after, charged = reduce(before, 0.06)
    assert charged <= 0.06 * (1 + 1e-12)
    check_within(before, after, charged)


def test_slivers_keep_their_length() -> None:
    # A strip a thousandth of a cell wide: every triangle collapses, yet the strip stays as a line.
    x = np.linspace(0, 10, 11)
    p = np.concatenate([np.stack([x, 0 * x, 0 * x], axis=1), np.stack([x, 0 * x + 1e-4, 0 * x], axis=1)])
    i = np.arange(10)
    t = np.concatenate([np.stack([i, i + 1, i + 11], axis=1), np.stack([i + 1, i + 12, i + 11], axis=1)])
    before = soup_of(p, t)
    after, charged = reduce(before, 0.1)
    assert (len(after.triangles), len(after.lines), len(after.points)) == (0, 10, 0)
    check_within(before, after, charged)


def test_lone_vertices_do_not_move() -> None:
    before = soup_of([[0, 0, 0], [10, 0, 0], [0, 10, 0.3]], [0, 1, 2])
    after, charged = reduce(before, 0.5)
    assert charged == 0.0
    assert (after.positions[after.triangles[0]] == before.positions).all()


def test_welds_what_coincides_and_drops_lines_between_two_triangles() -> None:
    # Two unit squares that meet along x = 1, each with its own vertices and all four sides as segments.
    a = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    p = np.concatenate([a, a + np.array([1, 0, 0])])
    t = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    sides = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4]]
    after, charged = reduce(soup_of(p, t, sides), 1e-3)
    assert charged == 0.0
    assert len(after.positions) == 6
    assert len(after.triangles) == 4
    assert len(after.lines) == 6  # all but the two along x = 1


def test_sharp_edges_keep_two_normals() -> None:
    p = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]]
    soup = soup_of(p, [0, 1, 2, 3, 4, 5])
    soup.normals[3:] = [1, 0, 0]
    after, _ = reduce(soup, 1e-3)
    assert len(after.positions) == 6
    assert len(np.unique(after.positions, axis=0)) == 4
    assert set(map(tuple, after.normals.tolist())) == {(0, 0, 1), (1, 0, 0)}


def test_repeated_triangles_are_drawn_once_but_both_sides_of_a_plate_stay() -> None:
    p = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    after, _ = reduce(soup_of(p, [[0, 1, 2], [1, 2, 0], [0, 2, 1]]), 1e-3)
    assert len(after.triangles) == 2


def test_small_triangles_become_points_only_within_the_allowance() -> None:
    p = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    reach = np.sqrt(0.5)
    after, charged = reduce(soup_of(p, [0, 1, 2]), 0.6, small_area=1.0)
    assert (len(after.triangles), len(after.points)) == (1, 0)
    # With cells small enough to leave the corners alone, the reach alone is charged.
    clusters = cluster_vertices(p, np.zeros((3, 3), np.float32) + np.float32(1), p[0], 0.1)
    after, charged = simplify(soup_of(p, [0, 1, 2]), clusters, 1.0, 0.71)
    assert (len(after.triangles), len(after.points)) == (0, 3)
    assert charged == pytest.approx(reach, rel=1e-12)
    after, charged = simplify(soup_of(p, [0, 1, 2]), clusters, 0.4, 0.71)
    assert len(after.triangles) == 1


@pytest.mark.parametrize(
    "corners", [[0, 0, 4, 0, 1, 1], [0, 0, 1, 0, 0.5, 0.9], [0, 0, 3, 0, 1, 0], [0, 0, 5, 0, 4.9, 0.1]]
)
def test_reach_covers_the_triangle_and_no_more(corners: list[float]) -> None:
    p = np.zeros((3, 3))
    p[:, :2] = np.reshape(corners, (3, 2))
    clusters = cluster_vertices(p, np.ones((3, 3), np.float32), p[0], 1e-3)
    after, charged = simplify(soup_of(p, [0, 1, 2]), clusters, 100.0, 100.0)
    assert len(after.points) == 3
    samples = samples_of(p, np.array([[0, 1, 2]]), NO_LINES, NO_POINTS, 300)
    furthest = np.linalg.norm(samples[:, None] - p[None], axis=2).min(axis=1).max()
    assert furthest <= charged * (1 + 1e-12)
    assert furthest == pytest.approx(charged, abs=0.02)


def test_vertices_are_numbered_by_use_and_all_used() -> None:
    after, _ = reduce(sphere(8), 0.1)
    used = np.concatenate([after.triangles.ravel(), after.lines.ravel(), after.points])
    _, first = np.unique(used, return_index=True)
    assert (np.diff(first) > 0).all()
    assert len(first) == len(after.positions)


def test_normals_stay_unit_where_they_cancel() -> None:
    soup = soup_of([[0, 0, 0], [1e-6, 0, 0], [0, 1e-6, 0]] * 2, [0, 1, 2, 3, 5, 4])
    soup.normals[3:] = [0, 0, -1]
    after, _ = reduce(soup, 1.0)
    assert len(after.points) == 1
    assert np.linalg.norm(after.normals, axis=1) == pytest.approx([1.0])


def test_empty_soup() -> None:
    after, charged = reduce_empty()
    assert charged == 0.0
    assert len(after.positions) == 0


def reduce_empty() -> tuple[Soup, float]:
    soup = soup_of(np.zeros((0, 3)), np.zeros((0, 3)))
    clusters: Clusters = cluster_vertices(soup.positions, soup.normals, np.zeros(3), 1.0)
    return simplify(soup, clusters, 1.0, 1.0)


def test_vertices_far_outside_the_grid_do_not_overflow_it() -> None:
    p = np.array([[-1e9, 0, 0], [1e9, 0, 0], [0, 1e9, 0.5]])
    clusters = cluster_vertices(p, np.ones((3, 3), np.float32), np.zeros(3), 1e-3)
    assert len(clusters.positions) == 3


def test_budget_adds_up_to_the_error() -> None:
    budget = NodeBudget.of_level(
        3, Shares(tessellation_levels=1, quantisation=0.01, point_diagonal=1.0, coarsest_mesh=4)
    )
    assert budget.error == 8.0
    assert 2.0**budget.tessellation_level + budget.allowance + 0.01 * 8 == pytest.approx(8.0)
    assert budget.cell * np.sqrt(3) / 2 == pytest.approx(budget.allowance)
    assert budget.small_area == 3 * 16.0**2
    scales = np.array([1.0, 1.0 + 1e-12, 2.0, 0.5, 1.5])
    assert budget.surface_levels(np.full(5, 1000.0), scales).tolist() == [2, 2, 1, 3, 1]


def test_small_surfaces_share_one_mesh_among_coarse_levels() -> None:
    shares = Shares(tessellation_levels=1, quantisation=0.01, point_diagonal=1.0, coarsest_mesh=4)
    diagonals, ones = np.array([63.9, 64.0, 65.0, 1000.0]), np.ones(4)
    levels = {level: NodeBudget.of_level(level, shares).surface_levels(diagonals, ones).tolist() for level in (2, 3, 5)}
    assert levels == {2: [1, 1, 1, 1], 3: [1, 2, 2, 2], 5: [1, 2, 2, 4]}
