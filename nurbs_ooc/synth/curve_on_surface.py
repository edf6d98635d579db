"""Edges inside a patch: curves of the parameter domain carried into space by interpolation.

The image of a p-curve under a B-spline surface has a high degree and a knot wherever it crosses one of
the surface's; a B-spline of degree 5 through its points comes as close as files do (the gap is measured
and stated as the edge's tolerance).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.spline import basis_matrix, clamped_knots, evaluate_surfaces, fit_curves, greville

Array = npt.NDArray[np.float64]

DEGREE = 5


def _project(points: Array, rational: bool) -> Array:
    return points[..., :3] / points[..., 3:] if rational else points


def carried(nets: Array, degrees: tuple[int, int], uv: Array, *, rational: bool) -> Array:
    """(k, m, 3) points of k surfaces (k, n_u, n_v, 3 or 4) on equal spans at uv (k, m, 2)."""
    return _project(evaluate_surfaces(nets, degrees, uv[..., 0], uv[..., 1]), rational)


def add_carried_curves(
    builder: BulkBuilder,
    nets: Array,
    degrees: tuple[int, int],
    uv_at: tuple[Array, Array],
    *,
    rational: bool,
    size: int,
    ends: tuple[Array, Array] | None = None,
    closed: bool = False,
) -> tuple[Rows, Array, Array]:
    """Append one space curve over 0..1 for each of k surfaces.

    Args:
        nets: (k, n_u, n_v, 3 or 4).
        uv_at: the p-curves (k, m, 2) at ``curve_nodes(size)`` and at the places where the gap is measured.
        ends: (k, 3) each: the points where the curves begin and end, exactly.
        closed: they end where they begin.

    Returns:
        Rows of the curves, the largest measured gap of each in mm, and their control points (k, size, 3).
    """
    both = carried(nets, degrees, np.concatenate(uv_at, axis=1), rational=rational)
    points = both[:, :size].copy()
    if ends is not None:
        points[:, 0], points[:, -1] = ends
    if closed:
        points[:, -1] = points[:, 0]
    control = fit_curves(points, DEGREE)
    off = _between(size) @ control - both[:, size:]
    gap = np.sqrt((off**2).sum(axis=2).max(axis=1))
    return builder.curves(DEGREE, clamped_knots(size, DEGREE), control), gap, control


@lru_cache(maxsize=64)
def _between(size: int) -> Array:
    """(m, size) values of the basis functions at ``check_nodes(size)``."""
    return basis_matrix(clamped_knots(size, DEGREE), DEGREE, check_nodes(size))


def curve_nodes(size: int) -> Array:
    """(size,) parameters in 0..1 at which ``add_carried_curves`` interpolates."""
    return greville(size, DEGREE)


def check_nodes(size: int) -> Array:
    """Parameters between them, where the gap is measured."""
    nodes = greville(size, DEGREE)
    return 0.5 * (nodes[1:] + nodes[:-1])
