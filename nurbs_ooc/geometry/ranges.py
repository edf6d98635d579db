"""Kernels that work through a range of items, called for parts of it by whoever has the threads to do so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# ``run(kernel, n)`` calls ``kernel(low, high)`` for ranges that together are range(n); their results in that order.
Run = Callable[[Callable[[int, int], Any], int], list[Any]]


def at_once(kernel: Callable[[int, int], Any], n: int) -> list[Any]:
    """The ``Run`` of one call for all items."""
    return [kernel(0, n)]
