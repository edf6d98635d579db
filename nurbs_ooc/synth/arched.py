"""A body panel with a wheel arch: a closed shell of one large patch, cut by a circle seen from the side.

::

        +-----------------+     outer and inner face, cut by the same p-curve; rims around, where the
        |      .---.      |     two short rims left below are trimmed pieces of one ruled surface; the
        +-----'     '-----+     arch itself is a ruled wall between the two cuts
            u0       u1
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.curve_on_surface import DEGREE, add_carried_curves, carried, check_nodes, curve_nodes
from nurbs_ooc.synth.outline import LINE_KNOTS
from nurbs_ooc.synth.patch_grid import Division, PatchGrid, add_patch_grid
from nurbs_ooc.synth.shell import offset
from nurbs_ooc.synth.solid import four_sides
from nurbs_ooc.synth.spline import basis_matrix, clamped_knots, fit_curves

Array = npt.NDArray[np.float64]

ARCH_POINTS = 40


@dataclass(frozen=True)
class Arch:
    """The circle that is cut out: its middle in (x, z) and its radius, mm."""

    x: float
    z: float
    radius: float


def add_arched_panel(
    builder: BulkBuilder,
    points: Callable[[Array, Array], Array],
    size: tuple[int, int],
    degrees: tuple[int, int],
    arch: Arch,
    thickness: float,
    material: int,
) -> None:
    """A closed panel whose lower border (v = 0) is cut by an arch.

    Args:
        points: (n_u, n_v, 3) points at u x v in the unit square; u x v points outside.
        size: control points along u and v.
    """
    columns = Division(np.array([0.0, 1.0]), size[:1], degrees[:1])
    rows = Division(np.array([0.0, 1.0]), size[1:], degrees[1:])
    outside = points(columns.nodes(), rows.nodes())
    sheets = []
    course: Array | None = None
    for shape, turned in ((outside, False), (offset(outside, -thickness), True)):
        grid = add_patch_grid(builder, shape, columns, rows, material=material, reversed=turned, whole_edges_u=False)
        if course is None:
            course = _course(grid.groups[0].nets[0], degrees, arch)
        sheets.append(_CutSheet(builder, grid, course))
    _join(builder, sheets[0], sheets[1], columns, rows, material)


def _solve(net: Array, degrees: tuple[int, int], target: Array, start: Array, *, along_border: bool) -> Array:
    """Parameters (m, 2) whose points have the side view ``target`` (m, 2); on the border: the wanted distance."""
    uv, h = start.copy(), 1e-6
    for _ in range(30):
        stack = np.concatenate([uv, uv + np.array([h, 0.0]), uv + np.array([0.0, h])])
        xz = carried(net[None], degrees, np.clip(stack, 0.0, 1.0)[None], rational=False)[0][:, [0, 2]]
        at, du, dv = xz[: len(uv)], xz[len(uv) : 2 * len(uv)], xz[2 * len(uv) :]
        jacobian = np.stack([du - at, dv - at], axis=2) / h
        step = np.linalg.solve(jacobian, (target - at)[..., None])[..., 0]
        uv = np.clip(uv + step, 0.0, 1.0 - 2.0 * h)
        if along_border:
            uv[:, 1] = 0.0
    return uv


def _crossings(net: Array, degrees: tuple[int, int], arch: Arch) -> Array:
    """(2,) parameters at which the circle crosses the lower border."""
    u = np.linspace(0.0, 1.0, 4001)
    xz = carried(net[None], degrees, np.stack([u, np.zeros_like(u)], axis=1)[None], rational=False)[0][:, [0, 2]]
    off = np.hypot(xz[:, 0] - arch.x, xz[:, 1] - arch.z) - arch.radius
    at = np.flatnonzero((off[:-1] < 0) != (off[1:] < 0))[[0, -1]]
    return np.asarray(u[at] + (u[1] - u[0]) * off[at] / (off[at] - off[at + 1]))


def _course(net: Array, degrees: tuple[int, int], arch: Arch) -> Array:
    """(ARCH_POINTS, 2) control points of the cut's p-curve."""
    ends = np.stack([_crossings(net, degrees, arch), np.zeros(2)], axis=1)
    xz = carried(net[None], degrees, ends[None], rational=False)[0][:, [0, 2]]
    angle = np.arctan2(xz[:, 1] - arch.z, xz[:, 0] - arch.x)
    angle = (angle + 0.5 * np.pi) % (2.0 * np.pi) - 0.5 * np.pi  # over the top, whichever end comes first
    turn = angle[0] + (angle[1] - angle[0]) * curve_nodes(ARCH_POINTS)
    target = np.array([arch.x, arch.z]) + arch.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    corners = carried(net[None], degrees, np.array([[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]]), rational=False)[0]
    span = np.array([corners[1, 0] - corners[0, 0], corners[2, 2] - corners[0, 2]])
    start = np.clip((target - xz.mean(axis=0)) / span + (ends[:, 0].mean(), 0.0), 0.01, 0.99)
    uv = _solve(net, degrees, target, start, along_border=False)
    uv[[0, -1]] = ends
    return fit_curves(uv[None], DEGREE)[0]


class _CutSheet:
    """One face of the panel: its patch, trimmed by the arch."""

    def __init__(self, builder: BulkBuilder, grid: PatchGrid, course: Array) -> None:
        group = grid.groups[0]
        self.grid, self.net = grid, group.nets[0]
        knots = clamped_knots(ARCH_POINTS, DEGREE)
        u0, u1 = course[0, 0], course[-1, 0]
        border = group.nets[0][:, 0]
        ends = basis_matrix(clamped_knots(len(border), group.degrees[0]), group.degrees[0], np.array([u0, u1])) @ border
        uv = [basis_matrix(knots, DEGREE, t) @ course for t in (curve_nodes(ARCH_POINTS), check_nodes(ARCH_POINTS))]
        curve, gap, control = add_carried_curves(
            builder, group.nets, group.degrees, (uv[0][None], uv[1][None]), rational=False, size=ARCH_POINTS,
            ends=(ends[:1], ends[1:]),
        )  # fmt: skip
        self.at, self.vertices = (u0, u1), builder.vertices(ends)
        low, high = self.vertices[:1], self.vertices[1:]
        self.arch = builder.edges(curve, low, high, tolerance=gap)
        self.arch_net = control[0]
        whole = grid.along_u[0, :1]
        self.left = builder.edges(builder.stretches(whole, 0.0, u0), grid.vertices[0, :1], low)
        self.right = builder.edges(builder.stretches(whole, u1, 1.0), high, grid.vertices[1, :1])
        self.top = builder.edges(grid.along_u[0, 1:], grid.vertices[0, 1:], grid.vertices[1, 1:])
        face = group.surfaces
        zero, one = np.zeros((1, 2)), np.ones((1, 2))
        corner, foot = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
        first, last = np.array([[u0, 0.0]]), np.array([[u1, 0.0]])
        builder.coedges(face, 0, 0, self.left, builder.lines(zero, first))
        builder.coedges(face, 0, 1, self.arch, builder.curves(DEGREE, knots, course[None]))
        builder.coedges(face, 0, 2, self.right, builder.lines(last, corner))
        builder.coedges(face, 0, 3, grid.edges_v[1], builder.lines(corner, one))
        builder.coedges(face, 0, 4, self.top, builder.lines(foot, one), reversed=True)
        builder.coedges(face, 0, 5, grid.edges_v[0], builder.lines(zero, foot), reversed=True)


def _join(
    builder: BulkBuilder, outer: _CutSheet, inner: _CutSheet, columns: Division, rows: Division, material: int
) -> None:
    """Rims and the arch's wall between the two faces."""

    def post(start: Rows, end: Rows) -> Rows:
        line = builder.lines(builder.vertex(int(start[0]))[None], builder.vertex(int(end[0]))[None])
        return builder.edges(line, start, end)

    def ruled(first: Array, second: Array, n: int, degree: int, turned: bool) -> Rows:
        net = np.stack([first[:, :3], second[:, :3]], axis=1)[None]
        return builder.surfaces(
            (degree, 1), (clamped_knots(n, degree), LINE_KNOTS), net, reversed=turned, material=material
        )

    corner = [[post(outer.grid.vertices[i, [j]], inner.grid.vertices[i, [j]]) for j in (0, 1)] for i in (0, 1)]
    feet = [post(outer.vertices[[k]], inner.vertices[[k]]) for k in (0, 1)]
    a, b, p, q = outer.net, inner.net, columns.degrees[0], rows.degrees[0]
    face = ruled(a[:, -1], b[:, -1], len(a), p, False)
    four_sides(builder, face, outer.top, corner[1][1], inner.top, corner[0][1])
    for i, turned in ((0, False), (1, True)):
        face = ruled(a[-i], b[-i], a.shape[1], q, turned)
        four_sides(builder, face, outer.grid.edges_v[i], corner[i][1], inner.grid.edges_v[i], corner[i][0])
    for side, ends, posts in (
        ("left", (0.0, outer.at[0]), (corner[0][0], feet[0])),
        ("right", (outer.at[1], 1.0), (feet[1], corner[1][0])),
    ):
        face = ruled(a[:, 0], b[:, 0], len(a), p, True)
        edges = (getattr(outer, side), getattr(inner, side))
        four_sides(builder, face, edges[0], posts[1], edges[1], posts[0], domain=(*ends, 0.0, 1.0))
    face = ruled(outer.arch_net, inner.arch_net, ARCH_POINTS, DEGREE, True)
    four_sides(builder, face, outer.arch, feet[1], inner.arch, feet[0])
