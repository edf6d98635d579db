"""Surfaces of the kernel as ``SurfaceForm`` with the same parameters, exact in their own kind.

The used domain ``box`` = (u0, u1, v0, v1) has to be known first: it bounds the profiles of sweeps
along infinite lines and unrolls periodic B-splines over their origin.

A parallel (offset) surface of a plane, cylinder, cone, sphere or torus is one of the same kind; with
the unit normal n along S_u x S_v::

    cylinder   R + d            cone   a + d cos b, O - d sin b Z            (right-handed frames;
    sphere     R + d            torus  minor radius + d                       left-handed: -d)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nurbs_cache.surface_record import FaceReason, FaceStatus, SurfaceKind
from nurbs_ooc.geometry.forms import Array, SurfaceForm, homogeneous
from nurbs_ooc.readers import kernel_arrays
from nurbs_ooc.readers.clamping import clamp, extend, unroll
from nurbs_ooc.readers.curves import curve_form
from nurbs_ooc.readers.offsets import approximated_offset
from nurbs_ooc.readers.refusal import FaceRefusedError, require_finite, require_knots, require_weights

Box = tuple[float, float, float, float]
BORDER_ROUNDING = 1e-9  # of the domain: p-curves that run less over the border run along it
BORDER_SHARE = 0.1  # of the domain: how far a spline is continued at most


@dataclass(frozen=True)
class SurfaceReading:
    """A surface and what reading it changed."""

    form: SurfaceForm
    status: FaceStatus = FaceStatus.EXACT
    reason: FaceReason = FaceReason.NONE
    approximation_error: float = 0.0


def read_surface(surface: Any, box: Box) -> SurfaceReading:
    """Record ``surface`` (a ``Geom_Surface``) over ``box``.

    Raises:
        FaceRefusedError: not finite, bad weights or knots, or a kind we do not know.
    """
    name = type(surface).__name__.removeprefix("Geom_")
    if name == "RectangularTrimmedSurface":
        return read_surface(surface.BasisSurface(), box)
    if name == "OffsetSurface":
        reading = _offset(surface, box)
    else:
        reading = SurfaceReading(_READERS.get(name, _unknown)(surface, box))
    form = reading.form
    require_finite(form.frame, form.points, form.knots_u, form.knots_v)
    return reading


def _axes(surface: Any) -> tuple[Array, Array, Array, Array]:
    """O, X, Y, Z; a left-handed frame keeps its own Y."""
    position = surface.Position()
    rows = (position.Location(), position.XDirection(), position.YDirection(), position.Direction())
    o, x, y, z = (np.array(row.Coord()) for row in rows)
    return o, x, y, z


def _plane(surface: Any, box: Box) -> SurfaceForm:
    return SurfaceForm.framed(SurfaceKind.PLANE, *_axes(surface), domain=box)


def _cylinder(surface: Any, box: Box) -> SurfaceForm:
    o, x, y, z = _axes(surface)
    radius = surface.Radius()
    return SurfaceForm.framed(SurfaceKind.CYLINDER, o, radius * x, radius * y, z, domain=box)


def _cone(surface: Any, box: Box) -> SurfaceForm:
    frame = _axes(surface)
    return SurfaceForm.framed(SurfaceKind.CONE, *frame, surface.RefRadius(), surface.SemiAngle(), domain=box)


def _sphere(surface: Any, box: Box) -> SurfaceForm:
    return SurfaceForm.framed(SurfaceKind.SPHERE, *_axes(surface), surface.Radius(), domain=box)


def _torus(surface: Any, box: Box) -> SurfaceForm:
    major, minor = surface.MajorRadius(), surface.MinorRadius()
    return SurfaceForm.framed(SurfaceKind.TORUS, *_axes(surface), major, minor, domain=box)


def _extrusion(surface: Any, box: Box) -> SurfaceForm:
    profile = curve_form(surface.BasisCurve(), box[0], box[1])
    nothing, direction = np.zeros(3), surface.Direction().Coord()
    form = SurfaceForm.framed(SurfaceKind.EXTRUSION, nothing, nothing, nothing, direction, profile=profile, domain=box)
    return replace(form, u_period=surface.UPeriod() if surface.IsUPeriodic() else 0.0)


def _revolution(surface: Any, box: Box) -> SurfaceForm:
    profile = curve_form(surface.BasisCurve(), box[2], box[3])
    position = surface.Axis()
    o, z = np.array(position.Location().Coord()), np.array(position.Direction().Coord())
    x, y = perpendiculars(z)
    form = SurfaceForm.framed(SurfaceKind.REVOLUTION, o, x, y, z, profile=profile, domain=box)
    return replace(form, v_period=surface.VPeriod() if surface.IsVPeriodic() else 0.0)


def perpendiculars(z: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with the unit vector ``z``."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return x, np.cross(z, x)


def _poles(surface: Any) -> tuple[Array, bool]:
    points = kernel_arrays.grid_points(surface.Poles())
    if not (surface.IsURational() or surface.IsVRational()):
        return points, False
    rows, columns = range(1, points.shape[0] + 1), range(1, points.shape[1] + 1)
    # not Weights(): the binding frees the surface's own array
    weights = np.array([[surface.Weight(i, j) for j in columns] for i in rows])
    require_weights(weights)
    return homogeneous(points, weights)


def _bezier(surface: Any, box: Box) -> SurfaceForm:
    points, rational = _poles(surface)
    degrees = (points.shape[0] - 1, points.shape[1] - 1)
    knots = [np.repeat([0.0, 1.0], degree + 1) for degree in degrees]
    return _covering(points, rational, degrees, knots, (0.0, 0.0), box)


def _bspline(surface: Any, box: Box) -> SurfaceForm:
    periods = [
        surface.UPeriod() if surface.IsUPeriodic() else 0.0,
        surface.VPeriod() if surface.IsVPeriodic() else 0.0,
    ]
    if any(periods):
        surface = surface.Copy()
        surface.SetUNotPeriodic()
        surface.SetVNotPeriodic()
    points, rational = _poles(surface)
    degrees = (surface.UDegree(), surface.VDegree())
    knots = [kernel_arrays.numbers(surface.UKnotSequence()), kernel_arrays.numbers(surface.VKnotSequence())]
    for axis in range(2):
        require_knots(knots[axis], degrees[axis], points.shape[axis])
        rows = points if axis == 0 else points.swapaxes(0, 1)
        knots[axis], rows = clamp(knots[axis], degrees[axis], rows)
        if periods[axis]:
            knots[axis], rows = unroll(knots[axis], degrees[axis], rows, box[2 * axis], box[2 * axis + 1])
            periods[axis] = periods[axis] if np.ptp(knots[axis]) >= periods[axis] * (1.0 - 1e-9) else 0.0
        points = rows if axis == 0 else rows.swapaxes(0, 1)
    return _covering(points, rational, degrees, knots, (periods[0], periods[1]), box)


def _covering(
    points: Array,
    rational: bool,
    degrees: tuple[int, int],
    knots: list[Array],
    periods: tuple[float, float],
    box: Box,
) -> SurfaceForm:
    """The spline, continued a little where the loops run over its border."""
    for axis in range(2):
        low, high = float(knots[axis][0]), float(knots[axis][-1])
        slack, most = BORDER_ROUNDING * (high - low), BORDER_SHARE * (high - low)
        t0, t1 = box[2 * axis], box[2 * axis + 1]
        t0 = low if t0 >= low - slack else max(t0, low - most)
        t1 = high if t1 <= high + slack else min(t1, high + most)
        rows = points if axis == 0 else points.swapaxes(0, 1)
        knots[axis], rows = extend(knots[axis], degrees[axis], rows, t0, t1)
        points = rows if axis == 0 else rows.swapaxes(0, 1)
    if rational:
        require_weights(points[..., 3])
    u0, u1 = np.clip(box[:2], knots[0][0], knots[0][-1])
    v0, v1 = np.clip(box[2:], knots[1][0], knots[1][-1])
    domain = (float(u0), float(u1), float(v0), float(v1))
    return SurfaceForm(
        SurfaceKind.NURBS, np.empty(0), *domain, *degrees, knots[0], knots[1], points, rational, None, *periods
    )


def _offset(surface: Any, box: Box) -> SurfaceReading:
    distance, basis = surface.Offset(), surface.BasisSurface()
    while type(basis).__name__ == "Geom_RectangularTrimmedSurface":
        basis = basis.BasisSurface()
    reading = read_surface(basis, box)
    u, v = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])
    expected = np.array(surface.Value(u, v).Coord())
    for signed in (distance, -distance):  # which side is positive in a left-handed frame is the kernel's own choice
        parallel = parallel_surface(reading.form, signed)
        if parallel is not None and np.abs(parallel.point(u, v) - expected).max() < 1e-6 * abs(distance):
            return replace(reading, form=parallel)
    spline, error = approximated_offset(surface, box)
    return SurfaceReading(spline, FaceStatus.HEALED, FaceReason.OFFSET_APPROXIMATED, error)


def parallel_surface(form: SurfaceForm, distance: float) -> SurfaceForm | None:
    """The surface at ``distance`` along the normal S_u x S_v in closed form; None where there is none."""
    if form.frame.size == 0 or form.kind in (SurfaceKind.EXTRUSION, SurfaceKind.REVOLUTION):
        return None
    o, x, y, z = form.frame[:12].reshape(4, 3)
    a, b = form.frame[12:]
    side = np.sign(np.dot(np.cross(x, y), z)) * distance
    if form.kind == SurfaceKind.PLANE:
        normal = np.cross(x, y)
        o = o + distance * normal
    elif form.kind == SurfaceKind.CYLINDER:
        grown = 1.0 + side / float(np.linalg.norm(x))
        if grown <= 0.0:
            return None
        x, y = grown * x, grown * y
    elif form.kind == SurfaceKind.CONE:
        ends = a + np.array([form.v0, form.v1]) * np.sin(b)
        if (ends < -1e-9 * abs(ends).max()).any():
            return None
        a, o = a + side * np.cos(b), o - side * np.sin(b) * z
    elif form.kind == SurfaceKind.SPHERE:
        a += side
    else:
        b += side
    if (form.kind == SurfaceKind.SPHERE and a <= 0.0) or (form.kind == SurfaceKind.TORUS and b <= 0.0):
        return None
    return replace(form, frame=np.concatenate([o, x, y, z, [a, b]]))


def _unknown(surface: Any, _box: Box) -> SurfaceForm:
    raise FaceRefusedError(FaceReason.KERNEL_REFUSED, f"surface of unknown kind {type(surface).__name__}")


_READERS = {
    "Plane": _plane,
    "CylindricalSurface": _cylinder,
    "ConicalSurface": _cone,
    "SphericalSurface": _sphere,
    "ToroidalSurface": _torus,
    "SurfaceOfLinearExtrusion": _extrusion,
    "SurfaceOfRevolution": _revolution,
    "BezierSurface": _bezier,
    "BSplineSurface": _bspline,
}
