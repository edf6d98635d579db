"""What may be asked of a tessellation beside its distance, as small values, and its form for the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry.curvature import mean_curvature
from nurbs_ooc.geometry.tables import Tables
from nurbs_ooc.tessellation.attributes import Attribute, attribute_tables
from nurbs_ooc.tessellation.edges import AIM
from nurbs_ooc.tessellation.shading import Aim


@dataclass(frozen=True)
class Appearance:
    """Let shading count like distance: the combined error of ``shading`` stays within the chord error.

    Attributes:
        normals: count what interpolated normals are off by.
        attribute: count what an interpolated attribute is off by: "curvature" (the mean curvature), a function of
            points of a surface, or by row a B-spline over its surface's parameters, continuous with its first
            derivatives (see ``attributes``).
        unseen_deg: degrees; normals this close to the true ones look like them.
        unseen_share: of the attribute's range over the part; values this close to the true ones look like them. Of
            functions the range is that of places inside the faces, for at borders they may be infinite.
    """

    normals: bool = True
    attribute: Attribute | Literal["curvature"] | None = None
    unseen_deg: float = 0.05
    unseen_share: float = 1.0 / 256.0

    def __post_init__(self) -> None:
        for name in ("unseen_deg", "unseen_share"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} {value}: must be finite and at least 0")
        if isinstance(self.attribute, str) and self.attribute != "curvature":
            raise UsageError(f"attribute {self.attribute!r}: curvature is the only one built in")


def kernel_aim(
    geometry: GeometryBatch, g: Tables, normal_error_deg: float | None, appearance: Appearance | None
) -> Aim | None:
    """What kernels are asked to keep; None if that is the distance alone.

    Args:
        geometry: the part.
        g: its tables.
        normal_error_deg: degrees, or None.
        appearance: or None.

    Raises:
        UsageError: the angle is not above 0 and at most 90; see ``attribute_tables``.
    """
    if normal_error_deg is not None and not 0.0 < normal_error_deg <= 90.0:
        raise UsageError(f"normal error {normal_error_deg} degrees: must be above 0 and at most 90")
    if normal_error_deg is None and appearance is None:
        return None
    attribute, count, unseen_value = g, 0, 0.0
    missed, missed_from = np.zeros(0), np.zeros(0, np.int64)
    if appearance is not None and appearance.attribute is not None:
        source = mean_curvature if isinstance(appearance.attribute, str) else appearance.attribute
        attribute, unseen_value, missed, missed_from = attribute_tables(geometry, source, appearance.unseen_share)
        count = len(geometry)
    return Aim(
        normal=math.inf if normal_error_deg is None else float(np.radians(normal_error_deg)) * AIM,
        appearance=0.0 if appearance is None else 1.0,
        shaded=1.0 if appearance is not None and appearance.normals else 0.0,
        unseen=0.0 if appearance is None else float(np.radians(appearance.unseen_deg)),
        attribute=attribute,
        n_attributes=count,
        unseen_value=unseen_value,
        missed=missed,
        missed_from=missed_from,
    )
