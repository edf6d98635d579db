"""Round holes in the middle of curved patches, with or without the wall through a sheet's thickness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.curve_on_surface import DEGREE, add_carried_curves, check_nodes, curve_nodes
from nurbs_ooc.synth.outline import LINE_KNOTS
from nurbs_ooc.synth.patch_grid import PatchGrid
from nurbs_ooc.synth.solid import four_sides
from nurbs_ooc.synth.spline import clamped_knots

Array = npt.NDArray[np.float64]

HOLE_POINTS = 26
"""Control points of a hole's edge: the gap to the p-curve is some 1e-6 of the hole's size."""


@dataclass(frozen=True, eq=False)
class Holes:
    """Which patches of a grid have a hole, and where in their parameters.

    Attributes:
        cells: (k, l) bool.
        center: (k, l, 2) in each patch's unit square.
        radii: (k, l, 2), likewise.
    """

    cells: npt.NDArray[np.bool_]
    center: Array
    radii: Array

    @classmethod
    def seeded(
        cls, cells: npt.NDArray[np.bool_], rng: np.random.Generator, low: float = 0.08, high: float = 0.3
    ) -> Holes:
        """Holes of ``low`` to ``high`` of the patches, near their middles."""
        center = rng.uniform(0.42, 0.58, (*cells.shape, 2))
        return cls(cells, center, np.repeat(rng.uniform(low, high, cells.shape)[..., None], 2, axis=2))


@dataclass(frozen=True, eq=False)
class _Rims:
    """Edges of the holes of one grid, by cell."""

    edges: npt.NDArray[np.int64]
    vertices: npt.NDArray[np.int64]
    nets: dict[tuple[int, int], Array]


def cut_rings(
    builder: BulkBuilder, faces: Rows, nets: Array, degrees: tuple[int, int], center: Array, radii: Array,
    *, rational: bool,
) -> tuple[Rows, Rows, Array]:  # fmt: skip
    """Give n faces of one shape a hole as their loop 1.

    Args:
        nets: (n, n_u, n_v, 3 or 4) of the faces.
        center, radii: (n, 2) in the unit square.

    Returns:
        The holes' edges and vertices, and the edges' control points (n, HOLE_POINTS, 3).
    """
    a, b = np.zeros_like(radii), np.zeros_like(radii)
    a[:, 0], b[:, 1] = radii[:, 0], -radii[:, 1]  # clockwise

    def ring(t: Array) -> Array:
        angle = 2.0 * np.pi * t[:, None]
        return np.asarray(center[:, None] + np.cos(angle) * a[:, None] + np.sin(angle) * b[:, None])

    nodes = ring(curve_nodes(HOLE_POINTS)), ring(check_nodes(HOLE_POINTS))
    curves, gap, control = add_carried_curves(
        builder, nets, degrees, nodes, rational=rational, size=HOLE_POINTS, closed=True
    )
    vertices = builder.vertices(control[:, 0])
    edges = builder.edges(curves, vertices, vertices, tolerance=gap)
    builder.coedges(faces, 1, 0, edges, builder.ellipses(center, a, b))
    return edges, vertices, control


def _punch(builder: BulkBuilder, grid: PatchGrid, holes: Holes) -> _Rims:
    """Add the hole's loop to each patch that has one."""
    shape = holes.cells.shape
    rims = _Rims(np.full(shape, -1, np.int64), np.full(shape, -1, np.int64), {})
    for group in grid.groups:
        pick = np.flatnonzero(holes.cells[group.column, group.row])
        if not len(pick):
            continue
        i, j = group.column[pick], group.row[pick]
        rims.edges[i, j], rims.vertices[i, j], control = cut_rings(
            builder, group.surfaces[pick], group.nets[pick], group.degrees, holes.center[i, j], holes.radii[i, j],
            rational=group.rational,
        )  # fmt: skip
        rims.nets.update(zip(zip(i.tolist(), j.tolist(), strict=True), control, strict=True))
    return rims


def punch_sheet(builder: BulkBuilder, grid: PatchGrid, holes: Holes) -> None:
    """Holes in a sheet without thickness: their edges stay free."""
    _punch(builder, grid, holes)


def punch_shell(
    builder: BulkBuilder, outer: PatchGrid, inner: PatchGrid, holes: Holes, material: int | npt.NDArray[np.integer] = 0
) -> Rows:
    """Holes through two grids of the same division, joined by ruled walls; rows of the walls."""
    first, second = _punch(builder, outer, holes), _punch(builder, inner, holes)
    cells = list(zip(*(at.tolist() for at in np.nonzero(holes.cells)), strict=True))
    if not cells:
        return np.empty(0, np.int64)
    at = tuple(np.array(cells).T)
    start, end = (np.stack([rims.nets[cell] for cell in cells]) for rims in (first, second))
    faces = builder.surfaces(
        (DEGREE, 1), (clamped_knots(HOLE_POINTS, DEGREE), LINE_KNOTS), np.stack([start, end], axis=2),
        reversed=True, material=np.broadcast_to(material, holes.cells.shape)[at],
    )  # fmt: skip
    posts = builder.edges(builder.lines(start[:, 0], end[:, 0]), first.vertices[at], second.vertices[at])
    four_sides(builder, faces, first.edges[at], posts, second.edges[at], posts, seam=True)
    return faces
