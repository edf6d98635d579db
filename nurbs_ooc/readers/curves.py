"""Curves of the kernel, in 2 or 3 dimensions, as ``CurveForm`` with the same parameter.

Lines, conics, Bezier and B-spline curves come out exactly. Parabolas are polynomials of degree 2.
Offset curves have no closed form and are approximated; the error is given back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from OCP.Geom import Geom_TrimmedCurve
from OCP.Geom2d import Geom2d_TrimmedCurve
from OCP.Geom2dConvert import Geom2dConvert_ApproxCurve
from OCP.GeomAbs import GeomAbs_Shape
from OCP.GeomConvert import GeomConvert_ApproxCurve

from nurbs_cache.surface_record import CurveKind, FaceReason
from nurbs_ooc.geometry.forms import Array, CurveForm, homogeneous
from nurbs_ooc.readers import kernel_arrays
from nurbs_ooc.readers.clamping import clamp, unroll
from nurbs_ooc.readers.refusal import FaceRefusedError, require_finite, require_weights

OFFSET_TOLERANCE = 1e-6  # mm (or parameter units in 2D): asked of the kernel for offset curves
OFFSET_MAX_DEGREE = 8
OFFSET_MAX_SPANS = 400


def curve_form(curve: Any, t0: float, t1: float) -> CurveForm:
    """The part t0..t1 of ``curve`` (a ``Geom_Curve`` or ``Geom2d_Curve``).

    Raises:
        FaceRefusedError: not finite, weights that are not positive, or a kind we do not know.
    """
    if not (np.isfinite(t0) and np.isfinite(t1) and t0 < t1):
        raise FaceRefusedError(FaceReason.NOT_FINITE, f"curve range {t0} to {t1}")
    name = type(curve).__name__.split("_", 1)[1]
    form = _READERS.get(name, _unknown)(curve, t0, t1)
    require_finite(form.points, form.knots)
    return form


def _line(curve: Any, t0: float, t1: float) -> CurveForm:
    return CurveForm.line(curve.Value(t0).Coord(), curve.Value(t1).Coord(), t0, t1)


def _axes(curve: Any) -> tuple[Array, Array, Array]:
    center = np.array(curve.Location().Coord())
    return center, np.array(curve.XAxis().Direction().Coord()), np.array(curve.YAxis().Direction().Coord())


def _circle(curve: Any, t0: float, t1: float) -> CurveForm:
    center, x, y = _axes(curve)
    radius = curve.Radius()
    return CurveForm.ellipse(center, radius * x, radius * y, t0, t1)


def _ellipse(curve: Any, t0: float, t1: float) -> CurveForm:
    center, x, y = _axes(curve)
    return CurveForm.ellipse(center, curve.MajorRadius() * x, curve.MinorRadius() * y, t0, t1)


def _hyperbola(curve: Any, t0: float, t1: float) -> CurveForm:
    center, x, y = _axes(curve)
    return CurveForm.hyperbola(center, curve.MajorRadius() * x, curve.MinorRadius() * y, t0, t1)


def _parabola(curve: Any, t0: float, t1: float) -> CurveForm:
    """P(t) = C + t^2 / (4 f) X + t Y as one Bezier piece, by its blossom P(t0, t0), P(t0, t1), P(t1, t1)."""
    center, x, y = _axes(curve)
    scale = 0.25 / curve.Focal()
    pairs = [(t0, t0), (t0, t1), (t1, t1)]
    points = [center + a * b * scale * x + 0.5 * (a + b) * y for a, b in pairs]
    return CurveForm.nurbs(2, [t0, t0, t0, t1, t1, t1], points)


def _trimmed(curve: Any, t0: float, t1: float) -> CurveForm:
    return curve_form(curve.BasisCurve(), t0, t1)


def _points(curve: Any) -> tuple[Array, bool]:
    points = kernel_arrays.points(curve.Poles())
    if not curve.IsRational():
        return points, False
    # not Weights(): the binding frees the curve's own array
    weights = np.array([curve.Weight(i + 1) for i in range(len(points))])
    require_weights(weights)
    return homogeneous(points, weights)


def _dim(points: Array, rational: bool) -> int:
    return int(points.shape[-1]) - int(rational)


def _bezier(curve: Any, t0: float, t1: float) -> CurveForm:
    points, rational = _points(curve)
    degree = len(points) - 1
    knots = np.repeat([0.0, 1.0], degree + 1)
    return _clipped(CurveForm(CurveKind.NURBS, _dim(points, rational), points, t0, t1, degree, knots, rational))


def _bspline(curve: Any, t0: float, t1: float) -> CurveForm:
    periodic = curve.IsPeriodic()
    if periodic:
        curve = curve.Copy()
        curve.SetNotPeriodic()
    points, rational = _points(curve)
    degree, knots = curve.Degree(), kernel_arrays.numbers(curve.KnotSequence())
    knots, points = clamp(knots, degree, points)
    if periodic:
        knots, points = unroll(knots, degree, points, t0, t1)
    return _clipped(CurveForm(CurveKind.NURBS, _dim(points, rational), points, t0, t1, degree, knots, rational))


def _clipped(form: CurveForm) -> CurveForm:
    """Keep the used range inside the knots: rounding may put it a little outside."""
    low, high = float(form.knots[0]), float(form.knots[-1])
    t0, t1 = max(form.t0, low), min(form.t1, high)
    if not t0 < t1:
        raise FaceRefusedError(
            FaceReason.BAD_KNOTS, f"curve range {form.t0} to {form.t1} outside knots {low} to {high}"
        )
    return replace(form, t0=t0, t1=t1)


def _offset(curve: Any, t0: float, t1: float) -> CurveForm:
    plane = type(curve).__name__.startswith("Geom2d")
    trim, convert = (
        (Geom2d_TrimmedCurve, Geom2dConvert_ApproxCurve) if plane else (Geom_TrimmedCurve, GeomConvert_ApproxCurve)
    )
    fit = convert(trim(curve, t0, t1), OFFSET_TOLERANCE, GeomAbs_Shape.GeomAbs_C1, OFFSET_MAX_SPANS, OFFSET_MAX_DEGREE)
    if not fit.HasResult():
        raise FaceRefusedError(FaceReason.KERNEL_REFUSED, "offset curve has no approximation")
    return _bspline(fit.Curve(), t0, t1)


def _unknown(curve: Any, _t0: float, _t1: float) -> CurveForm:
    raise FaceRefusedError(FaceReason.KERNEL_REFUSED, f"curve of unknown kind {type(curve).__name__}")


_READERS = {
    "Line": _line,
    "Circle": _circle,
    "Ellipse": _ellipse,
    "Hyperbola": _hyperbola,
    "Parabola": _parabola,
    "TrimmedCurve": _trimmed,
    "BezierCurve": _bezier,
    "BSplineCurve": _bspline,
    "OffsetCurve": _offset,
}
