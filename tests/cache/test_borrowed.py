"""Arrays lent to compiled functions without reference counts."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt
import pytest
from numba.core.errors import TypingError

from nurbs_cache.borrowed import borrowed
from nurbs_cache.jit import helper, kernel

Floats = npt.NDArray[np.float64]
pytestmark = pytest.mark.kernel
compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="plain Python counts by itself")


class _Pair(NamedTuple):
    a: Floats
    b: Floats
    factor: float


@helper
def _add(pair: _Pair, more: tuple[Floats, None]) -> float:
    total = 0.0
    for part in (pair.a, pair.b[1:], more[0]):
        for x in part:
            total += x
    pair.a[0] = -1.0
    return total * pair.factor


@kernel
def _lend(pair: _Pair, more: tuple[Floats, None]) -> float:
    return _add(borrowed(pair), borrowed(more))


@kernel
def _lend_own(n: int) -> tuple[float, Floats]:
    """Arrays that the kernel makes itself, larger ones again and again, as a workspace grows."""
    a = np.ones(1)
    total = 0.0
    for i in range(n):
        pair = _Pair(a, np.ones(i + 1), 1.0)
        total += _add(borrowed(pair), (borrowed(a), None))
        if len(pair.b) > 0:
            a = np.ones(len(a) + 1)
    return total, a


def test_what_is_borrowed_is_the_same_array() -> None:
    pair = _Pair(np.array([1.0, 2.0]), np.array([10.0, 3.0]), 2.0)
    more = np.array([0.5])
    assert _lend(pair, (more, None)) == 13.0
    assert pair.a[0] == -1.0


def test_lending_leaves_no_reference_behind_and_takes_none() -> None:
    pair, more = _Pair(np.ones(2), np.ones(2), 1.0), np.ones(1)
    before = [sys.getrefcount(x) for x in (pair.a, pair.b, more)]
    for _ in range(100):
        _lend(pair, (more, None))
    assert [sys.getrefcount(x) for x in (pair.a, pair.b, more)] == before


def test_arrays_of_the_kernel_live_as_long_as_it_uses_them() -> None:
    total, last = _lend_own(200)
    # Round i: i + 1 ones of a, i of b, then a whose first has become -1.
    assert total == sum((i + 1) + i + (i + 1) for i in range(200))
    assert np.array_equal(last, np.ones(201))


@compiled
def test_only_arrays_can_be_borrowed() -> None:
    def lend_list(n: int) -> int:
        return len(borrowed([n]))

    with pytest.raises(TypingError, match="can be borrowed"):
        numba.njit(lend_list)(1)
