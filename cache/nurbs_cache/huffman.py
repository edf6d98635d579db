"""Canonical Huffman coding of bytes, codes of at most 12 bits, in four bit streams read side by side.

Layout of a coded stream, little-endian::

    1  last symbol that occurs
    .  code lengths of the symbols 0 to last, 4 bits each, the even symbol in the low half
    .  zero bytes up to a multiple of 4
    16 length of each of the four bit streams in words, 4 u32
    .  the four bit streams, words of 32 bits

Symbol i belongs to bit stream i mod 4. Within a word the first bit is the lowest; a code starts with its
most significant bit. Codes are canonical: by ascending length, then by ascending symbol, counting up. A
lone symbol has the code 0 of length 1.

Source: D. Huffman 1952, with two queues (J. van Leeuwen 1976); where a code is too long, package-merge
(L. Larmore and D. Hirschberg, A fast algorithm for optimal length-limited Huffman codes, JACM 37, 1990);
canonical codes, E. Schwartz and B. Kallick 1964.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.jit import helper, kernel

MAX_BITS = 12  # a table of 4096 entries of 2 bytes stays in the first-level cache
N_STREAMS = 4
_WORD = 32

Bytes = npt.NDArray[np.uint8]


def encode_huffman(stream: Bytes) -> bytes:
    """Coded form of a stream of at least one byte."""
    counts = np.empty(256, np.int64)
    _count(stream, counts)
    lengths = code_lengths(counts)
    head = np.zeros(132, np.uint8)
    n_head = _write_head(lengths, head)
    words = np.empty(stream.size * MAX_BITS // _WORD + 2 * N_STREAMS, np.uint32)
    word_counts = np.empty(N_STREAMS, np.uint32)
    n_words = _encode(stream, lengths, _codes(lengths), words, word_counts)
    return b"".join((head[:n_head].data, word_counts.data, words[:n_words].data))


def decode_huffman(coded: bytes | memoryview, length: int) -> Bytes:
    """Inverse of ``encode_huffman``: ``length`` bytes.

    Raises:
        CorruptRecordError: the lengths are no code, or the bit streams do not hold exactly ``length`` symbols.
    """
    if len(coded) < 2:
        raise CorruptRecordError(f"tile: a Huffman stream of {len(coded)} bytes")
    last = coded[0]
    n_head = 2 + last // 2
    start = n_head + (-n_head % 4)
    if len(coded) < start + 4 * N_STREAMS or len(coded) % 4:
        raise CorruptRecordError(f"tile: a Huffman stream of {len(coded)} bytes with {last + 1} symbols")
    packed = np.frombuffer(coded, np.uint8, n_head - 1, 1)
    counts = np.frombuffer(coded, np.uint32, N_STREAMS, start)
    words = np.frombuffer(coded, np.uint32, -1, start + 4 * N_STREAMS).copy()  # aligned
    symbols = np.empty(length, np.uint8)
    table = np.empty(1 << MAX_BITS, np.uint16)
    if int(counts.sum(dtype=np.uint64)) != words.size or not words.size:
        raise CorruptRecordError("tile: a Huffman stream's parts do not fill it")
    if not _fill_table(packed, last, table) or not _decode(words, counts, table, symbols):
        raise CorruptRecordError("tile: a Huffman stream is damaged")
    return symbols


def code_lengths(counts: npt.NDArray[np.int64]) -> Bytes:
    """(256,) lengths of an optimal prefix code of at most 12 bits; 0 for symbols that do not occur."""
    lengths = np.zeros(256, np.uint8)
    order = np.argsort(counts, kind="stable")
    if not _two_queues(counts, order, lengths):
        lengths[:] = 0
        _package_merge(counts, order, lengths)
    return lengths


def _codes(lengths: Bytes) -> npt.NDArray[np.uint32]:
    """(256,) canonical codes, their bits reversed: the first bit is the lowest."""
    codes = np.zeros(256, np.uint32)
    _assign(lengths, codes)
    return codes


@kernel
def _count(stream, counts):  # type: ignore[no-untyped-def]
    """How often each byte occurs; two tables, so that equal neighbours do not wait for one another."""
    odd = np.zeros(256, np.int64)
    counts[:] = 0
    n = stream.shape[0]
    for i in range(0, n - 1, 2):
        counts[stream[i]] += 1
        odd[stream[i + 1]] += 1
    if n & 1:
        counts[stream[n - 1]] += 1
    for symbol in range(256):
        counts[symbol] += odd[symbol]


@kernel
def _write_head(lengths, head):  # type: ignore[no-untyped-def]
    """Last symbol and lengths; number of bytes up to the next multiple of 4."""
    last = 255
    while lengths[last] == 0:
        last -= 1
    head[0] = last
    for symbol in range(last + 1):
        head[1 + (symbol >> 1)] |= lengths[symbol] << np.uint8(4 * (symbol & 1))
    return (2 + last // 2 + 3) // 4 * 4


@kernel
def _two_queues(counts, order, lengths):  # type: ignore[no-untyped-def]
    """Huffman's code from symbols in ascending order of counts; False if a code is longer than 12 bits.

    Leaves and inner nodes wait in a queue each, both ascending, so the two smallest stand in front.
    """
    first = 0
    while first < 256 and counts[order[first]] == 0:
        first += 1
    n = 256 - first
    if n <= 1:
        lengths[order[255]] = 1
        return True
    weight = np.empty(2 * n - 1, np.int64)
    parent = np.zeros(2 * n - 1, np.int32)
    for i in range(n):
        weight[i] = counts[order[first + i]]
    leaf, inner = 0, n
    for made in range(n, 2 * n - 1):
        total = np.int64(0)
        for _ in range(2):
            if leaf < n and (inner >= made or weight[leaf] <= weight[inner]):
                taken = leaf
                leaf += 1
            else:
                taken = inner
                inner += 1
            total += weight[taken]
            parent[taken] = made
        weight[made] = total
    depth = np.zeros(2 * n - 1, np.uint8)
    for node in range(2 * n - 3, -1, -1):
        depth[node] = depth[parent[node]] + 1
        if node < n:
            if depth[node] > MAX_BITS:
                return False
            lengths[order[first + node]] = depth[node]
    return True


@kernel
def _package_merge(counts, order, lengths):  # type: ignore[no-untyped-def]
    """Lengths by collecting coins: at every level pairs of the level below compete with the symbols."""
    first = 0
    while first < 256 and counts[order[first]] == 0:
        first += 1
    n = 256 - first
    if n <= 1:
        lengths[order[255]] = 1
        return
    weights = np.empty((2, 2 * n), np.int64)
    is_symbol = np.zeros((MAX_BITS, 2 * n), np.bool_)
    n_below = 0
    for level in range(MAX_BITS):
        below = weights[(level + 1) & 1]
        here = weights[level & 1]
        i, j, at = 0, 0, 0
        while i < n or 2 * j + 1 < n_below:
            take_symbol = 2 * j + 1 >= n_below
            if i < n and not take_symbol:
                take_symbol = counts[order[first + i]] <= below[2 * j] + below[2 * j + 1]
            is_symbol[level, at] = take_symbol
            if take_symbol:
                here[at] = counts[order[first + i]]
                i += 1
            else:
                here[at] = below[2 * j] + below[2 * j + 1]
                j += 1
            at += 1
        n_below = at
    # take the cheapest 2n - 2 of the top level, and what their pairs are made of
    taken = 2 * n - 2
    for level in range(MAX_BITS - 1, -1, -1):
        n_symbols = 0
        for at in range(taken):
            n_symbols += is_symbol[level, at]
        for i in range(n_symbols):
            lengths[order[first + i]] += 1
        taken = 2 * (taken - n_symbols)


@kernel
def _assign(lengths, codes):  # type: ignore[no-untyped-def]
    code = 0
    for length in range(1, MAX_BITS + 1):
        for symbol in range(256):
            if lengths[symbol] == length:
                for bit in range(length):
                    codes[symbol] |= np.uint32((code >> bit & 1) << (length - 1 - bit))
                code += 1
        code <<= 1


@kernel
def _encode(stream, lengths, codes, words, counts):  # type: ignore[no-untyped-def]
    """Number of words written."""
    at = np.int64(0)
    for k in range(N_STREAMS):
        start = at
        pending = np.uint64(0)
        n_bits = np.uint64(0)
        for i in range(k, stream.shape[0], N_STREAMS):
            symbol = stream[i]
            pending |= np.uint64(codes[symbol]) << n_bits
            n_bits += np.uint64(lengths[symbol])
            # a word that is not full yet is written too and overwritten later: no branch to guess
            words[at] = np.uint32(pending & np.uint64(0xFFFFFFFF))
            full = n_bits >> np.uint64(5)
            at += np.int64(full)
            pending >>= full << np.uint64(5)
            n_bits &= np.uint64(31)
        if n_bits > np.uint64(0):
            words[at] = np.uint32(pending)
            at += 1
        counts[k] = at - start
    return at


@kernel
def _fill_table(packed, last, table):  # type: ignore[no-untyped-def]
    """Entries symbol | length << 8 by the next 12 bits; False if the lengths are no complete code."""
    lengths = np.zeros(256, np.uint8)
    total = np.int64(0)
    n_symbols = 0
    for symbol in range(last + 1):
        length = np.int64((packed[symbol >> 1] >> np.uint8(4 * (symbol & 1))) & np.uint8(15))
        if length > MAX_BITS:
            return False
        lengths[symbol] = length
        if length > 0:
            total += 1 << (MAX_BITS - length)
            n_symbols += 1
    lone = n_symbols == 1 and lengths[last] == 1
    if lengths[last] == 0 or not (lone or total == 1 << MAX_BITS):
        return False
    codes = np.zeros(256, np.uint32)
    _assign(lengths, codes)
    for symbol in range(last + 1):
        length = np.int64(lengths[symbol])
        if length > 0:
            entry = np.uint16(symbol | length << 8)
            step = 1 if lone else 1 << length
            for at in range(0 if lone else np.int64(codes[symbol]), 1 << MAX_BITS, step):
                table[at] = entry
    return True


@helper
def _refill(pending, n_bits, words, at):  # type: ignore[no-untyped-def]
    """At least 32 bits; past the end the last word is read again, which the final check finds out."""
    if n_bits < np.uint64(_WORD):
        word = words[min(at, words.shape[0] - 1)]
        return pending | np.uint64(word) << n_bits, n_bits + np.uint64(_WORD), at + 1
    return pending, n_bits, at


@helper
def _next(pending, n_bits, table):  # type: ignore[no-untyped-def]
    """(symbol, pending, n_bits) after one code."""
    entry = np.uint64(table[pending & np.uint64((1 << MAX_BITS) - 1)])
    length = entry >> np.uint64(8)
    return np.uint8(entry & np.uint64(255)), pending >> length, n_bits - length


@kernel
def _decode(words, counts, table, symbols):  # type: ignore[no-untyped-def]
    """False unless every bit stream ends in its last word."""
    n = symbols.shape[0]
    end0 = np.int64(counts[0])
    end1 = end0 + np.int64(counts[1])
    end2 = end1 + np.int64(counts[2])
    end3 = end2 + np.int64(counts[3])
    at0, at1, at2, at3 = np.int64(0), end0, end1, end2
    p0 = p1 = p2 = p3 = np.uint64(0)
    b0 = b1 = b2 = b3 = np.uint64(0)
    i = 0
    while i + 8 <= n:
        # 32 bits hold two codes of each stream
        p0, b0, at0 = _refill(p0, b0, words, at0)
        p1, b1, at1 = _refill(p1, b1, words, at1)
        p2, b2, at2 = _refill(p2, b2, words, at2)
        p3, b3, at3 = _refill(p3, b3, words, at3)
        symbols[i], p0, b0 = _next(p0, b0, table)
        symbols[i + 1], p1, b1 = _next(p1, b1, table)
        symbols[i + 2], p2, b2 = _next(p2, b2, table)
        symbols[i + 3], p3, b3 = _next(p3, b3, table)
        symbols[i + 4], p0, b0 = _next(p0, b0, table)
        symbols[i + 5], p1, b1 = _next(p1, b1, table)
        symbols[i + 6], p2, b2 = _next(p2, b2, table)
        symbols[i + 7], p3, b3 = _next(p3, b3, table)
        i += 8
    while i < n:
        # the last seven at most: turn the streams so that the next one is always stream 0
        p0, b0, at0 = _refill(p0, b0, words, at0)
        symbols[i], p0, b0 = _next(p0, b0, table)
        p0, p1, p2, p3 = p1, p2, p3, p0
        b0, b1, b2, b3 = b1, b2, b3, b0
        at0, at1, at2, at3 = at1, at2, at3, at0
        end0, end1, end2, end3 = end1, end2, end3, end0
        i += 1
    return _ends(at0, b0, end0) and _ends(at1, b1, end1) and _ends(at2, b2, end2) and _ends(at3, b3, end3)


@helper
def _ends(at, n_bits, end):  # type: ignore[no-untyped-def]
    """Whether a stream was read to its last word and not beyond: at most one whole word is left over."""
    return at - np.int64(n_bits) // _WORD == end
