"""Exact changes of a B-spline's knots: clamp the ends, unroll a period, cut down to the used spans.

Parameters keep their meaning: the result has the same value at the same parameter.
Points are (n, ...) along axis 0 and homogeneous where the spline is rational.

Source: Boehm, Inserting new knots into B-spline curves (1980); The NURBS Book (1997), A5.1.
"""

from __future__ import annotations

import numpy as np

from nurbs_ooc.geometry.forms import Array


def insert_knot(knots: Array, degree: int, points: Array, t: float) -> tuple[Array, Array]:
    """Insert ``t`` once; t must lie in the domain."""
    k = int(np.searchsorted(knots, t, side="right")) - 1
    first = k - degree + 1
    left, right = knots[first : k + 1], knots[first + degree : k + 1 + degree]
    share = ((t - left) / (right - left)).reshape(-1, *[1] * (points.ndim - 1))
    middle = (1.0 - share) * points[first - 1 : k] + share * points[first : k + 1]
    return np.insert(knots, k + 1, t), np.concatenate([points[:first], middle, points[k:]])


def _start_at(knots: Array, degree: int, points: Array, t: float) -> tuple[Array, Array]:
    """Cut off everything before ``t``, a parameter inside the domain or at its start."""
    while int(np.count_nonzero(knots == t)) < degree:
        knots, points = insert_knot(knots, degree, points, t)
    last = int(np.searchsorted(knots, t, side="right"))
    return np.concatenate([[t], knots[last - degree :]]), points[last - degree - 1 :]


def _mirror(knots: Array, points: Array) -> tuple[Array, Array]:
    return -knots[::-1], points[::-1]


def cut(knots: Array, degree: int, points: Array, t0: float, t1: float) -> tuple[Array, Array]:
    """The same spline over t0..t1 only, clamped; t0 < t1 inside the domain."""
    knots, points = _start_at(knots, degree, points, t0)
    knots, points = _mirror(*_start_at(*_unpack(_mirror(knots, points), degree), -t1))
    return knots, points


def _unpack(spline: tuple[Array, Array], degree: int) -> tuple[Array, int, Array]:
    return spline[0], degree, spline[1]


def extend(knots: Array, degree: int, points: Array, t0: float, t1: float) -> tuple[Array, Array]:
    """A clamped spline continued by its own end polynomials until it covers t0..t1."""
    if t1 > knots[-1]:
        knots, points = _end_at(knots, degree, points, t1)
    if t0 < knots[0]:
        knots, points = _mirror(*_end_at(*_unpack(_mirror(knots, points), degree), -t0))
    return knots, points


def _end_at(knots: Array, degree: int, points: Array, t: float) -> tuple[Array, Array]:
    """Move the end to ``t`` beyond it: de Casteljau's construction on the last piece, extrapolating."""
    last = float(knots[-degree - 2])
    while int(np.count_nonzero(knots == last)) < degree:
        knots, points = insert_knot(knots, degree, points, last)
    share = (t - last) / (float(knots[-1]) - last)
    row, moved = points[-degree - 1 :], []
    for _ in range(degree):
        moved.append(row[0])
        row = (1.0 - share) * row[:-1] + share * row[1:]
    new = np.concatenate([np.array(moved), row])
    return np.concatenate([knots[: -degree - 1], np.full(degree + 1, t)]), np.concatenate([points[: -degree - 1], new])


def clamp(knots: Array, degree: int, points: Array) -> tuple[Array, Array]:
    """The same spline with knots of multiplicity degree + 1 at both ends of its domain."""
    n = len(points)
    if knots[0] == knots[degree] and knots[-1] == knots[n]:
        return knots, points
    return cut(knots, degree, points, float(knots[degree]), float(knots[n]))


def unroll(knots: Array, degree: int, points: Array, t0: float, t1: float) -> tuple[Array, Array]:
    """A closed clamped spline continued by whole turns until it covers t0..t1, then cut to the spans in use."""
    start, end = float(knots[0]), float(knots[-1])
    period = end - start
    slack = 1e-9 * period  # less than this outside the turn is rounding
    first = int(np.floor((t0 - start + slack) / period))
    last = max(int(np.ceil((t1 - end - slack) / period)), first)
    if first == last == 0:
        return knots, points
    inner = [knots[1:-1] + k * period for k in range(first, last + 1)]
    turns = [inner[0], *(turn[degree:] for turn in inner[1:])]
    rows = [points, *([points[1:]] * (last - first))]
    knots = np.concatenate([[start + first * period], *turns, [end + last * period]])
    return used_spans(knots, degree, np.concatenate(rows), t0, t1)


def used_spans(knots: Array, degree: int, points: Array, t0: float, t1: float) -> tuple[Array, Array]:
    """Cut a clamped spline at the knots next to t0..t1 on the outside."""
    slack = 1e-9 * (knots[-1] - knots[0])
    low = int(np.searchsorted(knots, t0 + slack, side="right")) - 1
    high = int(np.searchsorted(knots, t1 - slack, side="left"))
    return cut(knots, degree, points, float(knots[max(low, 0)]), float(knots[min(high, len(knots) - 1)]))
