"""What may be asked of a tessellation beside its distance, as small values, and its form for the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nurbs_cache.errors import UsageError
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.edges import AIM
from nurbs_ooc.tessellation.shading import Aim


@dataclass(frozen=True)
class Appearance:
    """Let shading count like distance: the combined error of ``shading`` stays within the chord error.

    Attributes:
        normals: count what interpolated normals are off by.
        unseen_deg: degrees; normals this close to the true ones look like them.
    """

    normals: bool = True
    unseen_deg: float = 0.05

    def __post_init__(self) -> None:
        if not (math.isfinite(self.unseen_deg) and self.unseen_deg >= 0.0):
            raise UsageError(f"unseen_deg {self.unseen_deg}: must be finite and at least 0")


def kernel_aim(g: Tables, normal_error_deg: float | None, appearance: Appearance | None) -> Aim | None:
    """What kernels are asked to keep; None if that is the distance alone.

    Args:
        g: tables of the part.
        normal_error_deg: degrees, or None.
        appearance: or None.

    Raises:
        UsageError: the angle is not above 0 and at most 90.
    """
    if normal_error_deg is not None and not 0.0 < normal_error_deg <= 90.0:
        raise UsageError(f"normal error {normal_error_deg} degrees: must be above 0 and at most 90")
    if normal_error_deg is None and appearance is None:
        return None
    return Aim(
        normal=math.inf if normal_error_deg is None else float(np.radians(normal_error_deg)) * AIM,
        appearance=0.0 if appearance is None else 1.0,
        shaded=1.0 if appearance is not None and appearance.normals else 0.0,
        unseen=0.0 if appearance is None else float(np.radians(appearance.unseen_deg)),
        attribute=g,
        n_attributes=0,
        unseen_value=0.0,
    )
