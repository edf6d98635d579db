"""Interval arithmetic on boxes of vectors, as far as derivatives need it.

A row of a box table holds a vector: component c lies between columns 2 c and 2 c + 1. Sums of a few products
are off by some units of roundoff of their terms; who builds a bound on them adds what that may be.

Source: R. E. Moore, "Interval Analysis", 1966, chapter 2.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf

Floats = npt.NDArray[np.float64]


@leaf
def times(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """[a, b] [c, d]."""
    p, q, r, s = a * c, a * d, b * c, b * d
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@leaf
def over(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """[a, b] / [c, d], c > 0."""
    return (a / c if a < 0.0 else a / d), (b / c if b > 0.0 else b / d)


@leaf
def cosines(a: float, b: float) -> tuple[float, float]:
    """Range of cos over [a, b]."""
    x, y = math.cos(a), math.cos(b)
    low, high = min(x, y), max(x, y)
    first, last = math.floor(a / math.pi), math.floor(b / math.pi)
    if last > first:
        # The multiples of pi from first + 1 to last lie inside.
        if last > first + 1 or (first + 1) % 2 == 0:
            high = 1.0
        if last > first + 1 or (first + 1) % 2 != 0:
            low = -1.0
    return low, high


@leaf
def sines(a: float, b: float) -> tuple[float, float]:
    """Range of sin over [a, b]."""
    return cosines(a - 0.5 * math.pi, b - 0.5 * math.pi)


@leaf
def add_scaled(low: float, high: float, x: Floats, i: int, out: Floats, k: int) -> None:
    """``out[k]`` += [low, high] ``x[i]``."""
    for c in range(0, 6, 2):
        p, q = times(low, high, x[i, c], x[i, c + 1])
        out[k, c] += p
        out[k, c + 1] += q


@leaf
def add_cross(factor: float, x: Floats, i: int, y: Floats, j: int, out: Floats, k: int) -> None:
    """``out[k]`` += ``factor`` ``x[i]`` x ``y[j]``, factor >= 0."""
    for c in range(3):
        a, b = 2 * ((c + 1) % 3), 2 * ((c + 2) % 3)
        p, q = times(x[i, a], x[i, a + 1], y[j, b], y[j, b + 1])
        r, s = times(x[i, b], x[i, b + 1], y[j, a], y[j, a + 1])
        out[k, 2 * c] += factor * (p - s)
        out[k, 2 * c + 1] += factor * (q - r)


@leaf
def set_zero(out: Floats, k: int) -> None:
    """``out[k]`` = 0."""
    for c in range(6):
        out[k, c] = 0.0


@leaf
def largest(x: Floats, k: int, components: int) -> float:
    """Largest norm of a vector in ``x[k]``, of its first components."""
    size = 0.0
    for c in range(components):
        size += max(-x[k, 2 * c], x[k, 2 * c + 1]) ** 2
    return math.sqrt(size)


@leaf
def map_linear(matrix: Floats, x: Floats, i: int, out: Floats, k: int) -> None:
    """``out[k]`` = ``matrix`` (9,) times ``x[i]``."""
    for r in range(3):
        low, high = 0.0, 0.0
        for c in range(3):
            m = matrix[3 * r + c]
            p, q = m * x[i, 2 * c], m * x[i, 2 * c + 1]
            low += min(p, q)
            high += max(p, q)
        out[k, 2 * r], out[k, 2 * r + 1] = low, high
