"""A sheet of trimmed faces like the outside of a car body: the tessellator's benchmark.

A gently curved sheet is laid out in cells of 200 mm x 100 mm. Each cell's surface is cut into two faces by
a curve that runs on from cell to cell, as shut lines do; neighbours share their edges, so the sheet is
closed but for its border and its holes. Every third face has a round hole, every third is rational.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.curve_on_surface import add_carried_curves, check_nodes, curve_nodes
from nurbs_ooc.synth.patch_grid import Division, PatchGrid, PatchGroup, add_patch_grid
from nurbs_ooc.synth.punched import cut_rings
from nurbs_ooc.synth.spline import basis_matrix, clamped_knots

Array = npt.NDArray[np.float64]

COLUMNS, ROWS = 25, 40
CELL_U, CELL_V = 200.0, 100.0  # mm
SIZES_U = (8,) * COLUMNS
SIZES_V = (9,) * 35 + (10,) * 5  # (25 x 8) x (40 x 9.125) / 1000 = 73 control points a face
CUT_POINTS = 14
"""Control points of a cut's space curve."""


def _sheet(s: Array, t: Array) -> Array:
    """A 5 m x 4 m sheet, crowned by 250 mm, with swages of 1 m radius."""
    x, y = s[:, None] * CELL_U, t[None, :] * CELL_V
    z = 250.0 * np.sin(np.pi * x / 5000.0) * np.cos(0.8 * np.pi * (y / 4000.0 - 0.5))
    z = z + 3.0 * np.sin(2.0 * np.pi * x / 400.0) * np.sin(2.0 * np.pi * y / 520.0) + 1.5 * np.sin(x / 90.0 + y / 130.0)
    return np.stack(np.broadcast_arrays(x, y, z), axis=2)


def car_body(seed: int = 0) -> GeometryBatch:
    """2,000 trimmed faces of degree 3 to 5, a third rational, 73 control points each on average, about 100 mm.

    Args:
        seed: of the cuts' course, the holes' places and the weights.
    """
    rng = np.random.default_rng(seed)
    columns = Division(np.arange(COLUMNS + 1.0), SIZES_U, tuple(3 + i % 3 for i in range(COLUMNS)))
    rows = Division(np.arange(ROWS + 1.0), SIZES_V, tuple(3 + j // 2 % 3 for j in range(ROWS)))
    points = _sheet(columns.nodes(), rows.nodes())
    rational = np.arange(COLUMNS * ROWS).reshape(COLUMNS, ROWS) % 3 == 0
    builder = BulkBuilder()
    grid = add_patch_grid(builder, points, columns, rows, rational=rational, rng=rng, whole_edges_u=False)
    cuts = _Cuts(builder, grid, rng.uniform(0.42, 0.58, (COLUMNS, ROWS + 1)))
    for group in grid.groups:
        _halve(builder, grid, cuts, group, rng)
    return builder.build("panel")


class _Cuts:
    """Where the cuts cross the rows' ends: vertices, and the rows' edges in two pieces each."""

    def __init__(self, builder: BulkBuilder, grid: PatchGrid, at: Array) -> None:
        self.at = at  # (k, l + 1), u in the cell
        self.points = np.empty((*at.shape, 3))
        for group in grid.groups:
            for side, row in ((0, group.row), (-1, group.row + 1)):
                net = group.nets[:, :, side, :3]  # weights are 1 here
                n = net.shape[1]
                u = at[group.column, row]
                basis = basis_matrix(clamped_knots(n, group.degrees[0]), group.degrees[0], u)
                self.points[group.column, row] = np.einsum("ki,kid->kd", basis, net)
        self.vertices = builder.vertices(self.points).reshape(at.shape)
        curves, u = grid.along_u.reshape(-1), at.reshape(-1)
        start, middle = grid.vertices[:-1].reshape(-1), self.vertices.reshape(-1)
        end = grid.vertices[1:].reshape(-1)
        self.left = builder.edges(builder.stretches(curves, 0.0, u), start, middle).reshape(at.shape)
        self.right = builder.edges(builder.stretches(curves, u, 1.0), middle, end).reshape(at.shape)


def _cubic(control: Array, t: Array) -> Array:
    """(k, m) values of Bézier cubics (k, 4) at t (m,)."""
    return np.asarray(control @ np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]))


def _halve(builder: BulkBuilder, grid: PatchGrid, cuts: _Cuts, group: PatchGroup, rng: np.random.Generator) -> None:
    """Cut the group's surfaces in two faces each and give every third face a hole."""
    i, j, n = group.column, group.row, len(group.row)
    n_u, n_v = group.nets.shape[1:3]
    knots = clamped_knots(n_u, group.degrees[0]), clamped_knots(n_v, group.degrees[1])
    twins = builder.surfaces(group.degrees, knots, group.nets, rational=group.rational)
    low, high = cuts.at[i, j], cuts.at[i, j + 1]
    course = np.stack([low, low + rng.uniform(-0.08, 0.08, n), high + rng.uniform(-0.08, 0.08, n), high], axis=1)

    def cut(t: Array) -> Array:
        return np.stack(np.broadcast_arrays(_cubic(course, t), t), axis=2)

    ends = cuts.points[i, j], cuts.points[i, j + 1]
    nodes = cut(curve_nodes(CUT_POINTS)), cut(check_nodes(CUT_POINTS))
    size = CUT_POINTS
    curve, gap, _ = add_carried_curves(
        builder, group.nets, group.degrees, nodes, rational=group.rational, size=size, ends=ends
    )
    edge = builder.edges(curve, cuts.vertices[i, j], cuts.vertices[i, j + 1], tolerance=gap)
    control = np.stack(np.broadcast_arrays(course, np.linspace(0.0, 1.0, 4)), axis=2)
    pcurve = builder.curves(3, clamped_knots(4, 3), control)

    zero, one = np.zeros(n), np.ones(n)

    def line(u0: Array, v0: Array, u1: Array, v1: Array) -> Rows:
        return builder.lines(np.stack([u0, v0], axis=1), np.stack([u1, v1], axis=1))

    left, right = group.surfaces, twins
    builder.coedges(left, 0, 0, cuts.left[i, j], line(zero, zero, low, zero))
    builder.coedges(left, 0, 1, edge, pcurve)
    builder.coedges(left, 0, 2, cuts.left[i, j + 1], line(zero, one, high, one), reversed=True)
    builder.coedges(left, 0, 3, grid.edges_v[i, j], line(zero, zero, zero, one), reversed=True)
    builder.coedges(right, 0, 0, cuts.right[i, j], line(low, zero, one, zero))
    builder.coedges(right, 0, 1, grid.edges_v[i + 1, j], line(one, zero, one, one))
    builder.coedges(right, 0, 2, cuts.right[i, j + 1], line(high, one, one, one), reversed=True)
    builder.coedges(right, 0, 3, edge, pcurve, reversed=True)
    number = 2 * (i * ROWS + j)
    for faces, middle, which in ((left, 0.25, number), (right, 0.75, number + 1)):
        holed = which % 3 == 0
        _punch(builder, group, faces[holed], holed, middle, rng)


def _punch(
    builder: BulkBuilder, group: PatchGroup, faces: Rows, which: npt.NDArray[np.bool_], u: float,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """A round hole of 20 to 40 mm in the middle of each face."""
    n = len(faces)
    if not n:
        return
    center = np.stack([u + rng.uniform(-0.02, 0.02, n), rng.uniform(0.45, 0.55, n)], axis=1)
    radii = rng.uniform(10.0, 20.0, n)[:, None] / (CELL_U, CELL_V)
    cut_rings(builder, faces, group.nets[which], group.degrees, center, radii, rational=group.rational)
