"""Sheets of patches without thickness, and closed shells: an outer and an inner sheet joined by rims.

::

      outer  +-----+-----+         u x v points to the outside of the outer sheet;
             |     |     |  rim    the inner sheet has the same parameters and is marked reversed
      inner  +-----+-----+
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.outline import LINE_KNOTS
from nurbs_ooc.synth.patch_grid import Division, PatchGrid, add_outlines, add_patch_grid
from nurbs_ooc.synth.punched import Holes, punch_sheet, punch_shell
from nurbs_ooc.synth.solid import four_sides
from nurbs_ooc.synth.spline import clamped_knots

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Looks:
    """What the patches of a sheet are, apart from their shape.

    Attributes:
        rational: (k, l) which have weights, None: none.
        material: one for all or (k, l).
        holes: None: none.
        rng: for the weights.
    """

    rational: Flags | None = None
    material: int | npt.NDArray[np.integer] = 0
    holes: Holes | None = None
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


def offset(points: Array, distance: float | Array) -> Array:
    """``points`` (n_u, n_v, 3) moved by ``distance`` along their mean normals u x v, mm."""
    du, dv = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.cross(du, dv)
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    distances = np.broadcast_to(distance, points.shape[:2])[..., None]
    return np.asarray(points + distances * normal / np.maximum(length, 1e-12))


def add_sheet(builder: BulkBuilder, points: Array, columns: Division, rows: Division, looks: Looks) -> PatchGrid:
    """A sheet without thickness: its border and its holes are free edges."""
    grid = add_patch_grid(
        builder, points, columns, rows, rational=looks.rational, rng=looks.rng, material=looks.material
    )
    add_outlines(builder, grid)
    if looks.holes is not None:
        punch_sheet(builder, grid, looks.holes)
    return grid


def add_shell(
    builder: BulkBuilder, outside: Array, inside: Array, columns: Division, rows: Division, looks: Looks
) -> None:
    """A closed shell between two sheets of the same division; holes go through both."""
    grids = []
    for points, turned in ((outside, False), (inside, True)):
        grid = add_patch_grid(
            builder, points, columns, rows, rational=looks.rational, rng=looks.rng, material=looks.material,
            reversed=turned,
        )  # fmt: skip
        add_outlines(builder, grid)
        grids.append(grid)
    material = np.broadcast_to(looks.material, grids[0].surfaces.shape)
    _add_rims(builder, grids[0], grids[1], columns, rows, material)
    if looks.holes is not None:
        punch_shell(builder, grids[0], grids[1], looks.holes, material)


def shell_counts(columns: Division, rows: Division, n_holes: int = 0, hole_points: int = 26) -> tuple[int, int]:
    """Surfaces and control points of ``add_shell``."""
    k, l, n_u, n_v = len(columns), len(rows), sum(columns.sizes), sum(rows.sizes)  # noqa: E741
    return 2 * k * l + 2 * (k + l) + n_holes, 2 * n_u * n_v + 4 * (n_u + n_v) + 2 * hole_points * n_holes


def sheet_counts(columns: Division, rows: Division) -> tuple[int, int]:
    """Surfaces and control points of ``add_sheet``."""
    return len(columns) * len(rows), sum(columns.sizes) * sum(rows.sizes)


def _add_rims(
    builder: BulkBuilder,
    outer: PatchGrid,
    inner: PatchGrid,
    columns: Division,
    rows: Division,
    material: npt.NDArray[np.integer],
) -> None:
    """Ruled strips between the borders of two grids."""
    borders: tuple[tuple[Rows, Rows, Any, Division, bool], ...] = (
        (outer.edges_u[:, 0], inner.edges_u[:, 0], np.s_[:, 0], columns, True),
        (outer.edges_u[:, -1], inner.edges_u[:, -1], np.s_[:, -1], columns, False),
        (outer.edges_v[0], inner.edges_v[0], np.s_[0], rows, False),
        (outer.edges_v[-1], inner.edges_v[-1], np.s_[-1], rows, True),
    )
    posts: dict[int, Rows] = {}
    for at, (above, below, line_of, division, turned) in enumerate(borders):
        start, end, look = outer.vertices[line_of], inner.vertices[line_of], material[line_of]
        side = np.empty(len(start), np.int64)
        for k, (top, bottom) in enumerate(zip(start.tolist(), end.tolist(), strict=True)):
            if top not in posts:
                line = builder.lines(builder.vertex(top)[None], builder.vertex(bottom)[None])
                posts[top] = builder.edges(line, np.array([top]), np.array([bottom]))
            side[k] = posts[top][0]
        for k in range(len(division)):
            n, degree = division.sizes[k], division.degrees[k]
            net = np.stack([_border(outer, at, k), _border(inner, at, k)], axis=1)
            face = builder.surfaces(
                (degree, 1), (clamped_knots(n, degree), LINE_KNOTS), net[None], reversed=turned, material=int(look[k])
            )
            four_sides(builder, face, above[[k]], side[[k + 1]], below[[k]], side[[k]])


def _border(grid: PatchGrid, at: int, k: int) -> Array:
    """(n, 3) control points of patch ``k`` along border ``at`` (0: v low, 1: v high, 2: u low, 3: u high)."""
    last = np.array(grid.surfaces.shape) - 1
    i, j = ((k, 0), (k, last[1]), (0, k), (last[0], k))[at]
    return grid.net(int(i), int(j))[(np.s_[:, 0], np.s_[:, -1], np.s_[0], np.s_[-1])[at]][:, :3]
