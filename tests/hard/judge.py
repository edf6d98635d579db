"""What a case's truth says of a mesh of it: every broken promise in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.tessellation.mesh import MeshBatch
from tests.hard.case import HardCase
from tests.hard.mesh_measures import MeshMeasures, inside_points, measure
from tests.hard.variants import Variant

ROUNDOFF = 64.0 * float(np.finfo(float).eps)


def judge(case: HardCase, variant: Variant, error: float, mesh: MeshBatch) -> list[str]:
    """Compare a mesh, made of the changed case with ``error * variant.scale`` mm, with the truth.

    Returns:
        One line for each thing that is not as it should be.
    """
    if not (np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all()):
        return ["not finite"]
    if not (np.diff(mesh.triangle_start) > 0).all():
        return ["lost faces"]
    found = measure(mesh, np.full(3, variant.shift))
    # A closed form of moved faces knows them before their control points were rounded.
    noise = ROUNDOFF * (abs(variant.shift) + float(np.abs(mesh.positions - variant.shift).max()))
    checks = (
        _codes(case, variant, error, mesh, noise),
        _shape(case, variant, found),
        _sizes(case, variant, error, found, noise),
    )
    return [line for check in checks for line in check] + list(_distance(case, variant, mesh, noise))


def _codes(case: HardCase, variant: Variant, error: float, mesh: MeshBatch, noise: float) -> Iterator[str]:
    for status, reason in set(zip(mesh.status.tolist(), mesh.reason.tolist(), strict=True)):
        if status not in case.statuses or (case.reasons and reason not in case.reasons):
            yield f"status {FaceStatus(status).name} {FaceReason(reason).name}"
    limit = (error + case.floor) * variant.scale + noise
    if not mesh.certified_error.max() <= limit:
        yield f"certified {mesh.certified_error.max():.6g} mm, asked for {limit:.6g}"
    length = np.linalg.norm(mesh.normals, axis=1)
    if not np.abs(length - 1.0).max() < 1e-9:
        yield "normals are not unit vectors"


def _shape(case: HardCase, variant: Variant, found: MeshMeasures) -> Iterator[str]:
    if case.euler is not None and found.euler != case.euler:
        yield f"Euler number {found.euler}, should be {case.euler}"
    if case.components is not None and found.components != case.components:
        yield f"{found.components} components, should be {case.components}"
    if case.closed and not found.closed:
        yield "not closed"
    if not found.smallest_area > 0.0:
        yield "a triangle without area"
    # Far from the origin coordinates are rounded by more than thin triangles are high.
    if case.normals_deg is not None and not variant.shift and found.normal_deviation_deg > case.normals_deg:
        yield f"vertex normals up to {found.normal_deviation_deg:.3g} degrees off their triangle's"


def _sizes(case: HardCase, variant: Variant, error: float, found: MeshMeasures, noise: float) -> Iterator[str]:
    scale = variant.scale
    # Each corner may be off by the noise: an area changes by that times the sides.
    if case.area is not None:
        slack = (12.0 * np.sqrt(case.area) if case.slack is None else case.slack) * error + 1e-12 * case.area
        if not abs(found.area - case.area * scale**2) <= slack * scale**2 + noise * found.edge_length:
            yield f"area {found.area / scale**2:.9g}, should be {case.area:.9g} within {slack:.3g}"
    if case.volume is not None and case.area is not None:
        allowed = 1.1 * case.area * (error + case.floor) * scale**3 + 2.0 * noise * found.area
        if not abs(found.volume - case.volume * scale**3) <= allowed:
            yield f"volume {found.volume / scale**3:.9g}, should be {case.volume:.9g}"
    if found.inverted_height > 4.0 * noise:
        yield f"inverted triangle, {found.inverted_height / scale:.3g} mm high"
    if case.most_triangles is not None and found.n_triangles > case.most_triangles:
        yield f"{found.n_triangles} triangles, should be at most {case.most_triangles}"


def _distance(case: HardCase, variant: Variant, mesh: MeshBatch, noise: float) -> Iterator[str]:
    if case.distance is None or variant.name == "mirrored":
        return
    away = case.distance((inside_points(mesh, 5) - variant.shift) / variant.scale).max() * variant.scale
    if not away <= mesh.certified_error.max() + noise:
        yield f"{away:.6g} mm off the exact set, certified {mesh.certified_error.max():.6g}"


def applies(case: HardCase, variant: Variant, geometry: GeometryBatch) -> bool:
    """Does the variant make sense for the case?"""
    if variant.turns_nets:
        return case.turned_nets and bool((geometry.surfaces["kind"] == 0).any())
    return case.far or not variant.shift
