"""Single curves and surfaces as small values: what a reader or a generator makes, before it joins a batch.

The kinds and their formulas are those of ``nurbs_cache.surface_record``; the methods here are for the
few points a reader needs (corners, loop ends). Hot paths work on the batch's arrays instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, SurfaceKind

Array = npt.NDArray[np.float64]
Vector = Array | Sequence[float]

NO_VALUES: Array = np.empty(0)


def _no_values() -> Array:
    return NO_VALUES


def bspline_basis(knots: Array, degree: int, t: float) -> Array:
    """All B-spline basis functions at ``t``, which is clamped to the domain.

    Returns:
        (n,) values that sum to 1, n = len(knots) - degree - 1.

    Source: de Boor, A Practical Guide to Splines (2001), chapter X, recurrence (4)-(5).
    """
    n = len(knots) - degree - 1
    t = min(max(t, float(knots[degree])), float(knots[n]))
    span = min(int(np.searchsorted(knots, t, side="right")) - 1, n - 1)
    while span > degree and knots[span] == knots[span + 1]:
        span -= 1
    values = [1.0]
    for k in range(1, degree + 1):
        raised = [0.0] * (k + 1)
        for i, value in enumerate(values):
            left, right = float(knots[span - k + 1 + i]), float(knots[span + 1 + i])
            share = (t - left) / (right - left) if right > left else 0.0
            raised[i] += (1.0 - share) * value
            raised[i + 1] += share * value
        values = raised
    basis = np.zeros(n)
    basis[span - degree : span + 1] = values
    return basis


def _project(points_w: Array, rational: bool) -> Array:
    return points_w[..., :-1] / points_w[..., -1:] if rational else points_w


def homogeneous(points: Array, weights: Array | None) -> tuple[Array, bool]:
    """Control points as the record wants them: plain if all weights are equal, else rows (w x, w y, .., w)."""
    if weights is None or weights.size == 0 or np.all(weights == weights.flat[0]):
        return np.ascontiguousarray(points, np.float64), False
    return np.concatenate([points * weights[..., None], weights[..., None]], axis=-1), True


@dataclass(frozen=True, eq=False)
class CurveForm:
    """One curve in 2 or 3 dimensions.

    Attributes:
        kind: what ``points`` means, see ``nurbs_cache.surface_record``.
        dim: 2 or 3.
        points: NURBS: (n, dim) or, if rational, (n, dim + 1) control points; else (3, dim): C, A, B.
        t0, t1: used parameter range, t0 < t1.
        knots: (n + degree + 1,) clamped, NURBS only.
    """

    kind: CurveKind
    dim: int
    points: Array
    t0: float
    t1: float
    degree: int = 0
    knots: Array = field(default_factory=_no_values)
    rational: bool = False

    @classmethod
    def line(cls, start: Vector, end: Vector, t0: float = 0.0, t1: float = 1.0) -> Self:
        """Straight from ``start`` at t0 to ``end`` at t1."""
        points = np.array([start, end], np.float64)
        return cls(CurveKind.NURBS, points.shape[1], points, t0, t1, 1, np.array([t0, t0, t1, t1], np.float64))

    @classmethod
    def nurbs(cls, degree: int, knots: Vector, points: Vector | Array, weights: Vector | None = None) -> Self:
        """B-spline over its whole domain; ``points`` (n, dim) are not yet multiplied by ``weights`` (n,)."""
        knots, points = np.asarray(knots, np.float64), np.asarray(points, np.float64)
        rows, rational = homogeneous(points, None if weights is None else np.asarray(weights, np.float64))
        t0, t1 = float(knots[degree]), float(knots[-degree - 1])
        return cls(CurveKind.NURBS, points.shape[1], rows, t0, t1, degree, knots, rational)

    @classmethod
    def ellipse(cls, center: Vector, a: Vector, b: Vector, t0: float = 0.0, t1: float = 2.0 * np.pi) -> Self:
        """C + cos(t) A + sin(t) B; a circle if A and B are orthogonal and of equal length."""
        points = np.array([center, a, b], np.float64)
        return cls(CurveKind.ELLIPSE, points.shape[1], points, t0, t1)

    @classmethod
    def hyperbola(cls, center: Vector, a: Vector, b: Vector, t0: float, t1: float) -> Self:
        """C + cosh(t) A + sinh(t) B."""
        points = np.array([center, a, b], np.float64)
        return cls(CurveKind.HYPERBOLA, points.shape[1], points, t0, t1)

    def point(self, t: float) -> Array:
        """(dim,) point at parameter ``t``."""
        if self.kind == CurveKind.NURBS:
            if t <= self.knots[0]:
                return _project(self.points[0], self.rational)
            if t >= self.knots[-1]:
                return _project(self.points[-1], self.rational)
            if len(self.points) == 2:
                share = (t - self.knots[0]) / (self.knots[-1] - self.knots[0])
                return _project((1.0 - share) * self.points[0] + share * self.points[1], self.rational)
            return _project(bspline_basis(self.knots, self.degree, t) @ self.points, self.rational)
        c, a, b = self.points
        if self.kind == CurveKind.ELLIPSE:
            return np.asarray(c + np.cos(t) * a + np.sin(t) * b)
        return np.asarray(c + np.cosh(t) * a + np.sinh(t) * b)

    @cached_property
    def start(self) -> Array:
        """(dim,) point at t0."""
        return self.point(self.t0)

    @cached_property
    def end(self) -> Array:
        """(dim,) point at t1."""
        return self.point(self.t1)

    def over(self, t0: float, t1: float) -> Self:
        """The same curve, used from t0 to t1."""
        return replace(self, t0=t0, t1=t1)

    def mapped(self, matrix: Array, offset: Vector) -> Self:
        """The curve under x -> matrix x + offset; ``matrix`` is (dim, dim)."""
        shift = np.asarray(offset, np.float64)
        points = self.points[:, : self.dim] @ matrix.T
        if self.rational:
            weights = self.points[:, self.dim :]
            return replace(self, points=np.concatenate([points + weights * shift, weights], axis=1))
        if self.kind == CurveKind.NURBS:
            return replace(self, points=points + shift)
        points[0] += shift
        return replace(self, points=points)

    def shifted(self, offset: Vector) -> Self:
        """The curve moved by ``offset``."""
        return self.mapped(np.eye(self.dim), offset)

    def hull(self) -> tuple[Array, Array]:
        """Lower and upper corner of a box around the used range; tight for lines and arcs, a hull for splines."""
        if self.kind == CurveKind.ELLIPSE:
            _, a, b = self.points
            turns = np.arctan2(b, a)
            first = np.ceil((self.t0 - turns) / np.pi)
            peaks = [t for d in range(self.dim) for t in turns[d] + np.pi * (first[d] + np.arange(3))]
            parameters = [self.t0, self.t1, *(t for t in peaks if self.t0 < t < self.t1)]
            rows = np.array([self.point(t) for t in parameters])
        elif self.kind == CurveKind.HYPERBOLA:
            rows = np.array([self.point(t) for t in np.linspace(self.t0, self.t1, 65)])
        else:
            rows = self.polygon()
        return rows.min(axis=0), rows.max(axis=0)

    def polygon(self) -> Array:
        """(n, dim) points near the used range, from one end to the other.

        The control points of its spans, its ends if straight, chords of a conic.
        """
        if self.kind != CurveKind.NURBS:
            return np.array([self.point(t) for t in np.linspace(self.t0, self.t1, 17)])
        if len(self.points) == 2:
            return np.array([self.start, self.end])
        n = len(self.points)
        first = min(max(int(np.searchsorted(self.knots, self.t0, side="right")) - 1, self.degree), n - 1)
        last = min(max(int(np.searchsorted(self.knots, self.t1, side="left")) - 1, first), n - 1)
        return _project(self.points[first - self.degree : last + 1], self.rational)


@dataclass(frozen=True, eq=False)
class SurfaceForm:
    """One untrimmed surface.

    Attributes:
        kind: see ``nurbs_cache.surface_record``.
        frame: (14,) O, X, Y, Z, a, b; empty for NURBS.
        u0, u1, v0, v1: the native domain that is used.
        degree_u, degree_v, knots_u, knots_v, points, rational: NURBS only; points (n_u, n_v, 3 or 4).
        profile: the profile curve of a REVOLUTION or EXTRUSION.
        u_period, v_period: 0 if not periodic.
    """

    kind: SurfaceKind
    frame: Array
    u0: float
    u1: float
    v0: float
    v1: float
    degree_u: int = 0
    degree_v: int = 0
    knots_u: Array = field(default_factory=_no_values)
    knots_v: Array = field(default_factory=_no_values)
    points: Array = field(default_factory=_no_values)
    rational: bool = False
    profile: CurveForm | None = None
    u_period: float = 0.0
    v_period: float = 0.0

    @classmethod
    def nurbs(
        cls,
        degree_u: int,
        degree_v: int,
        knots_u: Vector,
        knots_v: Vector,
        points: Array,
        weights: Array | None = None,
    ) -> Self:
        """B-spline surface over its whole domain; ``points`` (n_u, n_v, 3) not yet multiplied by ``weights``."""
        knots_u, knots_v = np.asarray(knots_u, np.float64), np.asarray(knots_v, np.float64)
        rows, rational = homogeneous(np.asarray(points, np.float64), weights)
        u0, u1 = float(knots_u[degree_u]), float(knots_u[-degree_u - 1])
        v0, v1 = float(knots_v[degree_v]), float(knots_v[-degree_v - 1])
        return cls(SurfaceKind.NURBS, NO_VALUES, u0, u1, v0, v1, degree_u, degree_v, knots_u, knots_v, rows, rational)

    @classmethod
    def framed(
        cls,
        kind: SurfaceKind,
        origin: Vector,
        x: Vector,
        y: Vector,
        z: Vector,
        a: float = 0.0,
        b: float = 0.0,
        profile: CurveForm | None = None,
        domain: Sequence[float] = (0.0, 2.0 * np.pi, 0.0, 1.0),
    ) -> Self:
        """A surface of one of the closed-form kinds over ``domain`` = u0, u1, v0, v1."""
        frame = np.concatenate([origin, x, y, z, [a, b]]).astype(np.float64)
        turn = 2.0 * np.pi
        turns_in_u = kind not in (SurfaceKind.PLANE, SurfaceKind.EXTRUSION)
        u_period, v_period = turn if turns_in_u else 0.0, turn if kind == SurfaceKind.TORUS else 0.0
        u0, u1, v0, v1 = domain
        return cls(kind, frame, u0, u1, v0, v1, profile=profile, u_period=u_period, v_period=v_period)

    def over(self, u0: float, u1: float, v0: float, v1: float) -> Self:
        """The same surface, used over another part of its domain."""
        return replace(self, u0=u0, u1=u1, v0=v0, v1=v1)

    def point(self, u: float, v: float) -> Array:
        """(3,) point at (u, v)."""
        return self.iso_v(v).point(u)

    def iso_u(self, u: float) -> CurveForm:
        """The curve v -> S(u, v) over v0..v1, exact, with v as its parameter."""
        if self.kind == SurfaceKind.NURBS:
            basis = bspline_basis(self.knots_u, self.degree_u, u)
            points = np.tensordot(basis, self.points, axes=(0, 0))
            return CurveForm(CurveKind.NURBS, 3, points, self.v0, self.v1, self.degree_v, self.knots_v, self.rational)
        o, x, y, z = self.frame[:12].reshape(4, 3)
        a, b = self.frame[12:]
        ray = np.cos(u) * x + np.sin(u) * y
        if self.kind == SurfaceKind.SPHERE:
            return CurveForm.ellipse(o, a * ray, a * z, self.v0, self.v1)
        if self.kind == SurfaceKind.TORUS:
            return CurveForm.ellipse(o + a * ray, b * ray, b * z, self.v0, self.v1)
        if self.kind == SurfaceKind.REVOLUTION:
            assert self.profile is not None
            turn = rotation(z, u)
            return self.profile.mapped(turn, o - turn @ o).over(self.v0, self.v1)
        start, slope = o + u * x, y  # PLANE
        if self.kind == SurfaceKind.CYLINDER:
            start, slope = o + ray, z
        elif self.kind == SurfaceKind.CONE:
            start, slope = o + a * ray, np.sin(b) * ray + np.cos(b) * z
        elif self.kind == SurfaceKind.EXTRUSION:
            assert self.profile is not None
            start, slope = self.profile.point(u), z
        return CurveForm.line(start + self.v0 * slope, start + self.v1 * slope, self.v0, self.v1)

    def iso_v(self, v: float) -> CurveForm:
        """The curve u -> S(u, v) over u0..u1, exact, with u as its parameter."""
        if self.kind == SurfaceKind.NURBS:
            basis = bspline_basis(self.knots_v, self.degree_v, v)
            points = np.tensordot(self.points, basis, axes=(1, 0))
            return CurveForm(CurveKind.NURBS, 3, points, self.u0, self.u1, self.degree_u, self.knots_u, self.rational)
        o, x, y, z = self.frame[:12].reshape(4, 3)
        a, b = self.frame[12:]
        if self.kind == SurfaceKind.PLANE:
            start = o + v * y
            return CurveForm.line(start + self.u0 * x, start + self.u1 * x, self.u0, self.u1)
        if self.kind == SurfaceKind.EXTRUSION:
            assert self.profile is not None
            return self.profile.shifted(v * z).over(self.u0, self.u1)
        if self.kind == SurfaceKind.REVOLUTION:
            assert self.profile is not None
            start = self.profile.point(v)
            foot = o + np.dot(start - o, z) * z
            return CurveForm.ellipse(foot, start - foot, np.cross(z, start - foot), self.u0, self.u1)
        radius, height = 1.0, v  # CYLINDER
        if self.kind == SurfaceKind.CONE:
            radius, height = a + v * np.sin(b), v * np.cos(b)
        elif self.kind == SurfaceKind.SPHERE:
            radius, height = a * np.cos(v), a * np.sin(v)
        elif self.kind == SurfaceKind.TORUS:
            radius, height = a + b * np.cos(v), b * np.sin(v)
        return CurveForm.ellipse(o + height * z, radius * x, radius * y, self.u0, self.u1)


def rotation(axis: Array, angle: float) -> Array:
    """(3, 3) rotation by ``angle`` about the unit vector ``axis`` (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * np.outer(axis, axis))
