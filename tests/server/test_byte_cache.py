"""The cache keeps what was used last, within its bytes."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from nurbs_server.byte_cache import ByteCache


def test_the_least_recent_go_first() -> None:
    cache: ByteCache[str, int] = ByteCache(80)
    for i in range(8):
        cache.put(f"{i}", i, 10)
    assert cache.get("0") == 0  # used again
    cache.put("new", 9, 10)
    assert cache.get("1") is None
    assert cache.get("0") == 0
    assert (len(cache), cache.n_bytes) == (8, 80)


def test_a_giant_is_not_kept() -> None:
    cache: ByteCache[str, int] = ByteCache(80)
    cache.put("giant", 1, 11)
    assert cache.get("giant") is None


def test_drop_and_replace() -> None:
    cache: ByteCache[str, int] = ByteCache(80)
    cache.put("a", 1, 10)
    cache.put("a", 2, 5)
    assert (cache.get("a"), cache.n_bytes) == (2, 5)
    cache.drop("a")
    cache.drop("a")
    assert (len(cache), cache.n_bytes) == (0, 0)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 30))))
def test_never_beyond_the_budget(puts: list[tuple[int, int]]) -> None:
    cache: ByteCache[int, int] = ByteCache(100)
    for key, n_bytes in puts:
        cache.put(key, key, n_bytes)
        assert cache.n_bytes <= 100
