"""Attributes of surfaces, by which an appearance may be judged, as B-splines over the surfaces' parameters.

An attribute is given as a B-spline itself, or as a function of points of a surface, which is then interpolated by
a cubic one on a grid that is halved while it misses the function between its nodes. Bounds are then those of the
interpolant: of a function they are an estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry import interpolation
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.surface import evaluate_partials
from nurbs_ooc.geometry.tables import Tables, tables

Floats = npt.NDArray[np.float64]
# Values (n,) or (n, 1 .. 3) of surface ``row`` at (n, 2) native parameters.
AttributeFunction = Callable[[GeometryBatch, int, Floats], Floats]
Attribute = AttributeFunction | Mapping[int, SurfaceForm]

GRIDS = (9, 17, 33)  # nodes each way, the fewest that do
MISSED = 1e-2  # of an attribute's range on its surface, between nodes
INSET = 1e-4  # of the domain: functions are not asked for at its border itself, where poles are
CONSTANT = 1e-2
STEP = 1e-5  # of the domain: differences of normals


def mean_curvature(geometry: GeometryBatch, row: int, uv: Floats) -> Floats:
    """(n,) mean curvature, 1/mm, positive where the outside is the hollow side; 0 where there is no normal.

    Source: M. P. do Carmo, "Differential Geometry of Curves and Surfaces", 1976, section 3-3, with derivatives of
    the normal by central differences.
    """
    s = geometry.surfaces[row]
    step = STEP * np.array([float(s["u1"] - s["u0"]), float(s["v1"] - s["v0"])])
    _, _, d = evaluate_partials(geometry, row, uv)
    n_u, n_v = (
        (evaluate_partials(geometry, row, uv + h)[1] - evaluate_partials(geometry, row, uv - h)[1]) / (2.0 * h.sum())
        for h in (step * [1, 0], step * [0, 1])
    )
    s_u, s_v = d[:, 0], d[:, 1]
    e, f, g = ((a * b).sum(axis=1) for a, b in ((s_u, s_u), (s_u, s_v), (s_v, s_v)))
    low, mixed, high = (-(a * b).sum(axis=1) for a, b in ((n_u, s_u), (n_u, s_v), (n_v, s_v)))
    area = e * g - f * f
    with np.errstate(all="ignore"):
        value = (low * g - 2.0 * mixed * f + high * e) / (2.0 * area)
    return np.where(np.isfinite(value) & (area > 1e-12 * e * g), value, 0.0)


def attribute_tables(geometry: GeometryBatch, attribute: Attribute) -> tuple[Tables, float]:
    """Tables whose surface i holds the attribute of the part's surface i, 0 where none is given; its range.

    A range of less than CONSTANT of its largest value is noise of a constant, and counts as that much.

    Raises:
        UsageError: values that are not finite or of another shape, a B-spline that does not cover its surface.
    """
    builder = BatchBuilder()
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    largest = 0.0
    for row in range(len(geometry)):
        form = _form_of(geometry, row, attribute)
        builder.surface(form)
        values = form.points[..., :3] / form.points[..., 3:] if form.rational else form.points
        largest = max(largest, float(np.abs(values).max()))
        low, high = np.minimum(low, values.min(axis=(0, 1))), np.maximum(high, values.max(axis=(0, 1)))
    spread = float(np.linalg.norm(high - low)) if len(geometry) else 0.0
    return tables(builder.build()), max(spread, CONSTANT * largest)


def _form_of(geometry: GeometryBatch, row: int, attribute: Attribute) -> SurfaceForm:
    s = geometry.surfaces[row]
    box = (float(s["u0"]), float(s["u1"]), float(s["v0"]), float(s["v1"]))
    if callable(attribute):
        if s["status"] == FaceStatus.FAILED:
            return _constant(box)
        return _interpolated(geometry, row, attribute, box)
    form = attribute.get(row)
    if form is None:
        return _constant(box)
    hair = 1e-9 * np.array([box[1] - box[0], box[3] - box[2]])
    covers = form.u0 <= box[0] + hair[0] and form.u1 >= box[1] - hair[0]
    covers = covers and form.v0 <= box[2] + hair[1] and form.v1 >= box[3] - hair[1]
    if form.kind != SurfaceKind.NURBS or not covers or not np.isfinite(form.points).all():
        raise UsageError(f"attribute of surface {row}: must be a finite B-spline over ({box[0]:g}, {box[1]:g}) x "
                         f"({box[2]:g}, {box[3]:g})")  # fmt: skip
    return form


def _constant(box: tuple[float, ...]) -> SurfaceForm:
    u0, u1, v0, v1 = box
    return SurfaceForm.nurbs(1, 1, [u0, u0, u1, u1], [v0, v0, v1, v1], np.zeros((2, 2, 3)))


def _asked(geometry: GeometryBatch, row: int, function: AttributeFunction, uv: Floats) -> Floats:
    """(n, 3) values; those of fewer components are filled up with 0."""
    values = np.asarray(function(geometry, row, uv), float).reshape(len(uv), -1)
    if values.shape[1] > 3 or not np.isfinite(values).all():
        raise UsageError(f"attribute of surface {row}: a function must give up to 3 finite numbers a point")
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


def _interpolated(
    geometry: GeometryBatch, row: int, function: AttributeFunction, box: tuple[float, ...]
) -> SurfaceForm:
    low, size = np.array([box[0], box[2]]), np.array([box[1] - box[0], box[3] - box[2]])

    def at(u: Floats, v: Floats) -> Floats:
        share = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        uv = low + np.clip(share, INSET, 1.0 - INSET) * size
        return _asked(geometry, row, function, uv).reshape(len(u), len(v), 3)

    for n in GRIDS:
        nodes = interpolation.nodes(n)
        inverse = interpolation.inverse(n)
        values = at(nodes, nodes)
        net = np.einsum("ij,jkc,lk->ilc", inverse, values, inverse)
        knots = interpolation.knots(n)
        form = SurfaceForm.nurbs(3, 3, box[0] + size[0] * knots, box[2] + size[1] * knots, net)
        between = 0.5 * (nodes[1:] + nodes[:-1])
        basis = np.array([interpolation.basis(n, float(t)) for t in between])
        missed = np.abs(np.einsum("ij,jkc,lk->ilc", basis, net, basis) - at(between, between)).max()
        if missed <= MISSED * max(float(np.ptp(values)), 1e-300):
            break
    return form
