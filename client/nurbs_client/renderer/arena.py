"""One large buffer that many tiles share, so that a frame takes a handful of draw calls.

Space is handed out first fit from a sorted list of gaps; neighbouring gaps merge when a tile goes. If
nothing fits, the buffer grows to a multiple of its size and the contents are copied on the card.
"""

from __future__ import annotations

import bisect

import moderngl

INITIAL_BYTES = 1 << 20
GROWTH = 2


class BufferArena:
    """A growing buffer of equal elements.

    Args:
        gl: the context.
        element_bytes: size of an element; offsets and counts are in elements.
    """

    def __init__(self, gl: moderngl.Context, element_bytes: int) -> None:
        self._gl = gl
        self._element_bytes = element_bytes
        self._n = max(INITIAL_BYTES // element_bytes, 1)
        self.buffer = gl.buffer(reserve=self._n * element_bytes)
        self._gaps = [(0, self._n)]  # (first, count), sorted, never adjacent
        self.generation = 0  # changes with ``buffer``: whoever has bound it must bind again

    @property
    def n_bytes(self) -> int:
        """Size of the buffer, used or not."""
        return self._n * self._element_bytes

    def put(self, data: bytes | memoryview, count: int) -> int:
        """Store ``count`` elements; returns the offset of the first."""
        if count == 0:
            return 0
        first = self._take(count)
        self.buffer.write(data, offset=first * self._element_bytes)
        return first

    def drop(self, first: int, count: int) -> None:
        """Give the elements back."""
        if count == 0:
            return
        at = bisect.bisect_left(self._gaps, (first, 0))
        self._gaps.insert(at, (first, count))
        for left in (at, at - 1):
            if 0 <= left < len(self._gaps) - 1:
                (a, n), (b, m) = self._gaps[left], self._gaps[left + 1]
                if a + n == b:
                    self._gaps[left : left + 2] = [(a, n + m)]

    def _take(self, count: int) -> int:
        for at, (first, size) in enumerate(self._gaps):
            if size >= count:
                self._gaps[at : at + 1] = [(first + count, size - count)] if size > count else []
                return first
        self._grow(count)
        return self._take(count)

    def _grow(self, count: int) -> None:
        before = self._n
        self._n = max(GROWTH * before, before + count)
        larger = self._gl.buffer(reserve=self._n * self._element_bytes)
        self._gl.copy_buffer(larger, self.buffer, before * self._element_bytes)
        self.buffer.release()
        self.buffer = larger
        self.generation += 1
        self.drop(before, self._n - before)
