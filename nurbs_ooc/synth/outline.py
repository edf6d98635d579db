"""Closed plane outlines of lines, arcs and circles as exact rational pieces.

A piece carries its own spline, so that the same control points serve as p-curve on the plane, as edge in
space and as border of the wall that stands on it: the three agree exactly, parameter by parameter.

Source: Piegl, Tiller, The NURBS Book (1997), section 7.3 (arcs) and 7.5 (the nine-point circle).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LINE_KNOTS = np.array([0.0, 0.0, 1.0, 1.0])
ARC_KNOTS = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
CIRCLE_KNOTS = np.array([0.0, 0.0, 0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1.0, 1.0, 1.0])
HALF = np.sqrt(0.5)  # weight of the middle point of a quarter
CIRCLE_POINTS = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], np.float64)
CIRCLE_WEIGHTS = np.array([1.0, HALF] * 4 + [1.0])


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of an outline: a line (degree 1), an arc below a half turn, or a whole circle (degree 2).

    Attributes:
        points: (m, 2) control points, mm.
        weights: (m,).
        knots: its knots over 0..1.
    """

    points: Array
    weights: Array
    knots: Array

    @property
    def degree(self) -> int:
        """1 or 2."""
        return len(self.knots) - len(self.points) - 1

    @property
    def rational(self) -> bool:
        """Whether it is curved."""
        return self.degree == 2

    @property
    def closed(self) -> bool:
        """Whether it is a whole circle."""
        return len(self.points) == len(CIRCLE_POINTS)

    def rows(self, points: Array) -> Array:
        """``points`` (m, dim), the images of the control points, as the record wants them: homogeneous if rational."""
        if not self.rational:
            return points
        return np.concatenate([points * self.weights[:, None], self.weights[:, None]], axis=1)

    def backwards(self) -> Piece:
        """The same piece run through from its end."""
        return Piece(self.points[::-1], self.weights[::-1], self.knots)


@dataclass(frozen=True, eq=False)
class Outline:
    """Pieces end to end; counter-clockwise unless said."""

    pieces: tuple[Piece, ...]

    @classmethod
    def circle(cls, radius: float, x: float = 0.0, y: float = 0.0) -> Self:
        """One closed piece that begins at (x + radius, y)."""
        points = np.array([x, y]) + radius * CIRCLE_POINTS
        return cls((Piece(points, CIRCLE_WEIGHTS, CIRCLE_KNOTS),))

    @classmethod
    def polygon(cls, corners: Array, radius: float | Array = 0.0) -> Self:
        """Straight sides between ``corners`` (n, 2), rounded by ``radius`` (one or (n,); 0: sharp), mm."""
        corners = np.asarray(corners, np.float64)
        n = len(corners)
        radii = np.broadcast_to(radius, n)
        entry, leave, weight = np.empty((n, 2)), np.empty((n, 2)), np.ones(n)
        for i in range(n):
            back, on = corners[i - 1] - corners[i], corners[(i + 1) % n] - corners[i]
            back, on = back / np.linalg.norm(back), on / np.linalg.norm(on)
            half = 0.5 * np.arccos(np.clip(back @ on, -1.0, 1.0))
            cut = radii[i] / np.tan(half)
            entry[i], leave[i], weight[i] = corners[i] + cut * back, corners[i] + cut * on, np.sin(half)
        pieces = []
        for i in range(n):
            if radii[i] > 0.0:
                points = np.stack([entry[i], corners[i], leave[i]])
                pieces.append(Piece(points, np.array([1.0, weight[i], 1.0]), ARC_KNOTS))
            follow = (i + 1) % n
            pieces.append(Piece(np.stack([leave[i], entry[follow]]), np.ones(2), LINE_KNOTS))
        return cls(tuple(pieces))

    @classmethod
    def rectangle(cls, width: float, height: float, radius: float = 0.0, x: float = 0.0, y: float = 0.0) -> Self:
        """Sides ``width`` and ``height`` around (x, y)."""
        w, h = 0.5 * width, 0.5 * height
        return cls.polygon(np.array([(x - w, y - h), (x + w, y - h), (x + w, y + h), (x - w, y + h)]), radius)

    @classmethod
    def regular(cls, n: int, across: float) -> Self:
        """Regular polygon of ``n`` sides, ``across`` between opposite sides (n even)."""
        turn = 2.0 * np.pi * (np.arange(n) + 0.5) / n
        reach = 0.5 * across / np.cos(np.pi / n)
        return cls.polygon(reach * np.stack([np.cos(turn), np.sin(turn)], axis=1))

    def backwards(self) -> Outline:
        """Run through the other way."""
        return Outline(tuple(piece.backwards() for piece in self.pieces[::-1]))

    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner of the control points."""
        points = np.concatenate([piece.points for piece in self.pieces])
        return points.min(axis=0), points.max(axis=0)
