"""Node keys and byte keys."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.keys import NodeKey, number_key, parse_number_key, parse_surface_key, surface_key, tile_key

KEYS = st.builds(NodeKey, st.integers(0, 99_999), st.text("01234567", max_size=30))


def test_text_forms() -> None:
    assert str(NodeKey(3)) == "3"
    assert str(NodeKey(3, "072")) == "3-072"
    assert NodeKey.parse(b"12-70") == NodeKey(12, "70")


@given(KEYS)
def test_round_trip(key: NodeKey) -> None:
    assert NodeKey.parse(str(key)) == key
    assert NodeKey.parse(str(key).encode()) == key


@given(KEYS, st.integers(0, 7))
def test_child_and_parent(key: NodeKey, octant: int) -> None:
    child = key.child(octant)
    assert child.parent == key
    assert child.level == key.level + 1
    assert key < child
    assert key.child(octant) == child


@given(st.lists(KEYS, max_size=8))
def test_order_is_depth_first(keys: list[NodeKey]) -> None:
    assert sorted(keys) == sorted(keys, key=lambda k: (k.material, k.path))


def test_root_has_no_parent() -> None:
    assert NodeKey(5).parent is None
    assert NodeKey(5).level == 0


@pytest.mark.parametrize("text", ["", "-", "1-", "-1", "1-8", "01", "1-07 ", "1-07\n", "a", "1--2", "٣", "1" * 41])
def test_malformed_text(text: str) -> None:
    with pytest.raises(CorruptRecordError, match="node key"):
        NodeKey.parse(text)


def test_refused_values() -> None:
    for make in (lambda: NodeKey(-1), lambda: NodeKey(0, "9"), lambda: NodeKey(0, "0" * 39)):
        with pytest.raises(UsageError):
            make()
    with pytest.raises(UsageError, match="octant 8"):
        NodeKey(0).child(8)
    with pytest.raises(UsageError):
        NodeKey(0, "0" * 38).child(0)


@given(st.lists(st.integers(0, 2**32 - 1), max_size=9))
def test_number_keys_sort_like_numbers(numbers: list[int]) -> None:
    assert [parse_number_key(key) for key in sorted(map(number_key, numbers))] == sorted(numbers)


def test_byte_keys() -> None:
    assert surface_key(258) == b"\0\0\0\0\0\0\1\2"
    assert parse_surface_key(surface_key(258)) == 258
    assert tile_key("00ff" * 8) == bytes.fromhex("00ff" * 8)
    with pytest.raises(CorruptRecordError):
        parse_number_key(b"abc")
    with pytest.raises(CorruptRecordError):
        parse_surface_key(b"abcd")
    for text in ("", "0" * 31, "G" * 32, "A" * 32, b"\xff" * 32):
        with pytest.raises(UsageError):
            tile_key(text)
