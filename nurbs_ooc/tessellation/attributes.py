"""Attributes of surfaces, by which an appearance may be judged, as B-splines over the surfaces' parameters.

An attribute is given as a B-spline itself, or as a function of points of a surface, which is then interpolated by
a cubic one that is made finer until it misses the function by less than anybody sees (see ``attribute_fit``). What it
still misses is measured, not proven, and counts as part of the error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import FaceStatus, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.curvature import Knots, inner_knots
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.tessellation.attribute_fit import fit

Floats = npt.NDArray[np.float64]
# Values (n,) or (n, 1 .. 3) of surface ``row`` at (n, 2) native parameters.
AttributeFunction = Callable[[GeometryBatch, int, Floats], Floats]
Attribute = AttributeFunction | Mapping[int, SurfaceForm]

# Of what nobody sees, the part that may be missed.
GOOD = 0.125
ROUNDOFF = 1e-10  # of the range: values so close are the same
CONSTANT = 1e-2
SMOOTH = 3  # times: a surface that is as often differentiable has a curvature without kinks
# Where functions are asked for their range: away from borders, where they may be infinite.
SAMPLES = np.linspace(0.0, 1.0, 20)[1:-1]


class AttributeTables(NamedTuple):
    """Attributes for the kernels.

    Attributes:
        tables: surface i holds the attribute of the part's surface i, 0 where none is given.
        unseen: what values may differ by unseen, in the attribute's unit.
        missed: by knot span, v fastest, surface after surface: what B-splines may be off by.
        missed_from: (n,) where those of a surface begin, -1 if it was given as a B-spline.
    """

    tables: Tables
    unseen: float
    missed: Floats
    missed_from: npt.NDArray[np.int64]


def attribute_tables(geometry: GeometryBatch, attribute: Attribute, share: float) -> AttributeTables:
    """What kernels know of an attribute.

    Args:
        geometry: the part.
        attribute: one B-spline a surface, or a function.
        share: of the attribute's range over the part; values that are closer look the same. A range of less than
            CONSTANT of its largest value is noise of a constant, and counts as that much.

    Raises:
        UsageError: values that are not finite or of another shape, a B-spline that is torn or does not cover its
            surface.
    """
    rows = range(len(geometry))
    unseen = max(share, ROUNDOFF) * _spread([_range_of(geometry, row, attribute) for row in rows])
    builder = BatchBuilder()
    missed: list[Floats] = [np.zeros(0)]
    begins = np.full(len(geometry), -1)
    at = 0
    for row in rows:
        if callable(attribute) and geometry.surfaces["status"][row] != FaceStatus.FAILED:
            form, off = _interpolated(geometry, row, attribute, GOOD * unseen)
            missed.append(off.reshape(-1))
            begins[row], at = at, at + off.size
        else:
            form = _form_of(geometry, row, attribute)
        builder.surface(form)
    return AttributeTables(tables(builder.build()), unseen, np.concatenate(missed), begins)


def _spread(values: list[Floats]) -> float:
    """Diagonal of the box of all rows (n, 3), at least CONSTANT of the largest number."""
    every = np.concatenate([*values, np.zeros((0, 3))])
    if not len(every):
        return 0.0
    return max(float(np.linalg.norm(np.ptp(every, axis=0))), CONSTANT * float(np.abs(every).max()))


def _range_of(geometry: GeometryBatch, row: int, attribute: Attribute) -> Floats:
    """(2, 3) least and largest values over a surface, (0, 3) of none: by control points or by samples."""
    if callable(attribute):
        if geometry.surfaces["status"][row] == FaceStatus.FAILED:
            return np.zeros((0, 3))
        points = _sampled(geometry, row, attribute, SAMPLES, SAMPLES)
    else:
        form = _form_of(geometry, row, attribute)
        points = form.points[..., :3] / form.points[..., 3:] if form.rational else form.points
    return np.stack([points.min(axis=(0, 1)), points.max(axis=(0, 1))])


def _box(geometry: GeometryBatch, row: int) -> tuple[float, float, float, float]:
    s = geometry.surfaces[row]
    return float(s["u0"]), float(s["u1"]), float(s["v0"]), float(s["v1"])


def _form_of(geometry: GeometryBatch, row: int, attribute: Attribute) -> SurfaceForm:
    """The B-spline that is given, a constant where there is none."""
    box = _box(geometry, row)
    form = None if callable(attribute) else attribute.get(row)
    if form is None:
        return _constant(box)
    hair = 1e-9 * np.array([box[1] - box[0], box[3] - box[2]])
    covers = form.u0 <= box[0] + hair[0] and form.u1 >= box[1] - hair[0]
    covers = covers and form.v0 <= box[2] + hair[1] and form.v1 >= box[3] - hair[1]
    covers = covers and not (_is_torn(form.knots_u, form.degree_u) or _is_torn(form.knots_v, form.degree_v))
    if form.kind != SurfaceKind.NURBS or not covers or not np.isfinite(form.points).all():
        where = f"({box[0]:g}, {box[1]:g}) x ({box[2]:g}, {box[3]:g})"
        raise UsageError(f"attribute of surface {row}: must be a finite, continuous B-spline over {where}")
    return form


def _is_torn(knots: Floats, degree: int) -> bool:
    """Whether an inner knot makes the B-spline two."""
    inner = np.asarray(knots)[degree + 1 : -degree - 1]
    return len(inner) > 0 and int(np.unique(inner, return_counts=True)[1].max()) > degree


def _constant(box: tuple[float, ...]) -> SurfaceForm:
    u0, u1, v0, v1 = box
    return SurfaceForm.nurbs(1, 1, [u0, u0, u1, u1], [v0, v0, v1, v1], np.zeros((2, 2, 3)))


def _asked(geometry: GeometryBatch, row: int, function: AttributeFunction, uv: Floats) -> Floats:
    """(n, 3) values; those of fewer components are filled up with 0."""
    values = np.asarray(function(geometry, row, uv), float).reshape(len(uv), -1)
    if values.shape[1] > 3 or not np.isfinite(values).all():
        raise UsageError(f"attribute of surface {row}: a function must give up to 3 finite numbers a point")
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


def _sampled(geometry: GeometryBatch, row: int, function: AttributeFunction, u: Floats, v: Floats) -> Floats:
    """(n_u, n_v, 3) values on a grid, ``u`` and ``v`` as shares of the domain."""
    u0, u1, v0, v1 = _box(geometry, row)
    at_u, at_v = np.meshgrid(u0 + (u1 - u0) * u, v0 + (v1 - v0) * v, indexing="ij")
    uv = np.stack([at_u.reshape(-1), at_v.reshape(-1)], axis=1)
    return _asked(geometry, row, function, uv).reshape(len(u), len(v), 3)


def _kinks(knots: Knots, low: float, high: float) -> frozenset[float]:
    """Shares of [low, high] at which second derivatives of the surface, so curvatures, may have kinks."""
    rough = knots.values[knots.degree - knots.times < SMOOTH]
    return frozenset(((rough - low) / (high - low)).tolist())


def _interpolated(
    geometry: GeometryBatch, row: int, function: AttributeFunction, tolerance: float
) -> tuple[SurfaceForm, Floats]:
    """A cubic B-spline, and what it may be off by in its knot spans."""
    u0, u1, v0, v1 = _box(geometry, row)
    knots_u, knots_v = inner_knots(geometry, row)
    fitted = fit(
        lambda u, v: _sampled(geometry, row, function, u, v),
        _kinks(knots_u, u0, u1), _kinks(knots_v, v0, v1), tolerance,
    )  # fmt: skip
    along_u, along_v = u0 + (u1 - u0) * fitted.knots_u, v0 + (v1 - v0) * fitted.knots_v
    return SurfaceForm.nurbs(3, 3, along_u, along_v, fitted.net), fitted.missed
