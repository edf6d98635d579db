"""The Huffman coder against a plain one and against the optimum."""

from __future__ import annotations

import contextlib
import heapq
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.huffman import MAX_BITS, code_lengths, decode_huffman, encode_huffman

pytestmark = pytest.mark.kernel

STREAMS = st.binary(min_size=1, max_size=300) | st.builds(
    lambda seed, n, skew: bytes(np.minimum(np.random.default_rng(seed).geometric(skew, n) - 1, 255).astype(np.uint8)),
    st.integers(0, 2**32),
    st.integers(1, 2000),
    st.floats(0.02, 0.9),
)


def plain_codes(lengths: list[int]) -> dict[str, int]:
    """Canonical codes as text of bits."""
    codes, code = {}, 0
    for length in range(1, MAX_BITS + 1):
        for symbol in range(256):
            if lengths[symbol] == length:
                codes[format(code, f"0{length}b")] = symbol
                code += 1
        code *= 2
    return codes


def plain_decode(coded: bytes, n: int) -> bytes:
    """Bit by bit, from the description alone."""
    last = coded[0]
    lengths = [(coded[1 + s // 2] >> (4 * (s % 2))) & 15 if s <= last else 0 for s in range(256)]
    start = 2 + last // 2
    start += -start % 4
    counts = struct.unpack_from("<4I", coded, start)
    codes = plain_codes(lengths)
    symbols = bytearray(n)
    word_at = start + 16
    for k, count in enumerate(counts):
        words = struct.unpack_from(f"<{count}I", coded, word_at)
        word_at += 4 * count
        bits = "".join(format(word, "032b")[::-1] for word in words)
        at = 0
        for i in range(k, n, 4):
            end = at + 1
            while bits[at:end] not in codes:
                end += 1
            symbols[i] = codes[bits[at:end]]
            at = end
        assert len(words) == -(-at // 32)
        assert set(bits[at:]) <= {"0"}
    assert word_at == len(coded)
    return bytes(symbols)


def unlimited_bits(counts: np.ndarray) -> int:
    """Length of the coded text under a Huffman code without a limit."""
    heap = [int(c) for c in counts if c]
    if len(heap) == 1:
        return heap[0]
    heapq.heapify(heap)
    total = 0
    while len(heap) > 1:
        pair = heapq.heappop(heap) + heapq.heappop(heap)
        total += pair
        heapq.heappush(heap, pair)
    return total


def limited_bits(counts: np.ndarray) -> int:
    """The same with codes of at most 12 bits: the cheapest lengths whose Kraft sum is at most 1, tried out."""
    cheapest = np.zeros((1 << MAX_BITS) + 1)  # by the room that is used, in units of 2**-12
    cheapest[1:] = np.inf
    for count in counts:
        longer = np.full_like(cheapest, np.inf)
        for length in range(1, MAX_BITS + 1):
            room = 1 << (MAX_BITS - length)
            longer[room:] = np.minimum(longer[room:], cheapest[:-room] + count * length)
        cheapest = longer
    return int(cheapest.min())


@settings(deadline=None, max_examples=200)
@given(STREAMS)
def test_round_trip_and_plain_path(data: bytes) -> None:
    coded = encode_huffman(np.frombuffer(data, np.uint8))
    assert decode_huffman(coded, len(data)).tobytes() == data
    assert plain_decode(coded, len(data)) == data


@settings(deadline=None)
@given(STREAMS)
def test_lengths_are_optimal_where_the_limit_does_not_bind(data: bytes) -> None:
    counts = np.bincount(np.frombuffer(data, np.uint8), minlength=256)
    lengths = code_lengths(counts).astype(int)
    assert ((lengths > 0) == (counts > 0)).all()
    assert lengths.max() <= MAX_BITS
    if lengths.max() < MAX_BITS:
        assert int((counts * lengths).sum()) == unlimited_bits(counts)


def test_lengths_under_the_limit() -> None:
    """Fibonacci counts want codes of up to 29 bits; the lengths must still be a complete code of 12."""
    counts = np.zeros(256, np.int64)
    a, b = 1, 1
    for symbol in range(30):
        counts[symbol] = a
        a, b = b, a + b
    lengths = code_lengths(counts).astype(int)
    assert lengths[:30].max() == MAX_BITS
    assert sum(2.0**-length for length in lengths[:30]) == 1.0
    assert int((counts * lengths).sum()) == limited_bits(counts[:30])


@pytest.mark.parametrize(
    "data", [b"\0", b"\xff" * 1000, bytes(range(256)), bytes(range(256)) * 40, b"ab", b"\0" * 999 + b"\xff"]
)
def test_extremes(data: bytes) -> None:
    coded = encode_huffman(np.frombuffer(data, np.uint8))
    assert decode_huffman(coded, len(data)).tobytes() == data


def test_truncated_and_wrong_length() -> None:
    data = bytes(range(64)) * 8
    coded = encode_huffman(np.frombuffer(data, np.uint8))
    for length in range(len(coded)):
        with pytest.raises(CorruptRecordError):
            decode_huffman(coded[:length], len(data))
    for length in (0, 1, len(data) // 2, 2 * len(data), 10**6):
        with pytest.raises(CorruptRecordError):
            decode_huffman(coded, length)


def test_damage_is_refused_or_harmless() -> None:
    data = bytes(np.minimum(np.random.default_rng(1).geometric(0.1, 500), 255).astype(np.uint8))
    coded = encode_huffman(np.frombuffer(data, np.uint8))
    random = np.random.default_rng(2)
    for _ in range(2000):
        damaged = bytearray(coded)
        damaged[random.integers(0, len(coded))] ^= 1 << random.integers(0, 8)
        with contextlib.suppress(CorruptRecordError):
            assert len(decode_huffman(bytes(damaged), len(data))) == len(data)
