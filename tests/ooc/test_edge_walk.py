"""Samples of an edge in longest steps: each keeps the demand, none fewer would, and the last is as long as the rest."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.jit import kernel
from nurbs_ooc.tessellation.edge_demand import Demand
from nurbs_ooc.tessellation.edge_walk import walk_edge

pytestmark = pytest.mark.kernel

Floats = npt.NDArray[np.float64]


@kernel
def _walk(d: Demand, n: int, fewest: int, out: Floats, end: int) -> int:
    return walk_edge(d, n, fewest, out, end)


def demand_of(breaks: Floats, demand: Floats, fixed: list[int]) -> Demand:
    n = len(demand)
    flags = np.zeros(n + 1, np.uint8)
    flags[[0, n, *fixed]] = 1
    rest = (np.zeros(n), np.zeros((8, n)), np.zeros(n + 1), np.zeros(n + 1, np.uint8), np.zeros(8))
    return Demand(breaks, flags, demand, *rest)


def walked(d: Demand, fewest: int = 1, room: int = 4000) -> Floats:
    out = np.empty(4000)
    return out[: _walk(d, len(d.demand), fewest, out, room)]


def fewest_steps(breaks: Floats, demand: Floats) -> int:
    """The longest steps one after the other, each end by bisection of what a step may hold."""
    a, steps = breaks[0], 0
    while a < breaks[-1]:
        low, high = a, breaks[-1]
        for _ in range(60):
            b = high if _ == 0 else 0.5 * (low + high)
            met = (breaks[:-1] < b) & (breaks[1:] > a)
            if demand[met].max() * (b - a) ** 2 / 8.0 <= 1.0:
                low = b
                if b == breaks[-1]:
                    break
            else:
                high = b
        a, steps = low, steps + 1
    return steps


@pytest.mark.parametrize("seed", range(20))
def test_steps_keep_the_demand_and_are_the_fewest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 1.0, n))])
    demand = np.exp(rng.normal(3.0, 2.0, n))
    t = walked(demand_of(breaks, demand, []))
    assert t[0] == breaks[0] and t[-1] == breaks[-1] and (np.diff(t) > 0).all()
    for a, b in itertools.pairwise(t):
        met = (breaks[:-1] < b - 1e-12) & (breaks[1:] > a + 1e-12)
        assert demand[met].max() * (b - a) ** 2 / 8.0 <= 1.0 + 1e-9
    assert len(t) - 1 <= fewest_steps(breaks, demand)


def test_steps_of_an_even_edge_are_even() -> None:
    t = walked(demand_of(np.array([0.0, 1.0]), np.array([8.0 * 9.5**2]), []))
    assert len(t) == 11
    assert np.diff(t).min() > 0.75 * np.diff(t).max()


def test_fixed_breaks_are_samples() -> None:
    breaks = np.array([0.0, 0.3, 0.35, 1.0])
    t = walked(demand_of(breaks, np.array([10.0, 0.0, 200.0]), [1, 2]))
    assert np.isin(breaks, t).all()


def test_no_answer_without_room_or_of_too_few_segments() -> None:
    d = demand_of(np.array([0.0, 1.0]), np.array([8.0 * 20.0**2]), [])
    assert len(walked(d)) == 21
    assert len(walked(d, room=20)) == 0 and len(walked(d, fewest=22)) == 0
    assert len(walked(demand_of(np.array([0.0, 1.0]), np.array([np.inf]), []))) == 0
