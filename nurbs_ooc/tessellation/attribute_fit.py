"""A function over a rectangle as a cubic B-spline that is made finer where it misses the function.

Between given kinks the B-spline is twice smooth, at them continuous. Intervals that miss the function are halved, in
the direction that misses it, so a function that grows without end towards a border is followed as far as SHORTEST.
What is still missed is found at two places between the nodes each way, and told for each pair of intervals.

Source: C. de Boor, "A Practical Guide to Splines", 2001, chapter XIII (interpolation at Greville's places).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_ooc.geometry.forms import bspline_basis

Floats = npt.NDArray[np.float64]
# (n_u,) and (n_v,) places in 0..1 -> (n_u, n_v, 3) values.
Ask = Callable[[Floats, Floats], Floats]

DEGREE = 3
FEWEST, MOST = 6, 64  # intervals each way
SHORTEST = 2.0**-9  # of the rectangle: shorter intervals are not halved
BETWEEN = (0.3, 0.7)  # shares of an interval, where it is looked at
# Times the most that is found there: for the values between the corners and for those at them, and twice for luck.
MISSED = 4.0
ROUNDS = 8
# Values at the rectangle's border are continued from two places so far inside: a pole may have none.
INSET = 1e-3


class Fit(NamedTuple):
    """The B-spline over 0..1 each way.

    Attributes:
        knots_u, knots_v: clamped.
        net: (n_u, n_v, 3) control points.
        missed: (n_u - 3, n_v - 3) by knot span, empty ones too: what the function may be off by there.
    """

    knots_u: Floats
    knots_v: Floats
    net: Floats
    missed: Floats


class _Line(NamedTuple):
    knots: Floats
    nodes: Floats  # (n,) where the function is taken
    matrix: Floats  # (n, n) from control points to values there
    inverse: Floats  # (n, n) and back
    between: Floats  # (2 m,) where it is looked at, two in each of m intervals
    basis: Floats  # (2 m, n) there
    span: npt.NDArray[np.int64]  # (m,) of an interval


@lru_cache(maxsize=64)
def _line(places: tuple[float, ...], kinks: frozenset[float]) -> _Line:
    """One direction with its ``places`` between intervals, 0 and 1 among them."""
    inner = [t for t in places[1:-1] for _ in range(DEGREE if t in kinks else 1)]
    knots = np.array([0.0] * (DEGREE + 1) + inner + [1.0] * (DEGREE + 1))
    nodes = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(len(knots) - DEGREE - 1)])
    matrix = np.array([bspline_basis(knots, DEGREE, float(t)) for t in nodes])
    at = np.array(places)
    between = (at[:-1, None] + np.diff(at)[:, None] * np.array(BETWEEN)).reshape(-1)
    basis = np.array([bspline_basis(knots, DEGREE, float(t)) for t in between])
    span = np.searchsorted(knots, 0.5 * (at[:-1] + at[1:]), side="right") - 1 - DEGREE
    return _Line(knots, nodes, matrix, np.linalg.inv(matrix), between, basis, span)


def _first_places(kinks: frozenset[float]) -> tuple[float, ...]:
    """Kinks, and what makes intervals short enough."""
    ends = [0.0, *sorted(kinks), 1.0]
    places = [0.0]
    for a, b in pairwise(ends):
        n = max(1, int(np.ceil(FEWEST * (b - a))))
        places += [a + (b - a) * k / n for k in range(1, n)] + [b]
    return tuple(places)


def _continued(values: Floats, axis: int) -> Floats:
    """Two rows at either end, one at INSET and one at twice that, become the one on the border."""
    v = np.moveaxis(values, axis, 0)
    return np.moveaxis(np.concatenate([2.0 * v[:1] - v[1:2], v[2:-2], 2.0 * v[-1:] - v[-2:-1]]), 0, axis)


def _inside(nodes: Floats) -> Floats:
    ends = np.array([INSET, 2.0 * INSET])
    return np.concatenate([ends, nodes[1:-1], 1.0 - ends[::-1]])


def _halved(places: tuple[float, ...], off: Floats, tolerance: float) -> tuple[float, ...]:
    """Places with a new one in each interval that is off by more, the worst first while there is room."""
    at = np.array(places)
    bad = np.flatnonzero((off > tolerance) & (np.diff(at) > SHORTEST))
    worst = bad[np.argsort(-off[bad], kind="stable")][: max(MOST - len(off), 0)]
    return tuple(np.sort(np.concatenate([at, 0.5 * (at[worst] + at[worst + 1])])).tolist())


def _largest(off: Floats) -> Floats:
    """Rows of ``off`` two by two: the largest of each two, over all columns."""
    return np.asarray(off.max(axis=1).reshape(-1, 2).max(axis=1))


def fit(ask: Ask, kinks_u: frozenset[float], kinks_v: frozenset[float], tolerance: float) -> Fit:
    """Interpolate until no more than ``tolerance`` is missed, or there are MOST intervals.

    Args:
        ask: the function.
        kinks_u, kinks_v: places inside 0..1 where its first derivatives may jump; beyond MOST they are not minded.
        tolerance: in the function's unit.
    """
    kinks_u, kinks_v = (k if len(k) < MOST else frozenset() for k in (kinks_u, kinks_v))
    places_u, places_v = _first_places(kinks_u), _first_places(kinks_v)
    for _ in range(ROUNDS):
        u, v = _line(places_u, kinks_u), _line(places_v, kinks_v)
        values = _continued(_continued(ask(_inside(u.nodes), _inside(v.nodes)), 0), 1)
        net = np.einsum("ij,jkc,lk->ilc", u.inverse, values, v.inverse, optimize=True)
        half = np.einsum("ij,jkc->ikc", u.basis, net)
        whole = np.einsum("ikc,lk->ilc", half, v.basis)
        off = MISSED * np.linalg.norm(whole - ask(u.between, v.between), axis=2)
        missed = np.stack([_largest(off[:, k : k + 2]) for k in range(0, off.shape[1], 2)], axis=1)
        if missed.max() <= tolerance:
            break
        # On the nodes' lines of one direction only the other one is to blame.
        along_u = np.einsum("ikc,lk->ilc", half, v.matrix[1:-1]) - ask(u.between, v.nodes[1:-1])
        other = np.einsum("ij,jkc->ikc", u.matrix[1:-1], net)
        along_v = np.einsum("ikc,lk->ilc", other, v.basis) - ask(u.nodes[1:-1], v.between)
        off_u = MISSED * _largest(np.linalg.norm(along_u, axis=2))
        off_v = MISSED * _largest(np.linalg.norm(along_v, axis=2).T)
        next_u, next_v = _halved(places_u, off_u, 0.5 * tolerance), _halved(places_v, off_v, 0.5 * tolerance)
        if next_u == places_u and next_v == places_v:
            break
        places_u, places_v = next_u, next_v
    by_span = np.zeros((len(u.nodes) - DEGREE, len(v.nodes) - DEGREE))
    by_span[np.ix_(u.span, v.span)] = missed
    return Fit(u.knots, v.knots, net, by_span)
