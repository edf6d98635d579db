"""Free-form sheets and closed shells, each its own shape: pressed panels, covers, ducts, castings.

They carry most control points: a patch has from 4 to some thousands, log-normally distributed, of degree
1 to 7. Their sizes are planned first, as numbers, so that a model's totals come out exactly; the shapes
are made one part at a time when they are stored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.patch_grid import Division
from nurbs_ooc.synth.punched import HOLE_POINTS, Holes
from nurbs_ooc.synth.shell import Looks, add_sheet, add_shell, offset
from nurbs_ooc.synth.volumes import Volume, pick, upright

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

DEGREES = (1, 2, 3, 3, 3, 4, 5, 5, 6, 7)
MOST_POINTS = 72  # along one side of a patch: 5,184 in all
SHELL_SHARE = 0.45
SPREAD = 0.75  # standard deviation of the logarithm of a patch's points along a side


@dataclass(eq=False)
class Pressing:
    """A planned part.

    Attributes:
        closed: a shell with thickness, else a sheet.
        degrees: of the columns, of the rows.
        wishes: of the columns, of the rows: points beyond the degree, before scaling.
        holes, rational: (k, l).
        seed: of its shape.
    """

    closed: bool
    degrees: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
    wishes: tuple[Array, Array]
    holes: Flags
    rational: Flags
    seed: int

    @property
    def patches(self) -> tuple[int, int]:
        """Columns and rows."""
        return len(self.degrees[0]), len(self.degrees[1])

    @property
    def n_surfaces(self) -> int:
        """Its surfaces."""
        k, l = self.patches  # noqa: E741
        return 2 * k * l + 2 * (k + l) + int(self.holes.sum()) if self.closed else k * l

    def sizes(self, scale: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Control points along columns and rows; grows with ``scale``."""
        extra = [
            np.minimum((scale * w).astype(np.int64), MOST_POINTS - d - 1)
            for d, w in zip(self.degrees, self.wishes, strict=True)
        ]
        return self.degrees[0] + 1 + extra[0], self.degrees[1] + 1 + extra[1]

    def n_points(self, scale: float) -> int:
        """Its control points."""
        u, v = (int(n.sum()) for n in self.sizes(scale))
        if not self.closed:
            return u * v
        return 2 * u * v + 4 * (u + v) + 2 * HOLE_POINTS * int(self.holes.sum())


def plan_pressing(n_most: int, hole_share: float, rational_share: float, rng: np.random.Generator) -> Pressing:
    """A part of at most ``n_most`` surfaces (at least 1)."""
    closed = bool(rng.random() < SHELL_SHARE) and n_most >= 9
    room = max(1, (n_most // 5 if closed else n_most))
    k = int(min(1 + rng.geometric(0.28), 9, room))
    l = int(min(1 + rng.geometric(0.28), 9, room // k))  # noqa: E741
    l = max(l, 1)  # noqa: E741
    degrees = rng.choice(DEGREES, k).astype(np.int64), rng.choice(DEGREES, l).astype(np.int64)
    wishes = rng.lognormal(0.0, SPREAD, k), rng.lognormal(0.0, SPREAD, l)
    common = rng.lognormal(0.0, 0.5)
    holes, rational = rng.random((k, l)) < hole_share, rng.random((k, l)) < rational_share
    # A weight inside needs an inside.
    rational &= (degrees[0] > 1)[:, None] & (degrees[1] > 1)
    return Pressing(
        closed, degrees, (common * wishes[0], common * wishes[1]), holes, rational, int(rng.integers(1 << 62))
    )


def fitting_scale(pressings: list[Pressing], n_points: int) -> float:
    """The scale at which they have at most ``n_points`` control points, as near as 60 halvings come."""
    low, high = 0.0, 200.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if sum(p.n_points(middle) for p in pressings) <= n_points:
            low = middle
        else:
            high = middle
    return low


def _relief(size: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Wave vectors (n, 2) in the unit square and heights (n,) of a pressing's curvature and beads."""
    n = int(rng.integers(2, 6))
    waves = rng.uniform(-1.0, 1.0, (n, 2)) * rng.uniform(1.0, 7.0, (n, 1))
    heights = 0.12 * size.min() * rng.uniform(0.2, 1.0, n) / (1.0 + np.abs(waves).sum(axis=1))
    return waves, heights


def make_pressing(
    plan: Pressing, scale: float, boxes: list[Volume], material: int
) -> tuple[BulkBuilder, Array, Volume]:
    """The part's geometry, its place (3, 4) and the box it lies in."""
    rng = np.random.default_rng(plan.seed)
    box, linear = pick(boxes, rng), upright(rng)
    room = np.abs(linear.T @ box.size)
    size = np.minimum(np.exp(rng.uniform(np.log(30.0), np.log(520.0), 2)), 0.9 * room[:2])
    depth = 0.7 * room[2]
    cells = [np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, k))]) for k in plan.patches]
    columns, rows = (
        Division(ends / ends[-1], tuple(map(int, n)), tuple(map(int, d)))
        for ends, n, d in zip(cells, plan.sizes(scale), plan.degrees, strict=True)
    )
    waves, heights = _relief(np.append(size, depth), rng)
    u, v = np.meshgrid(columns.nodes(), rows.nodes(), indexing="ij")
    phase = rng.uniform(0.0, 2.0 * np.pi, len(waves))
    z = sum(h * np.sin(w[0] * u + w[1] * v + p) for w, h, p in zip(waves, heights, phase, strict=True))
    points = np.stack([size[0] * (u - 0.5), size[1] * (v - 0.5), z], axis=2)
    builder = BulkBuilder()
    holes = Holes.seeded(plan.holes, rng) if plan.holes.any() else None
    looks = Looks(plan.rational, material, holes, rng)
    if plan.closed:
        thickness = float(rng.choice([0.8, 1.2, 2.0, 3.0]))
        add_shell(builder, points, offset(points, -thickness), columns, rows, looks)
    else:
        add_sheet(builder, points, columns, rows, looks)
    reach = np.abs(linear) @ (0.5 * np.append(size, min(depth, 0.3 * size.max() + 6.0)))
    middle = np.array(box.low) + reach + rng.random(3) * np.maximum(box.size - 2.0 * reach, 0.0)
    return builder, np.concatenate([linear, middle[:, None]], axis=1), box


def labels(n_surfaces: int, n_points: int, material: int) -> list[BulkBuilder]:
    """Flat plates without thickness, one surface each, with exactly ``n_points`` control points together.

    Needs n_surfaces >= 3 and n_points >= 16 n_surfaces + 16.
    """
    pair = 40 + (n_points - 40) % 8
    rest = (n_points - pair) // 8
    wide, more = divmod(rest, n_surfaces - 2)
    shapes = [(8, wide + (k < more)) for k in range(n_surfaces - 2)]
    shapes += [(3, 3), (2, (pair - 9) // 2)] if pair % 2 else [(2, 2), (2, (pair - 4) // 2)]
    builders = []
    for n_u, n_v in shapes:
        builder = BulkBuilder()
        columns = Division(np.array([0.0, 1.0]), (n_u,), (min(3, n_u - 1),))
        rows = Division(np.array([0.0, 1.0]), (n_v,), (min(3, n_v - 1),))
        u, v = np.meshgrid(columns.nodes(), rows.nodes(), indexing="ij")
        points = np.stack([60.0 * u, 35.0 * v, 4.0 * u * (1.0 - u)], axis=2)
        add_sheet(builder, points, columns, rows, Looks(material=material))
        builders.append(builder)
    return builders
