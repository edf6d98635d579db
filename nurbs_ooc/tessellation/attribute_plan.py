"""How many columns and rows of triangles an attribute asks for over a cell, by samples of its second derivatives.

No promise, see ``shading_cells``: triangles are checked one by one afterwards.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_line, local_table
from nurbs_ooc.geometry.surface import surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables
from nurbs_ooc.tessellation.grid_counts import grid_counts
from nurbs_ooc.tessellation.shading import RESOLVED, Aim

Floats = npt.NDArray[np.float64]

BASIS = MAX_DEGREE + 2  # room for the basis functions of a point
# Samples of a cell each way, how far inside its border the outer ones lie, the step of differences, as shares of it.
SIDE = 4
INSET = 0.02
STEP = 0.01


@leaf
def _rate(value: Floats, place: Floats, at: int) -> float:
    change, way = 0.0, 0.0
    for k in range(at, at + 3):
        change += value[k] * value[k]
        way += place[k] * place[k]
    return math.sqrt(change / way) if way > 0.0 else 0.0


@leaf
def _change(after: Floats, before: Floats, at: int) -> float:
    size = 0.0
    for k in range(at, at + 3):
        size += (after[k] - before[k]) ** 2
    return math.sqrt(size)


@leaf
def attribute_counts(
    g: Tables, aim: Aim, row: int, box: Floats, allowed_length: float, planned: float
) -> tuple[int, int]:
    """Columns and rows over ``box`` (u0, u1, v0, v1).

    Args:
        g, aim, row: the face.
        box: of the cell.
        allowed_length: mm, what the attribute's error may be, carried into space.
        planned: the share of what is allowed that the plan counts on.
    """
    scratch = local_table(4, BASIS)
    value, place = local_line(12), local_line(12)
    before, after = local_line(12), local_line(12)
    a, b = box[1] - box[0], box[3] - box[2]
    uu, uv, vv, rates = 0.0, 0.0, 0.0, 0.0
    for i in range(SIDE):
        u = box[0] + a * (INSET + (1.0 - 2.0 * INSET) * i / (SIDE - 1.0))
        for j in range(SIDE):
            v = box[2] + b * (INSET + (1.0 - 2.0 * INSET) * j / (SIDE - 1.0))
            surface_point(g, row, u, v, scratch, place)
            surface_point(aim.attribute, row, u, v, scratch, value)
            rates += max(_rate(value, place, 3), _rate(value, place, 6))
            surface_point(aim.attribute, row, u - STEP * a, v, scratch, before)
            surface_point(aim.attribute, row, u + STEP * a, v, scratch, after)
            uu = max(uu, 0.5 * a * _change(after, before, 3) / STEP)
            uv = max(uv, 0.5 * b * _change(after, before, 6) / STEP)
            surface_point(aim.attribute, row, u, v - STEP * b, scratch, before)
            surface_point(aim.attribute, row, u, v + STEP * b, scratch, after)
            vv = max(vv, 0.5 * b * _change(after, before, 6) / STEP)
    allowed = max((1.0 - RESOLVED) * aim.unseen_value, allowed_length * rates / (SIDE * SIDE))
    if not allowed > 0.0:
        return 1, 1
    return grid_counts(uu, uv, vv, 1.0, 1.0, planned * allowed)
