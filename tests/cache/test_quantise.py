"""Grids and octahedral normals."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from nurbs_cache.errors import UsageError
from nurbs_cache.mesh_decoder import decode_mesh
from nurbs_cache.planes import encode_vertices
from nurbs_cache.quantise import (
    box_of,
    choose_grid,
    normal_error_deg,
    quantise_normals,
    quantise_positions,
)

pytestmark = pytest.mark.kernel

COORDINATES = (
    st.floats(-1e12, 1e12)
    | st.floats(-1e-170, 1e-170)
    | st.floats(-1.0, 1.0)
    | st.just(0.0)
    | st.floats(1e6, 1e6 + 1e-3)
)
POSITIONS = hnp.arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=COORDINATES)
BITS = st.integers(8, 21)


@settings(deadline=None)
@given(POSITIONS, BITS)
def test_moved_distance_is_a_tight_bound(positions: np.ndarray, bits: int) -> None:
    box = box_of(positions)
    grid = choose_grid(box[0], box[1], bits)
    steps, moved = quantise_positions(positions, grid)
    assert steps.min() >= 0
    assert (steps <= grid.extent).all()
    assert max(grid.extent) < 2**bits
    exact = [
        sum(
            (Fraction(x) - Fraction(o) - Fraction(grid.step) * int(s)) ** 2
            for x, o, s in zip(p, grid.origin, q, strict=True)
        )
        for p, q in zip(positions, steps, strict=True)
    ]
    assert Fraction(moved) ** 2 >= max(exact)
    normal = moved > 2e-140 * grid.step and moved > 1e-300
    tight = 1 + Fraction(1, 2**45) if normal else Fraction(9001, 1000)  # the least float, three times
    assert Fraction(moved) ** 2 <= max(exact) * tight
    assert moved <= math.sqrt(0.75) * grid.step * (1 + 1e-12)


@settings(deadline=None)
@given(POSITIONS, POSITIONS, BITS, st.integers(-20, 10))
def test_equal_positions_stay_equal_in_tiles_of_one_step(
    a: np.ndarray, b: np.ndarray, bits: int, exponent: int
) -> None:
    shared = a[:1]
    places = []
    for positions in (np.concatenate([shared, a]), np.concatenate([b, shared])[::-1]):
        box = box_of(positions)
        grid = choose_grid(box[0], box[1], bits, min_exponent=exponent)
        steps, _ = quantise_positions(np.ascontiguousarray(positions), grid)
        places.append((grid.step, [o + int(s) * grid.step for o, s in zip(grid.origin, steps[0], strict=True)]))
    if places[0][0] == places[1][0]:
        assert places[0] == places[1]


def test_grid_of_a_known_box() -> None:
    grid = choose_grid((0.0, 0.0, 5.0), (1.0, 0.5, 5.0), 8)
    assert grid.step == 2.0**-7  # 254 steps would do for 2**-8 * 254 < 1
    assert grid.extent == (128, 64, 0)
    assert grid.origin == (0.0, 0.0, 5.0)


def test_zero_extent_is_exact() -> None:
    positions = np.full((3, 3), 1234.56789)
    box = box_of(positions)
    grid = choose_grid(box[0], box[1], 16)
    steps, moved = quantise_positions(positions, grid)
    assert moved == 0.0
    assert grid.origin == (1234.56789,) * 3
    assert (steps == 0).all()


def test_far_origin_keeps_integers_exact() -> None:
    positions = np.array([[1e15, 0.0, 0.0], [1e15 + 1.0, 1e-9, 0.0]])
    box = box_of(positions)
    grid = choose_grid(box[0], box[1], 21)
    steps, moved = quantise_positions(positions, grid)
    assert grid.origin[0] / grid.step <= 2.0**53
    assert moved < 0.1
    assert steps[1, 0] > steps[0, 0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_not_finite(bad: float) -> None:
    positions = np.zeros((4, 3))
    positions[2, 1] = bad
    with pytest.raises(UsageError, match="vertex 2"):
        box_of(positions)
    normals = np.ones((4, 3), np.float32)
    normals[3, 2] = bad
    with pytest.raises(UsageError, match="vertex 3"):
        quantise_normals(normals, 10)
    with pytest.raises(UsageError, match="finite"):
        choose_grid((0, 0, bad), (1, 1, 1), 16)


def test_options_out_of_range() -> None:
    for bits in (7, 22):
        with pytest.raises(UsageError, match=f"{bits} bits"):
            choose_grid((0, 0, 0), (1, 1, 1), bits)
    for bits in (7, 13):
        with pytest.raises(UsageError, match=f"{bits} bits"):
            quantise_normals(np.ones((1, 3), np.float32), bits)
    with pytest.raises(UsageError, match="finite"):
        choose_grid((0, 0, 0), (2.0**61, 1, 1), 16)


def _through(normals: np.ndarray, bits: int) -> np.ndarray:
    """Encode and decode."""
    n = len(normals)
    octahedral = quantise_normals(np.ascontiguousarray(normals, np.float32), bits)
    predictors = np.repeat(np.maximum(np.arange(n) - 1, 0).astype(np.int32)[:, None], 3, axis=1)
    steps, order = np.zeros((n, 3), np.int32), np.arange(n, dtype=np.int32)
    _, planes = encode_vertices(steps, octahedral, order, predictors, (0, 0, 0), bits)
    none, flat = np.zeros(0, np.uint8), np.zeros(3 * n, np.uint8)
    parts = planes[0].reshape(-1), planes[1:].reshape(-1)
    return decode_mesh(none, none, (flat, none), parts, n, (0, 0, 0), 1.0, bits).normals


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_normals_stay_within_the_stated_angle(bits: int) -> None:
    random = np.random.default_rng(bits)
    normals = random.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:8] = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3.0)
    decoded = _through(normals, bits).astype(np.float64)
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1.0).max() < 3e-7
    angle = np.degrees(2.0 * np.arcsin(np.minimum(np.linalg.norm(decoded - normals, axis=1) / 2.0, 1.0)))
    assert angle.max() <= normal_error_deg(bits)
    assert angle.max() > 0.5 * normal_error_deg(bits)


def test_axis_directions_are_exact() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    for bits in (8, 9, 10, 11, 12):
        assert (_through(axes, bits) == axes).all()


def test_zero_and_odd_lengths() -> None:
    normals = np.array([[0, 0, 0], [0, 0, -1e-38], [3e37, 0, 0], [0, -1e-20, 0], [-0.0, -0.0, -0.0]])
    assert _through(normals, 10).tolist() == [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0, 0, 1]]


def test_empty() -> None:
    assert _through(np.zeros((0, 3)), 10).shape == (0, 3)
