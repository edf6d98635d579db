"""One hard case: faces that are known in closed form, and what must be true of any mesh of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder

Array = npt.NDArray[np.float64]

ERRORS = (0.1, 1e-2, 1e-3)  # mm; the cases are a few millimetres large
EXACT_OR_HEALED = (FaceStatus.EXACT, FaceStatus.HEALED)


@dataclass(frozen=True, eq=False)
class HardCase:
    """Faces with their truth; what is None is not known or not asked.

    Attributes:
        name: unique, also the test's id.
        add: appends the faces to a builder.
        area: mm², of all faces together.
        volume: mm³ that the faces enclose, outside normals outwards.
        euler: vertices - edges + triangles after welding equal positions.
        components: connected sets of triangles after welding.
        closed: every edge belongs to two triangles.
        distance: (n, 3) points to (n,) distance from the exact set (or a lower bound of it), mm; in the
            case's own coordinates.
        statuses: what is allowed for each face.
        reasons: what is allowed for each face.
        floor: mm; the gap that the file itself leaves: certified may exceed the request by this much.
        slack: mm per mm of error: |area - truth| may be ``slack * error``; left out: 12 sqrt(area).
        most_triangles: at the finest of ``errors``.
        errors: chord errors to try, mm, coarse to fine.
        turned_nets: the variants that reverse and transpose control nets make sense.
        far: the variants 1e6 and 1e9 mm from the origin make sense at these errors.
        normals_deg: degrees; most that a vertex normal may differ from the flat normal of its triangle.
    """

    name: str
    add: Callable[[BatchBuilder], object]
    area: float | None = None
    volume: float | None = None
    euler: int | None = None
    components: int | None = None
    closed: bool = False
    distance: Callable[[Array], Array] | None = None
    statuses: tuple[FaceStatus, ...] = (FaceStatus.EXACT,)
    reasons: tuple[FaceReason, ...] = (FaceReason.NONE,)
    floor: float = 0.0
    slack: float | None = None
    most_triangles: int | None = None
    errors: tuple[float, ...] = ERRORS
    turned_nets: bool = True
    far: bool = True
    normals_deg: float | None = None

    def geometry(self) -> GeometryBatch:
        """The faces as a part of their own."""
        builder = BatchBuilder()
        self.add(builder)
        return builder.build()
