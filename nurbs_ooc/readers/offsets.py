"""Offset surfaces without a closed form, as B-splines with a measured error."""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.Geom import Geom_RectangularTrimmedSurface
from OCP.GeomAbs import GeomAbs_Shape
from OCP.GeomConvert import GeomConvert_ApproxSurface

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.readers.refusal import FaceRefusedError

TOLERANCE = 1e-5  # mm, first try
COARSEST = 1e-2  # mm, the last try; each try allows ten times more
MAX_DEGREE, MAX_SPANS = 8, 60
SAMPLES = 41  # per direction, for the measured error
SAFETY = 2.0  # on the measured maximum, because the samples miss the peaks


def approximated_offset(surface: Any, box: tuple[float, float, float, float]) -> tuple[Any, float]:
    """A ``Geom_BSplineSurface`` near ``surface`` over ``box``, and its error in mm.

    The error is the largest of the kernel's own estimate and twice the largest of 41 x 41 sampled
    distances at equal parameters.

    Raises:
        FaceRefusedError: the kernel finds no approximation, or the surface has no normal somewhere.
    """
    tolerance = TOLERANCE
    while tolerance <= COARSEST:
        spline, estimate = _approximate(Geom_RectangularTrimmedSurface(surface, *box), tolerance)
        if spline is not None:
            return spline, max(estimate, SAFETY * _distance(surface, spline, box))
        tolerance *= 10.0
    raise FaceRefusedError(FaceReason.KERNEL_REFUSED, f"offset surface: no B-spline within {COARSEST} mm")


def _approximate(trimmed: Any, tolerance: float) -> tuple[Any, float]:
    smooth = GeomAbs_Shape.GeomAbs_C1
    try:
        fit = GeomConvert_ApproxSurface(trimmed, tolerance, smooth, smooth, MAX_DEGREE, MAX_DEGREE, MAX_SPANS, 0)
    except Exception as error:
        raise FaceRefusedError(FaceReason.KERNEL_REFUSED, f"offset surface: {error}") from error
    good = fit.HasResult() and fit.MaxError() <= 10.0 * tolerance
    return (fit.Surface(), fit.MaxError()) if good else (None, 0.0)


def _distance(surface: Any, spline: Any, box: tuple[float, float, float, float]) -> float:
    largest = 0.0
    for u in np.linspace(box[0], box[1], SAMPLES):
        for v in np.linspace(box[2], box[3], SAMPLES):
            largest = max(largest, surface.Value(u, v).Distance(spline.Value(u, v)))
    return largest
