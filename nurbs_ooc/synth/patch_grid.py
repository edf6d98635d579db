"""Patches side by side that share their edges: one smooth shape, interpolated over a grid of intervals.

::

    v  +-----+--------+---+      column i has a degree and a number of control points along u,
    ^  |     |        |   |      row j along v; neighbours have the same curve, the same
    |  +-----+--------+---+      edge record and bit for bit the same border control points
    |  |     |        |   |
       +-----+--------+---+ --> u
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.spline import clamped_knots, collocation, fit_curves, fit_surfaces, greville

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
Weights = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Division:
    """The intervals of one direction.

    Attributes:
        ends: (k + 1,) where they begin and end, ascending.
        sizes: control points of each.
        degrees: degree of each, below its size.
    """

    ends: Array
    sizes: tuple[int, ...]
    degrees: tuple[int, ...]

    @classmethod
    def even(cls, k: int, size: int, degree: int, low: float = 0.0, high: float = 1.0) -> Division:
        """``k`` equal intervals over low..high, all with the same spline."""
        return cls(np.linspace(low, high, k + 1), (size,) * k, (degree,) * k)

    def __len__(self) -> int:
        return len(self.sizes)

    @property
    def starts(self) -> npt.NDArray[np.int64]:
        """(k + 1,) first node of each interval; an interval's last node is the next one's first."""
        return np.concatenate([[0], np.cumsum(np.array(self.sizes) - 1)])

    def nodes(self) -> Array:
        """Parameters at which a shape is to be evaluated."""
        parts = [self.ends[:1]]
        for k, (size, degree) in enumerate(zip(self.sizes, self.degrees, strict=True)):
            nodes = self.ends[k] + (self.ends[k + 1] - self.ends[k]) * greville(size, degree)
            nodes[-1] = self.ends[k + 1]
            parts.append(nodes[1:])
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class PatchGroup:
    """Patches of one shape of control net.

    Attributes:
        column, row: (n,) where they are.
        surfaces: (n,) rows in the builder.
        degrees: along u and v.
        nets: (n, n_u, n_v, 3), or homogeneous (n, n_u, n_v, 4) if rational.
        rational: whether they have weights.
    """

    column: Rows
    row: Rows
    surfaces: Rows
    degrees: tuple[int, int]
    nets: Array
    rational: bool


@dataclass(frozen=True, eq=False)
class PatchGrid:
    """Rows of a grid of k x l patches in its builder.

    Attributes:
        surfaces: (k, l).
        along_u: (k, l + 1) curves at the rows' ends, in the direction of u.
        along_v: (k + 1, l) curves at the columns' ends, in the direction of v.
        edges_u, edges_v: the edges along them, likewise.
        vertices: (k + 1, l + 1).
        groups: the surfaces by the shape of their nets.
    """

    surfaces: Rows
    along_u: Rows
    along_v: Rows
    edges_u: Rows
    edges_v: Rows
    vertices: Rows
    groups: list[PatchGroup]

    def net(self, column: int, row: int) -> Array:
        """The control net of one patch."""
        for group in self.groups:
            at = np.flatnonzero((group.column == column) & (group.row == row))
            if len(at):
                return group.nets[at[0]]
        raise IndexError((column, row))


def _classes(sizes: Sequence[int], degrees: Sequence[int]) -> dict[tuple[int, int], list[int]]:
    """Intervals by (size, degree)."""
    found: dict[tuple[int, int], list[int]] = {}
    for k, key in enumerate(zip(sizes, degrees, strict=True)):
        found.setdefault(key, []).append(k)
    return found


def _curves_along(builder: BulkBuilder, points: Array, division: Division) -> tuple[Rows, dict[tuple[int, int], Array]]:
    """Curves through points (n_nodes, m, 3) over each interval: rows (k, m) and their nets."""
    m = points.shape[1]
    rows = np.empty((len(division), m), np.int64)
    nets: dict[tuple[int, int], Array] = {}
    starts = division.starts
    for (size, degree), intervals in _classes(division.sizes, division.degrees).items():
        stacked = np.stack([points[starts[k] : starts[k] + size] for k in intervals])  # (k, size, m, 3)
        control = fit_curves(stacked.transpose(0, 2, 1, 3).reshape(-1, size, 3), degree)
        rows[intervals] = builder.curves(degree, clamped_knots(size, degree), control).reshape(-1, m)
        for at, k in enumerate(intervals):
            for j in range(m):
                nets[k, j] = control[at * m + j]
    return rows, nets


def inner_weights(shape: tuple[int, int], degrees: tuple[int, int], swell: Array) -> Weights:
    """(n, n_u, n_v) weights that are 1 on the border, so that rational patches keep their neighbours' curves.

    Args:
        swell: (n,) weight in the middle less 1, above -1: a smooth bulge, as conics give it.
    """
    bulge_u = np.sin(np.pi * greville(shape[0], degrees[0]))
    bulge_v = np.sin(np.pi * greville(shape[1], degrees[1]))
    bulge_u[-1] = bulge_v[-1] = 0.0
    return np.asarray(1.0 + swell[:, None, None] * bulge_u[:, None] * bulge_v)


def _nets(points: Array, degrees: tuple[int, int], weights: Weights | None) -> Array:
    """Control points through ``points`` (k, n_u, n_v, 3); homogeneous if there are weights."""
    if weights is None:
        return fit_surfaces(points, *degrees)
    n_u, n_v = points.shape[1:3]
    scale = (collocation(n_u, degrees[0]) @ weights @ collocation(n_v, degrees[1]).T)[..., None]
    return np.concatenate([fit_surfaces(scale * points, *degrees), weights[..., None]], axis=3)


def add_patch_grid(
    builder: BulkBuilder,
    points: Array,
    columns: Division,
    rows: Division,
    *,
    rational: npt.NDArray[np.bool_] | None = None,
    rng: np.random.Generator | None = None,
    swell: tuple[float, float] = (-0.25, 0.4),
    material: int | npt.NDArray[np.integer] = 0,
    reversed: bool = False,
    whole_edges_u: bool = True,
) -> PatchGrid:
    """Append surfaces, curves, edges and vertices, but no loops.

    Args:
        points: (n_u, n_v, 3), mm: the shape at ``columns.nodes()`` x ``rows.nodes()``.
        rational: (k, l) which patches have weights (they keep their shape: the weights vary inside).
        swell: range of the weights in the patches' middles, less 1.
        material: one or (k, l).
        whole_edges_u: False if the caller makes the edges along u, in pieces; the grid's are then -1.
    """
    k, l = len(columns), len(rows)  # noqa: E741
    iu, iv = columns.starts, rows.starts
    along_u, nets_u = _curves_along(builder, points[:, iv], columns)
    along_v, nets_v = _curves_along(builder, points[iu].transpose(1, 0, 2), rows)
    along_v = along_v.T
    vertices = builder.vertices(points[np.ix_(iu, iv)]).reshape(k + 1, l + 1)
    edges_u = np.full(along_u.shape, -1, np.int64)
    if whole_edges_u:
        ends = vertices[:-1].reshape(-1), vertices[1:].reshape(-1)
        edges_u = builder.edges(along_u.reshape(-1), *ends).reshape(along_u.shape)
    edges_v = builder.edges(along_v.reshape(-1), vertices[:, :-1].reshape(-1), vertices[:, 1:].reshape(-1))
    surfaces = np.empty((k, l), np.int64)
    materials = np.broadcast_to(material, (k, l))
    with_weights = np.zeros((k, l), np.bool_) if rational is None else rational
    groups = []
    for (n_u, p), in_u in _classes(columns.sizes, columns.degrees).items():
        for (n_v, q), in_v in _classes(rows.sizes, rows.degrees).items():
            for weighted in (False, True):
                cells = [(i, j) for i in in_u for j in in_v if bool(with_weights[i, j]) == weighted]
                if not cells:
                    continue
                stacked = np.stack([points[iu[i] : iu[i] + n_u, iv[j] : iv[j] + n_v] for i, j in cells])
                weights = None
                if weighted:
                    assert rng is not None, "rational patches need a generator"
                    weights = inner_weights((n_u, n_v), (p, q), rng.uniform(*swell, len(cells)))
                nets = _nets(stacked, (p, q), weights)
                for net, (i, j) in zip(nets, cells, strict=True):
                    net[:, 0, :3], net[:, -1, :3] = nets_u[i, j], nets_u[i, j + 1]
                    net[0, :, :3], net[-1, :, :3] = nets_v[j, i], nets_v[j, i + 1]
                at = tuple(np.array(cells).T)
                surfaces[at] = builder.surfaces(
                    (p, q),
                    (clamped_knots(n_u, p), clamped_knots(n_v, q)),
                    nets,
                    rational=weighted,
                    material=materials[at],
                    reversed=reversed,
                )
                groups.append(PatchGroup(at[0], at[1], surfaces[at], (p, q), nets, weighted))
    return PatchGrid(surfaces, along_u, along_v, edges_u, edges_v.reshape(k + 1, l), vertices, groups)


def add_outlines(builder: BulkBuilder, grid: PatchGrid, cells: npt.NDArray[np.bool_] | None = None) -> None:
    """Give the patches of ``cells`` (k, l; default all) their four sides as outer loops."""
    k, l = grid.surfaces.shape  # noqa: E741
    i, j = np.nonzero(np.ones((k, l), np.bool_) if cells is None else cells)
    n = len(i)
    faces = grid.surfaces[i, j]
    corner = {name: np.broadcast_to(np.array(at), (n, 2)) for name, at in _CORNERS.items()}
    sides = (
        ("00", "10", grid.edges_u[i, j], False),
        ("10", "11", grid.edges_v[i + 1, j], False),
        ("01", "11", grid.edges_u[i, j + 1], True),
        ("00", "01", grid.edges_v[i, j], True),
    )
    for order, (start, end, edges, backwards) in enumerate(sides):
        pcurves = builder.lines(corner[start], corner[end])
        builder.coedges(faces, 0, order, edges, pcurves, reversed=backwards)


_CORNERS = {"00": (0.0, 0.0), "10": (1.0, 0.0), "01": (0.0, 1.0), "11": (1.0, 1.0)}
