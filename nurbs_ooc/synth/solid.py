"""Machined and punched parts: a plate of any outline with holes, bosses and pockets, closed and exact.

::

        ___|boss|___          caps: planes trimmed by the outline and by the holes
       |   |    |   |         walls: planes and cylinders on the outline's pieces
       |___|____|___|         through holes: walls on the hole's pieces, seen from inside
                              bosses, pockets: turned steps that begin at a hole in a cap
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder, Rows
from nurbs_ooc.synth.outline import CIRCLE_KNOTS, CIRCLE_POINTS, CIRCLE_WEIGHTS, LINE_KNOTS, Outline

Array = npt.NDArray[np.float64]

MARGIN = 0.05  # of the outline's size: a cap's surface is larger than the cap


@dataclass(frozen=True)
class Steps:
    """A boss or pocket of circular steps.

    Attributes:
        x, y: where its axis crosses the cap.
        profile: (radius, height over the cap) of each step, beginning with (radius, 0); below 0: a pocket.
        top: whether it stands on the upper cap.
    """

    x: float
    y: float
    profile: tuple[tuple[float, float], ...]
    top: bool = True


class SolidBuilder:
    """Adds solids to a builder in a frame of their own.

    Args:
        builder: what they join.
        frame: (3, 4) local coordinates to the part's, mm; right-handed.
        material: of all faces.
    """

    def __init__(self, builder: BulkBuilder, frame: Array | None = None, material: int = 0) -> None:
        self.builder = builder
        self._frame = np.eye(3, 4) if frame is None else frame
        self.material = material

    def _placed(self, points: Array) -> Array:
        return np.asarray(points @ self._frame[:, :3].T + self._frame[:, 3])

    def plate(
        self, outline: Outline, low: float, high: float, holes: Sequence[Outline] = (), steps: Sequence[Steps] = ()
    ) -> None:
        """A plate between the heights ``low`` and ``high``, mm; holes go through, and nothing touches."""
        lower, upper = _Cap(self, outline, low, False), _Cap(self, outline, high, True)
        for loop, (ring, inside) in enumerate([(outline, False)] + [(hole, True) for hole in holes]):
            pieces = ring.backwards() if inside else ring
            below, above = self._ring(pieces, low), self._ring(pieces, high)
            self._walls(pieces, below, above)
            lower.trim(loop, pieces, below.edges)
            upper.trim(loop, pieces, above.edges)
        count = [1 + len(holes)] * 2
        for step in steps:
            cap = upper if step.top else lower
            self._steps(step, cap, count[step.top])
            count[step.top] += 1

    def turned(self, profile: Sequence[tuple[float, float]], *, closed: bool = False) -> None:
        """A body of revolution: cones and cylinders between (radius, height) points, caps at its ends unless closed.

        The profile runs with the outside on its right: up along the outer side.
        """
        rings = [self._ring(Outline.circle(r), z) for r, z in profile]
        pairs = list(pairwise(rings)) + ([(rings[-1], rings[0])] if closed else [])
        for below, above in pairs:
            self._walls(Outline.circle(1.0), below, above)
        if not closed:
            for (r, z), ring, top in ((profile[0], rings[0], False), (profile[-1], rings[-1], True)):
                _Cap(self, Outline.circle(r), z, top).trim(0, Outline.circle(r), ring.edges)

    def revolved(self, outline: Outline) -> None:
        """A closed body of revolution about z: each piece of ``outline`` in (radius, height), all radii above 0."""
        builder, n = self.builder, len(outline.pieces)
        rings = [self._ring(Outline.circle(p.points[0, 0]), p.points[0, 1]) for p in outline.pieces]
        for i, piece in enumerate(outline.pieces):
            m = len(piece.points)
            net = np.empty((len(CIRCLE_POINTS), m, 3))
            net[:, :, :2] = CIRCLE_POINTS[:, None] * piece.points[:, 0][None, :, None]
            net[:, :, 2] = piece.points[:, 1]
            weights = CIRCLE_WEIGHTS[:, None] * piece.weights
            placed = self._placed(net)
            rows = np.concatenate([placed * weights[..., None], weights[..., None]], axis=2)
            face = builder.surfaces(
                (2, piece.degree), (CIRCLE_KNOTS, piece.knots), rows[None], rational=True, material=self.material
            )
            meridian = builder.curves(piece.degree, piece.knots, piece.rows(placed[0])[None], rational=piece.rational)
            below, above = rings[i], rings[(i + 1) % n]
            seam = builder.edges(meridian, below.vertices, above.vertices)
            four_sides(builder, face, below.edges, seam, above.edges, seam, seam=True)

    def _ring(self, outline: Outline, height: float, x: float = 0.0, y: float = 0.0) -> _Ring:
        """Edges along an outline at a height."""
        points = []
        for piece in outline.pieces:
            flat = np.full((len(piece.points), 3), float(height))
            flat[:, :2] = piece.points + np.array([x, y])
            points.append(self._placed(flat))
        builder = self.builder
        vertices = builder.vertices(np.stack([p[0] for p in points]))
        edges = np.empty(len(points), np.int64)
        for i, (piece, control) in enumerate(zip(outline.pieces, points, strict=True)):
            curve = builder.curves(piece.degree, piece.knots, piece.rows(control)[None], rational=piece.rational)
            edges[i] = builder.edges(curve, vertices[[i]], vertices[[(i + 1) % len(points)]])[0]
        return _Ring(points, vertices, edges)

    def _walls(self, outline: Outline, below: _Ring, above: _Ring) -> None:
        """One ruled face on each piece between two rings; outside to the right of the outline."""
        builder, n = self.builder, len(below.edges)
        start, end = below.points, above.points
        lines = builder.lines(np.stack([p[0] for p in start]), np.stack([p[0] for p in end]))
        posts = builder.edges(lines, below.vertices, above.vertices)
        for i, piece in enumerate(outline.pieces):
            net = np.stack([piece.rows(start[i]), piece.rows(end[i])], axis=1)
            face = builder.surfaces(
                (piece.degree, 1), (piece.knots, LINE_KNOTS), net[None], rational=piece.rational,
                material=self.material,
            )  # fmt: skip
            four_sides(builder, face, below.edges[[i]], posts[[(i + 1) % n]], above.edges[[i]], posts[[i]], seam=n == 1)

    def _steps(self, step: Steps, cap: _Cap, loop: int) -> None:
        """Turned steps on a cap, ended by a small cap."""
        sign = 1.0 if step.top else -1.0
        circles = [Outline.circle(r) for r, _ in step.profile]
        rings = [
            self._ring(c, cap.height + sign * h, step.x, step.y)
            for c, (_, h) in zip(circles, step.profile, strict=True)
        ]
        around = Outline.circle(step.profile[0][0], step.x, step.y)
        cap.trim(loop, around, rings[0].edges, hole=True)
        for below, above in pairwise(rings):
            self._walls(circles[0], *((below, above) if step.top else (above, below)))
        last = Outline.circle(step.profile[-1][0], step.x, step.y)
        _Cap(self, last, cap.height + sign * step.profile[-1][1], step.top).trim(0, last, rings[-1].edges)


@dataclass(frozen=True, eq=False)
class _Ring:
    """Edges of an outline: control points (3D) of each piece, vertices at their starts, edge rows."""

    points: list[Array]
    vertices: Rows
    edges: Rows


class _Cap:
    """A plane face that is trimmed by outlines at its height."""

    def __init__(self, solid: SolidBuilder, outline: Outline, height: float, top: bool) -> None:
        low, high = outline.box()
        spare = MARGIN * (high - low)
        self.height, self._low, self._size = height, low - spare, high - low + 2.0 * spare
        corners = np.full((2, 2, 3), float(height))
        for i in (0, 1):
            for j in (0, 1):
                corners[i, j, :2] = self._low + self._size * (i, j)
        self._builder = solid.builder
        self.face = self._builder.surfaces(
            (1, 1), (LINE_KNOTS, LINE_KNOTS), solid._placed(corners)[None], reversed=not top, material=solid.material
        )

    def trim(self, loop: int, outline: Outline, edges: Rows, *, hole: bool = False) -> None:
        """Add a loop; ``hole``: the outline is counter-clockwise and is run through backwards."""
        n = len(edges)
        for i, piece in enumerate(outline.pieces):
            flat = (piece.points - self._low) / self._size
            pcurve = self._builder.curves(piece.degree, piece.knots, piece.rows(flat)[None], rational=piece.rational)
            order = n - 1 - i if hole else i
            self._builder.coedges(self.face, loop, order, edges[[i]], pcurve, reversed=hole)


def four_sides(
    builder: BulkBuilder, faces: Rows, bottom: Rows, right: Rows, top: Rows, left: Rows, *, seam: bool = False,
    domain: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0),
) -> None:  # fmt: skip
    """The outer loops of n faces over ``domain`` = u0, u1, v0, v1; ``seam``: right and left are the same edges."""
    u0, u1, v0, v1 = domain
    corners = np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)])
    sides = (
        (0, 1, bottom, False, False),
        (1, 2, right, False, seam),
        (3, 2, top, True, False),
        (0, 3, left, True, seam),
    )
    for order, (start, end, edges, backwards, closing) in enumerate(sides):
        n = len(faces)
        pcurves = builder.lines(np.tile(corners[start], (n, 1)), np.tile(corners[end], (n, 1)))
        builder.coedges(faces, 0, order, edges, pcurves, reversed=backwards, seam=closing)
