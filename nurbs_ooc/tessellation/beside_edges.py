"""Derivative bounds of surfaces along the pieces of their p-curves: found once, used at every error.

An edge is sampled by what the surfaces beside it do where it runs (see ``edge_demand``). That is bounded over
the box of a p-curve, first over that of a whole piece between knots, whatever the error is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel, leaf
from nurbs_cache.surface_record import POLE
from nurbs_ooc.bounds.curve_bounds import HIGH, LOW
from nurbs_ooc.bounds.curve_pieces import CurvePieces
from nurbs_ooc.bounds.piece_boxes import box_bounds
from nurbs_ooc.bounds.pieces import Pieces
from nurbs_ooc.geometry.ranges import Run, at_once
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A box shrinks by this part of the surface's domain, so that an end at a knot does not look beyond it by roundoff.
HAIR = 1e-12


class BesideEdges(NamedTuple):
    """Rows ``first[k]``, ... are those of the pieces of coedge k's p-curve, in their order."""

    first: Ints  # (n_coedges + 1,)
    bounds: Floats  # (n, 5): |S_u|, |S_v|, |S_uu|, |S_uv|, |S_vv|


@leaf
def bounds_beside(g: Tables, p: Pieces, row: int, pole: bool, piece: Floats, out: Floats) -> None:
    """Derivative bounds (5,) of surface ``row`` over the box in the bounds ``piece`` of a p-curve.

    A pole has no length: there the columns of the whole face decide.
    """
    s = g.surfaces[row]
    u0, u1, v0, v1 = piece[LOW], piece[HIGH], piece[LOW + 1], piece[HIGH + 1]
    if pole:
        u0, u1, v0, v1 = s.u0, s.u1, s.v0, s.v1
    hair_u = min(HAIR * (s.u1 - s.u0), 0.5 * (u1 - u0))
    hair_v = min(HAIR * (s.v1 - s.v0), 0.5 * (v1 - v0))
    box_bounds(g, p, row, u0 + hair_u, u1 - hair_u, v0 + hair_v, v1 - hair_v, out)


@kernel
def _fill(g: Tables, p: Pieces, c: CurvePieces, surfaces: Ints, coedges: Ints, beside: BesideEdges) -> None:
    for i in range(len(coedges)):
        coedge = coedges[i]
        row = surfaces[coedge]
        if row < 0 or g.surfaces[row].status == 3:
            continue
        curve = g.coedges[coedge].pcurve
        pole = g.edges[g.coedges[coedge].edge].curve == POLE
        for k in range(c.first[curve + 1] - c.first[curve]):
            out = beside.bounds[beside.first[coedge] + k]
            bounds_beside(g, p, row, pole, c.bounds[c.first[curve] + k], out)


class BesideEdgesByError:
    """``BesideEdges`` of a part for one error after another; see ``PiecesByError``.

    Args:
        g: the part's tables.
        curves: the pieces of its curves.
        surfaces: (n_coedges,) the surface of each coedge; -1: none.
    """

    def __init__(self, g: Tables, curves: CurvePieces, surfaces: Ints) -> None:
        self._g, self._curves, self._surfaces = g, curves, surfaces
        counts = np.diff(curves.first)[g.coedges["pcurve"]]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._beside = BesideEdges(first, np.zeros((first[-1], 5)))
        self._stale = np.arange(len(g.coedges))

    def at(self, pieces: Pieces, changing: npt.NDArray[np.bool_], run: Run = at_once) -> BesideEdges:
        """The bounds by the ``pieces`` for an error; they hold until the next call.

        Args:
            pieces: those of the surfaces that the mask ``changing`` (n_surfaces,) leaves out are always the same.
            run: maps a kernel over ranges of coedges.
        """
        if len(self._stale):
            g, curves, surfaces, stale, beside = self._g, self._curves, self._surfaces, self._stale, self._beside
            run(lambda low, high: _fill(g, pieces, curves, surfaces, stale[low:high], beside), len(stale))
        self._stale = np.flatnonzero(np.append(changing, False)[self._surfaces])
        return self._beside
