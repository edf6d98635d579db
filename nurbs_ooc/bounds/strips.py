"""The pieces of a part for one error after another.

All that depends on the error is which strips between knots close together are taken for creases (see
``creases``). Few surfaces have any, so the pieces are found once and only those surfaces are marked anew.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.bounds.creases import has_strips, mark_strips
from nurbs_ooc.bounds.derivatives import BOXES
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, CREASED, FIRST, N_U, N_V, Pieces, any_crease, plain_pieces
from nurbs_ooc.geometry.ranges import Run, at_once
from nurbs_ooc.geometry.surface import NURBS
from nurbs_ooc.geometry.tables import Tables

Ints = npt.NDArray[np.int64]


@kernel
def _find_strips(g: Tables, p: Pieces, found: npt.NDArray[np.bool_]) -> None:
    """Which surfaces have spans so thin that an error may make creases of them."""
    for row in range(len(g.surfaces)):
        n_u, n_v = p.table[row, N_U], p.table[row, N_V]
        if n_u > 0 and n_v > 0 and g.surfaces[row].kind == NURBS:
            at_u, at_v = p.table[row, BREAK_U], p.table[row, BREAK_V]
            found[row] = has_strips(p.breaks[at_u : at_u + n_u + 1], n_u) or has_strips(
                p.breaks[at_v : at_v + n_v + 1], n_v
            )


@kernel
def _mark(p: Pieces, rows: Ints, error: float, out: Pieces) -> None:
    """Write the surfaces ``rows`` of ``p`` to ``out`` with the strips that do not matter to ``error`` as creases."""
    for i in range(len(rows)):
        row = rows[i]
        n_u, n_v = p.table[row, N_U], p.table[row, N_V]
        at_u, at_v, first = p.table[row, BREAK_U], p.table[row, BREAK_V], p.table[row, FIRST]
        last = first + n_u * n_v
        for k in range(at_u, at_v + n_v + 1):
            for m in range(4):
                out.breaks[k, m] = p.breaks[k, m]
        for k in range(first, last):
            for m in range(5):
                out.bounds[k, m] = p.bounds[k, m]
            for m in range(BOXES):
                out.boxes[k, m] = p.boxes[k, m]
        bounds, boxes = out.bounds[first:last], out.boxes[first:last]
        mark_strips(out.breaks[at_u : at_u + n_u + 1], n_u, error, bounds, boxes, True, n_v)
        mark_strips(out.breaks[at_v : at_v + n_v + 1], n_v, error, bounds, boxes, False, n_u)
        out.table[row, CREASED] = any_crease(out, row)


class PiecesByError:
    """The pieces of a part for one error after another: all but thin strips is found once.

    Args:
        g: the part's tables; FAILED surfaces get no pieces.
        run: see ``plain_pieces``.

    Attributes:
        changing: (n_surfaces,) bool, those whose pieces depend on the error.
    """

    def __init__(self, g: Tables, run: Run = at_once) -> None:
        self._plain = plain_pieces(g, run)
        self.changing = np.zeros(len(g.surfaces), np.bool_)
        _find_strips(g, self._plain, self.changing)
        self._rows = np.flatnonzero(self.changing)
        self._marked = self._plain
        if len(self._rows):
            copies = {name: getattr(self._plain, name).copy() for name in ("table", "breaks", "bounds", "boxes")}
            self._marked = self._plain._replace(**copies)

    def at(self, error: float) -> Pieces:
        """The pieces for an error in mm: strips between knots that do not matter to it are creases.

        They hold until the next call.
        """
        if len(self._rows):
            _mark(self._plain, self._rows, error, self._marked)
        return self._marked


def surface_pieces(g: Tables, error: float) -> Pieces:
    """The pieces of all B-spline surfaces of a part for one error, see ``PiecesByError``."""
    return PiecesByError(g).at(error)
