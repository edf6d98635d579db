"""Input that is no surface at all, or hardly one: it must be refused or healed, with a code, and never crash."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DegenerateCase:
    """One bad face and the codes that are right for it.

    Attributes:
        name: unique.
        geometry: makes the part.
        reasons: the codes of which one must be given, unless the part is refused whole.
        flat: the face has a sensible (if empty) point set, and a mesh of it must keep its bound.
    """

    name: str
    geometry: Callable[[], GeometryBatch]
    reasons: tuple[FaceReason, ...]
    flat: bool = False


def _good() -> SurfaceForm:
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    points = np.stack([x, y, 0.2 * np.sin(3 * x) * y], axis=2)
    knots_u, knots_v = np.array([0, 0, 0, 0, 0.5, 1, 1, 1, 1.0]), np.array([0, 0, 0, 0, 1, 1, 1, 1.0])
    return SurfaceForm.nurbs(3, 3, knots_u, knots_v, points, 1.0 + 0.1 * x)


def _with_boundary_of_good(form: SurfaceForm) -> GeometryBatch:
    """The broken surface with the boundary that the sound one has."""
    builder = BatchBuilder()
    builder.surface(form)
    builder.loop(natural_loop(builder, _good()))
    return builder.build()


def _point_at(i: int, j: int, column: int, value: float) -> GeometryBatch:
    form = _good()
    points = form.points.copy()
    if column == 3:
        points[i, j, :3] *= value / points[i, j, 3]
    points[i, j, column] = value
    return _with_boundary_of_good(replace(form, points=points))


def _knot_at(i: int, value: float) -> GeometryBatch:
    form = _good()
    knots = form.knots_u.copy()
    knots[i] = value
    return _with_boundary_of_good(replace(form, knots_u=knots))


def _squeezed(axes: tuple[float, float, float]) -> GeometryBatch:
    """The sound surface with its coordinates multiplied: flat, a line, or a point."""
    form = _good()
    points = form.points.copy()
    points[..., :3] *= np.array(axes)
    squeezed = replace(form, points=points)
    builder = BatchBuilder()
    builder.surface(squeezed)
    builder.loop(natural_loop(builder, squeezed))
    return builder.build()


def _bad_frame(value: float) -> GeometryBatch:
    from nurbs_ooc.geometry.sample_faces import add_sphere

    builder = BatchBuilder()
    add_sphere(builder)
    batch = builder.build()
    batch.values[int(batch.surfaces[0]["frame"]) + 12] = value
    return batch


def _bad_edge() -> GeometryBatch:
    batch = _with_boundary_of_good(_good())
    batch.values[int(batch.curves[int(batch.edges[0]["curve"])]["points"])] = np.nan
    return batch


def _bad_vertex() -> GeometryBatch:
    batch = _with_boundary_of_good(_good())
    batch.vertices[0, 1] = np.inf
    return batch


def degenerate_cases() -> list[DegenerateCase]:
    """All of them."""
    not_finite = (FaceReason.NOT_FINITE,)
    bad_weights = (FaceReason.BAD_WEIGHTS, FaceReason.WEIGHTS_NORMALISED)
    bad_knots = (FaceReason.BAD_KNOTS, FaceReason.KNOTS_REPAIRED)
    empty = (FaceReason.ZERO_AREA, FaceReason.BOX_AS_POINTS, FaceReason.NO_TRIANGLES)
    return [
        DegenerateCase("nan_in_a_control_point", partial(_point_at, 1, 1, 2, np.nan), not_finite),
        DegenerateCase("nan_in_a_corner", partial(_point_at, 0, 0, 0, np.nan), not_finite),
        DegenerateCase("infinite_control_point", partial(_point_at, 2, 1, 2, np.inf), not_finite),
        DegenerateCase("nan_weight", partial(_point_at, 1, 2, 3, np.nan), (*not_finite, *bad_weights)),
        DegenerateCase("negative_weight", partial(_point_at, 1, 1, 3, -0.7), bad_weights),
        DegenerateCase("zero_weight_inside", partial(_point_at, 1, 1, 3, 0.0), bad_weights),
        DegenerateCase("zero_weight_in_a_corner", partial(_point_at, 0, 0, 3, 0.0), bad_weights),
        DegenerateCase("decreasing_knots", partial(_knot_at, 4, -0.3), bad_knots),
        DegenerateCase("nan_knot", partial(_knot_at, 4, np.nan), (*not_finite, *bad_knots)),
        DegenerateCase("nan_radius", partial(_bad_frame, np.nan), not_finite),
        DegenerateCase("infinite_radius", partial(_bad_frame, np.inf), not_finite),
        DegenerateCase("nan_in_an_edge", _bad_edge, not_finite),
        DegenerateCase("infinite_vertex", _bad_vertex, not_finite),
        DegenerateCase("squeezed_to_a_line", partial(_squeezed, (1.0, 0.0, 0.0)), empty, flat=True),
        DegenerateCase("squeezed_to_a_point", partial(_squeezed, (0.0, 0.0, 0.0)), empty, flat=True),
    ]
