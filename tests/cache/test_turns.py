"""Numbers taken from one counter by several threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt
import pytest

from nurbs_cache.jit import kernel
from nurbs_cache.turns import new_turns, next_turn

pytestmark = pytest.mark.kernel
Ints = npt.NDArray[np.int64]


@kernel
def _take(turns: Ints, out: Ints) -> int:
    """Take turns until they are as many as ``out`` has room for over all threads; how many."""
    n = 0
    while True:
        turn = next_turn(turns)
        if turn >= len(out):
            return n
        out[turn] += 1
        n += 1


def test_turns_count_from_zero() -> None:
    turns = new_turns()
    out = np.zeros(5, np.int64)
    assert _take(turns, out) == 5
    assert turns[0] == 6  # one was too many
    assert np.array_equal(out, np.ones(5))


def test_each_turn_goes_to_one_thread() -> None:
    turns, n = new_turns(), 20_000
    out = np.zeros(n, np.int64)
    with ThreadPoolExecutor(4) as pool:
        taken = list(pool.map(lambda _: _take(turns, out), range(4)))
    assert sum(taken) == n
    assert np.array_equal(out, np.ones(n))
