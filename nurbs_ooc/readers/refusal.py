"""Why one face cannot be taken as it is: caught per face, recorded, never the end of an assembly."""

from __future__ import annotations

import numpy as np

from nurbs_cache.surface_record import FaceReason
from nurbs_ooc.geometry.forms import Array


class FaceRefusedError(Exception):
    """A face, or a curve of it, cannot be recorded.

    Attributes:
        reason: the code for the report.
    """

    def __init__(self, reason: FaceReason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


def require_finite(*arrays: Array) -> None:
    """Raise if any number is NaN or infinite."""
    for array in arrays:
        if not np.isfinite(array).all():
            raise FaceRefusedError(FaceReason.NOT_FINITE, "a coordinate is not finite")


def require_weights(weights: Array) -> None:
    """Raise if a weight is not positive and finite."""
    if not (weights > 0.0).all():
        raise FaceRefusedError(FaceReason.BAD_WEIGHTS, f"weight {weights.min()} is not positive")
    require_finite(weights)


def require_knots(knots: Array, degree: int, n: int) -> None:
    """Raise unless there are n + degree + 1 non-decreasing knots over a domain that is not empty."""
    if len(knots) != n + degree + 1 or (np.diff(knots) < 0.0).any() or not knots[degree] < knots[n]:
        raise FaceRefusedError(FaceReason.BAD_KNOTS, f"{len(knots)} knots for {n} control points of degree {degree}")
