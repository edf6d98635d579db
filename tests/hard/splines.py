"""B-splines with unkind knots and weights: creases, gaps, far weights, ripples no sample sees."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.sample_faces import add_face
from tests.hard.case import EXACT_OR_HEALED, HardCase
from tests.hard.loops import TURN, X, Y, Z
from tests.hard.nets import as_nurbs, tensor

Array = npt.NDArray[np.float64]

PI = np.pi
HYPAR_AREA = 1.2807892753  # of z = xy over the unit square
FLAT = np.array([0.0, 0.0, 1.0, 1.0])
FAR_WEIGHT = 1e4


def _strip(degree: int, knots: Array, profile: Array, height: float = 1.0, weights: Array | None = None) -> SurfaceForm:
    """A profile in x and z, ``height`` wide in y."""
    points, both = tensor(profile, height, weights)
    return SurfaceForm.nurbs(degree, 1, knots, FLAT, points, both)


def roof() -> SurfaceForm:
    """Two flat slopes of 45 degrees, quadratic, that meet at a knot of multiplicity 2."""
    x = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    return _strip(2, np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1.0]), np.stack([x, 1.0 - np.abs(x)], axis=1))


def cusps() -> SurfaceForm:
    """Two quarter cylinders of radius 1 that meet in a right angle at a knot of multiplicity 2."""
    profile = np.array([[-1, 1], [-1, 0], [0, 0], [0, 1], [1, 1.0]])
    w = np.array([1, np.sqrt(0.5), 1, np.sqrt(0.5), 1])
    return _strip(2, np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1.0]), profile, 1.0, w)


def off_cusps(points: Array) -> Array:
    """Distance from the cylinders of ``cusps``: about (0, 1) left of x = 0, about (1, 0) right of it."""
    left = np.hypot(points[:, 0], points[:, 2] - 1.0)
    right = np.hypot(points[:, 0] - 1.0, points[:, 2])
    return np.minimum(np.abs(left - 1.0), np.abs(right - 1.0))


def two_pieces() -> SurfaceForm:
    """A knot of multiplicity p + 1: two unit squares, one 2 mm further and 1 mm higher."""
    profile = np.array([[0, 0], [0.5, 0], [1, 0], [2, 1], [2.5, 1], [3, 1.0]])
    return _strip(2, np.array([0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1.0]), profile)


def off_two_pieces(points: Array) -> Array:
    """Distance from the two squares of ``two_pieces``."""
    x, z = points[:, 0], points[:, 2]
    low = np.hypot(np.maximum(x - 1.0, 0.0), z)
    high = np.hypot(np.maximum(2.0 - x, 0.0), z - 1.0)
    return np.minimum(low, high)


def far_weighted_arc(k: float) -> SurfaceForm:
    """A quarter cylinder of radius 1 whose weights are 1, k / sqrt 2, k^2: the same arc, run through unevenly."""
    profile = np.array([[1, 0], [1, 1], [0, 1.0]])
    return _strip(2, np.array([0, 0, 0, 1, 1, 1.0]), profile, 1.0, np.array([1.0, k * np.sqrt(0.5), k * k]))


def bilinear(weights: Array | None = None) -> SurfaceForm:
    """The unit square lifted to z = xy at its corners."""
    points = np.array([[[x, y, x * y] for y in (0.0, 1.0)] for x in (0.0, 1.0)])
    return SurfaceForm.nurbs(1, 1, FLAT, FLAT, points, weights)


def off_weighted_hypar(points: Array) -> Array:
    """A lower bound of the distance from z (1 - x - y + z) = 1e8 (x - z)(y - z): within 1e-4 of z = min(x, y)."""
    fold = np.abs(points[:, 2] - np.minimum(points[:, 0], points[:, 1])) / np.sqrt(2.0)
    return np.maximum(fold - 1.0 / FAR_WEIGHT, 0.0)


def ripples(n: int, amplitude: float) -> SurfaceForm:
    """A floor with ``n`` cubic waves amplitude * t (1 - t)(1 - 2t) each way: zero at ends and middles of all spans."""
    unit = np.array([0.0, 1.0, -1.0, 0.0]) * amplitude / 3.0  # Bézier points of t (1 - t)(1 - 2t)
    height = np.concatenate([[0.0], *[unit[1:]] * n])
    across = np.linspace(0.0, 4.0, 3 * n + 1)
    knots = np.concatenate([[0.0], np.repeat(np.arange(n + 1.0), 3), [float(n)]])
    points = np.empty((3 * n + 1, 3 * n + 1, 3))
    points[..., 0], points[..., 1] = across[:, None], across[None, :]
    points[..., 2] = height[:, None] + height[None, :]
    return SurfaceForm.nurbs(3, 3, knots, knots, points)


def off_ripples(points: Array, n: int, amplitude: float) -> Array:
    """Vertical distance from ``ripples``, made a lower bound of the distance by the largest slope."""

    def wave(x: Array) -> Array:
        t = np.mod(x * n / 4.0, 1.0)
        return amplitude * t * (1.0 - t) * (1.0 - 2.0 * t)

    steepest = np.sqrt(1.0 + 2.0 * (amplitude * n / 4.0) ** 2)
    return np.abs(points[:, 2] - wave(points[:, 0]) - wave(points[:, 1])) / steepest


def collapsed_quarter_disc() -> SurfaceForm:
    """A flat quarter disc of radius 1: all control points of one side lie in its centre."""
    arc = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    points = np.stack([np.zeros((3, 3)), arc])
    w = np.array([1.0, np.sqrt(0.5), 1.0])
    return SurfaceForm.nurbs(1, 2, FLAT, np.array([0, 0, 0, 1, 1, 1.0]), points, np.stack([w, w]))


def off_quarter_disc(points: Array) -> Array:
    """Distance from the flat quarter disc."""
    over = np.maximum(np.hypot(points[:, 0], points[:, 1]) - 1.0, 0.0)
    return np.hypot(over, points[:, 2])


def coincident_rows() -> SurfaceForm:
    """A flat bicubic unit square whose inner control points coincide in pairs: folds of the parametrisation only."""
    x = np.array([0.0, 0.3, 0.3, 0.7, 0.7, 1.0])
    points = np.zeros((6, 6, 3))
    points[..., 0], points[..., 1] = x[:, None], x[None, :]
    knots = np.array([0, 0, 0, 0, 1, 2, 3, 3, 3, 3.0])
    return SurfaceForm.nurbs(3, 3, knots, knots, points)


def thin_cylinder(length: float, nurbs: bool) -> SurfaceForm:
    """Radius 0.5 µm."""
    form = SurfaceForm.framed(SurfaceKind.CYLINDER, np.zeros(3), 5e-4 * X, 5e-4 * Y, Z, domain=(0.0, TURN, 0.0, length))
    return as_nurbs(form) if nurbs else form


def _face(form: SurfaceForm, builder: BatchBuilder) -> None:
    add_face(builder, form)


def spline_cases() -> list[HardCase]:
    """All cases of this module."""
    arc = {"area": PI / 2, "euler": 1, "components": 1, "distance": lambda p: np.abs(np.hypot(p[:, 0], p[:, 2]) - 1)}
    far_weights = np.array([[FAR_WEIGHT, 1.0], [1.0, FAR_WEIGHT]])
    thin = {"errors": (1e-4, 1e-5), "euler": 0, "components": 1, "far": False}
    short = thin | {"area": TURN * 5e-4, "slack": 2.0 * TURN}
    long = thin | {"area": TURN * 5e-4 * 1e5, "slack": 2.0 * TURN * 1e5}
    return [
        HardCase(
            "quarter_disc_collapsed_edge", partial(_face, collapsed_quarter_disc()), area=PI / 4, euler=1,
            components=1, distance=off_quarter_disc, normals_deg=1e-6,
        ),
        HardCase("crease_flat", partial(_face, roof()), area=2 * np.sqrt(2.0), euler=1, components=1,
                 distance=lambda p: np.abs(np.abs(p[:, 0]) + p[:, 2] - 1.0) / np.sqrt(2.0), normals_deg=1e-5),
        HardCase("crease_between_arcs", partial(_face, cusps()), area=PI, euler=1, components=1,
                 distance=off_cusps, normals_deg=45.0),
        HardCase("knot_p+1_two_components", partial(_face, two_pieces()), area=2.0, euler=2, components=2,
                 distance=off_two_pieces, statuses=EXACT_OR_HEALED, reasons=()),
        HardCase("quarter_circle_weights_1", partial(_face, far_weighted_arc(1.0)), **arc),
        # A step of the lattice moves it by 2e-5 mm; with 1e-7 mm of roundoff on top triangles of a few steps may fold.
        HardCase("quarter_circle_weights_1e4", partial(_face, far_weighted_arc(1e4)), far=False, **arc),
        HardCase("hypar", partial(_face, bilinear()), area=HYPAR_AREA, euler=1, components=1, errors=(0.25, 1e-2, 1e-3),
                 distance=lambda p: np.abs(p[:, 2] - p[:, 0] * p[:, 1]) / np.sqrt(3.0)),
        HardCase("hypar_weights_1e4", partial(_face, bilinear(far_weights)), area=np.sqrt(2.0), euler=1, components=1,
                 distance=off_weighted_hypar),
        HardCase("ripples", partial(_face, ripples(4, 1.0)), euler=1, components=1,
                 distance=lambda p: off_ripples(p, 4, 1.0)),
        HardCase("one_ripple", partial(_face, ripples(1, 2.0)), euler=1, components=1,
                 distance=lambda p: off_ripples(p, 1, 2.0)),
        HardCase("coincident_control_points", partial(_face, coincident_rows()), area=1.0, euler=1, components=1,
                 distance=lambda p: np.abs(p[:, 2])),
        HardCase("thin_cylinder_1_long", partial(_face, thin_cylinder(1.0, False)), **short),
        HardCase("thin_cylinder_1e5_long", partial(_face, thin_cylinder(1e5, False)), **long),
        HardCase("rational_thin_cylinder_1_long", partial(_face, thin_cylinder(1.0, True)), **short),
        HardCase("rational_thin_cylinder_1e5_long", partial(_face, thin_cylinder(1e5, True)), **long),
    ]  # fmt: skip
