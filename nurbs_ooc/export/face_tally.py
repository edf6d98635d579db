"""Counts of faces by status, and the list of those that are not exact: part of every report."""

from __future__ import annotations

from typing import Any

import numpy as np

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.tessellation.mesh import NOT_ASKED, MeshBatch


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


class FaceTally:
    """Collects the statuses of faces, each counted once however often its part is placed.

    Attributes:
        listed: one entry per face that is not exact: id, source in the file, status, coded reason, and its
            certified error in mm (None where it has none), with those of its normals and its appearance if they were
            asked for.
        certified_error: mm, largest of all faces that have one.
        certified_normal_error: degrees, likewise; None if no normals were asked for.
        appearance_error: mm, of distance and shading together, all terms of distance included; None likewise.
    """

    def __init__(self) -> None:
        self._counts = dict.fromkeys(FaceStatus, 0)
        self.listed: list[dict[str, Any]] = []
        self.certified_error = 0.0
        self.certified_normal_error: float | None = None
        self.appearance_error: float | None = None

    def add(self, geometry: GeometryBatch, mesh: MeshBatch, first_surface: int, stretch: float = 1.0) -> None:
        """Count the faces of one part.

        Args:
            geometry: where ``mesh`` comes from.
            mesh: status, reason and errors of its faces.
            first_surface: id of row 0 of ``geometry``.
            stretch: largest factor by which a placement lengthens the part's errors.
        """
        errors = mesh.certified_error * stretch
        finite = np.isfinite(errors)
        self.certified_error = max(self.certified_error, float(errors[finite].max(initial=0.0)))
        if len(mesh.normal_error):
            self.certified_normal_error = max(self.certified_normal_error or 0.0, float(mesh.normal_error.max()))
        together = NOT_ASKED
        if len(mesh.appearance_error):
            together = (mesh.appearance_error + mesh.trim_error + mesh.pcurve_error) * stretch
            known = together[np.isfinite(together)]
            self.appearance_error = max(self.appearance_error or 0.0, float(known.max(initial=0.0)))
        for status in FaceStatus:
            self._counts[status] += int((mesh.status == status).sum())
        for i in np.flatnonzero(mesh.status != FaceStatus.EXACT).tolist():
            row = int(mesh.faces[i])
            self.listed.append(
                {
                    "surface": first_surface + row,
                    "source": geometry.sources[int(geometry.surfaces["source"][row])],
                    "status": FaceStatus(mesh.status[i]).name.lower(),
                    "reason": FaceReason(mesh.reason[i]).name.lower(),
                    "certified_error_mm": _number(errors[i]),
                }
                | ({"certified_normal_error_deg": float(mesh.normal_error[i])} if len(mesh.normal_error) else {})
                | ({"appearance_error_mm": _number(together[i])} if len(mesh.appearance_error) else {})
            )

    @property
    def counts(self) -> dict[str, int]:
        """``faces`` of a report: read, exact, healed, degraded, failed."""
        return {"read": sum(self._counts.values()), **{s.name.lower(): n for s, n in self._counts.items()}}
