"""Several parts as one record: their tables one after another, every pointer moved along.

Parts share no edges, so whatever is computed of a part comes out as if it were alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch

# Columns of each table, the table that they point into, and whether negative numbers mean none.
_POINTERS = {
    "surfaces": [
        ("profile", "curves"),
        ("first_loop", "loops"),
        ("source", "sources"),
        ("knots_u", "values"),
        ("knots_v", "values"),
        ("points", "values"),
        ("frame", "values"),
    ],
    "loops": [("first_coedge", "coedges")],
    "coedges": [("edge", "edges"), ("pcurve", "curves")],
    "edges": [("curve", "curves"), ("vertex0", "vertices"), ("vertex1", "vertices")],
    "curves": [("knots", "values"), ("points", "values")],
}


def join_parts(parts: Sequence[GeometryBatch]) -> GeometryBatch:
    """All surfaces of the first part, then those of the second, ...

    Args:
        parts: one at least; a single one is returned itself.
    """
    if len(parts) == 1:
        return parts[0]
    starts = {
        name: [0, *itertools.accumulate(len(getattr(part, name)) for part in parts)]
        for name in (*_POINTERS, "vertices", "values", "sources")
    }
    return GeometryBatch(
        *(_joined_table(parts, name, starts) for name in _POINTERS),
        vertices=np.concatenate([part.vertices for part in parts]),
        values=np.concatenate([part.values for part in parts]),
        sources=[source for part in parts for source in part.sources],
    )


def _joined_table(parts: Sequence[GeometryBatch], name: str, starts: dict[str, list[int]]) -> npt.NDArray[np.void]:
    """A table of all parts with its pointers moved; negative ones mean none and stay."""
    table = np.concatenate([getattr(part, name) for part in parts])
    lengths = [len(getattr(part, name)) for part in parts]
    for column, target in _POINTERS[name]:
        pointers = table[column]
        shift = np.repeat(np.array(starts[target][:-1], np.int64), lengths)
        table[column] = np.where(pointers < 0, pointers, pointers + shift)
    return table
