"""Pieces of all curves of a part between their knots, each with its bounds: computed once, looked up often."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_ooc.bounds.curve_bounds import NURBS, SIZE, curve_bounds
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Pieces shorter than this part of the curve's range are left to their neighbours.
SHORTEST = 1e-12


class CurvePieces(NamedTuple):
    """Pieces ``first[c]:first[c + 1]`` of curve c follow one another along its used range."""

    first: Ints  # (n_curves + 1,)
    start: Floats  # (n_pieces,) parameter at which a piece begins
    bounds: Floats  # (n_pieces, SIZE), see ``curve_bounds``


@leaf
def _next_break(g: Tables, row: int, at: float, i: int) -> tuple[float, int]:
    """The first knot of curve ``row``, from number ``i`` on, clearly beyond ``at``, and the next number.

    The end of the curve's range if there is none.
    """
    c = g.curves[row]
    if c.kind == NURBS:
        clear = SHORTEST * (c.t1 - c.t0)
        while i < c.n:
            knot = g.values[c.knots + i]
            i += 1
            if knot > at + clear and knot < c.t1 - clear:
                return float(knot), i
    return float(c.t1), i


@kernel
def _count(g: Tables, counts: Ints) -> None:
    for row in range(len(g.curves)):
        c = g.curves[row]
        # What ``sound_tables`` refuses has no pieces: faces along it are FAILED, and nobody asks.
        if not c.t0 < c.t1 or (c.kind == NURBS and not 0 < c.degree <= min(MAX_DEGREE, c.n - 1)):
            continue
        at = c.t0
        i = c.degree + 1
        while at < c.t1:
            at, i = _next_break(g, row, at, i)
            counts[row] += 1


@kernel
def _fill(g: Tables, p: CurvePieces) -> None:
    for row in range(len(g.curves)):
        at = g.curves[row].t0
        i = g.curves[row].degree + 1
        for k in range(p.first[row], p.first[row + 1]):
            end, i = _next_break(g, row, at, i)
            p.start[k] = at
            curve_bounds(g, row, at, end, p.bounds[k])
            at = end


def curve_pieces(g: Tables) -> CurvePieces:
    """Bounds of every piece of every curve of a part.

    Args:
        g: the part's tables, sound (see ``sound_tables``).

    Returns:
        The pieces; a curve of which none can be made has none.
    """
    counts = np.zeros(len(g.curves), np.int64)
    _count(g, counts)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    pieces = CurvePieces(first, np.zeros(first[-1]), np.zeros((first[-1], SIZE)))
    _fill(g, pieces)
    return pieces


@leaf
def piece_at(p: CurvePieces, row: int, t: float) -> int:
    """The piece of curve ``row`` that holds ``t``; the curve has one at least."""
    low = p.first[row]
    high = p.first[row + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if p.start[middle] <= t:
            low = middle
        else:
            high = middle
    return low
