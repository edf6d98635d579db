r"""Normals of triangle corners where a surface has several: along its creases and at its poles.

On a crease (a knot of full multiplicity with a kink, or a strip too thin for the error, see ``creases``)
a corner takes the normal of the side that its triangle lies on. At a pole the limit of the normal depends
on the direction in which the pole is left; a corner there takes that of its triangle's middle::

        pole: all (u, v1) are one point                 crease: u = c
      ------x-----x-----x------ v1                          |
             \   m   /          m: half way between     a   |   b      a's normal is taken just left of c,
              a-----b           a and b                 ----x----      b's just right
                                                            |

Parameters of such a corner are those at which its normal was taken.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line
from nurbs_ooc.bounds.creases import HIDDEN, JUMP, REACH, VALUE
from nurbs_ooc.bounds.piece_boxes import find_break
from nurbs_ooc.bounds.pieces import BREAK_U, BREAK_V, N_U, N_V, Pieces
from nurbs_ooc.geometry.surface import POLE_STEPS, normal_of, surface_normal, surface_point, vanishing_partials
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.deviation import Frame

Floats = npt.NDArray[np.float64]

# Steps over a crease are no shorter than this part of the parameter: knots may be large numbers.
SHORTEST_STEP = 2.0**-50


@leaf
def _crease_at(p: Pieces, row: int, along_u: bool, t: float, step: float) -> int:
    """The row in ``p.breaks`` of the crease that lies within ``step`` of parameter ``t`` of one direction, or -1."""
    at = p.table[row, BREAK_U] if along_u else p.table[row, BREAK_V]
    n = p.table[row, N_U] if along_u else p.table[row, N_V]
    if n < 2:
        return -1
    i = find_break(p, at, n, t)
    # The crease that begins last before t, whose strip may hide further breaks, or the one right after t.
    low = i
    while low > 0 and p.breaks[at + low, HIDDEN] > 0.0:
        low -= 1
    for k in (low, i + 1):
        if 0 < k < n and p.breaks[at + k, JUMP] > 0.0:
            b = p.breaks[at + k]
            if b[VALUE] - step <= t <= b[VALUE] + b[REACH] + step:
                return int(at + k)
    return -1


@leaf
def _steps(f: Frame, u: float, v: float) -> tuple[float, float]:
    """How far from a crease its sides begin: a lattice step."""
    return max(f.du, SHORTEST_STEP * abs(u)), max(f.dv, SHORTEST_STEP * abs(v))


@leaf
def on_crease(p: Pieces, row: int, f: Frame, u: float, v: float) -> bool:
    """Whether a B-spline surface has a crease at (u, v), as far as the lattice can tell."""
    step_u, step_v = _steps(f, u, v)
    return _crease_at(p, row, True, u, step_u) >= 0 or _crease_at(p, row, False, v, step_v) >= 0


@leaf
def _beside(p: Pieces, row: int, along_u: bool, t: float, towards: float, step: float) -> float:
    """Parameter ``t``, or, if there is a crease, where its side ``towards`` a triangle's middle begins."""
    k = _crease_at(p, row, along_u, t, step)
    if k < 0:
        return t
    b = p.breaks[k]
    if towards < b[VALUE] + 0.5 * b[REACH]:
        return float(b[VALUE] - step)
    return float(b[VALUE] + b[REACH] + step)


@leaf
def crease_normal(
    g: Tables, p: Pieces, row: int, f: Frame, uv: Floats, middle: Floats, scratch: Floats, out: Floats
) -> None:
    """Normal of the surface beside its creases at ``uv`` (2,), on the side of ``middle`` (2,); moves ``uv`` there."""
    at = local_line(12)
    step_u, step_v = _steps(f, uv[0], uv[1])
    uv[0] = _beside(p, row, True, uv[0], middle[0], step_u)
    uv[1] = _beside(p, row, False, uv[1], middle[1], step_v)
    surface_point(g, row, uv[0], uv[1], scratch, at)
    surface_normal(g, row, uv[0], uv[1], scratch, at, out)


@leaf
def pole_normal(g: Tables, row: int, uv: Floats, middle: Floats, scratch: Floats, out: Floats) -> float:
    """Limit of the outside normal at the pole ``uv`` (2,), coming from ``middle`` (2,) between the other corners.

    Moves ``uv`` along the line that is one point, to where the way from ``middle`` ends. Returns the part of that
    way at which the normal was taken, 1 if it is none of its limit.
    """
    at = local_line(12)
    surface_point(g, row, uv[0], uv[1], scratch, at)
    no_u, no_v = vanishing_partials(g, row, at)
    if no_u and not no_v:
        uv[0] = middle[0]
    elif no_v and not no_u:
        uv[1] = middle[1]
    for step in POLE_STEPS:
        u, v = uv[0] + (middle[0] - uv[0]) * step, uv[1] + (middle[1] - uv[1]) * step
        surface_point(g, row, u, v, scratch, at)
        if normal_of(g, row, at, out):
            if g.surfaces[row].reversed:
                for k in range(3):
                    out[k] = -out[k]
            return step
    surface_point(g, row, uv[0], uv[1], scratch, at)
    surface_normal(g, row, uv[0], uv[1], scratch, at, out)
    return 1.0
