"""Several parts as one record: their tables one after another, every pointer moved along.

Parts share no edges, so whatever is computed of a part comes out as if it were alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch

# Columns of each table and the table that they point into.
_POINTERS = {
    "surfaces": {
        "profile": "curves",
        "first_loop": "loops",
        "source": "sources",
        "knots_u": "values",
        "knots_v": "values",
        "points": "values",
        "frame": "values",
    },
    "loops": {"first_coedge": "coedges"},
    "coedges": {"edge": "edges", "pcurve": "curves"},
    "edges": {"curve": "curves", "vertex0": "vertices", "vertex1": "vertices"},
    "curves": {"knots": "values", "points": "values"},
}


def join_parts(parts: Sequence[GeometryBatch]) -> GeometryBatch:
    """All surfaces of the first part, then those of the second, ...

    Args:
        parts: one at least; a single one is returned itself.
    """
    if len(parts) == 1:
        return parts[0]
    return GeometryBatch(
        surfaces=_joined(parts, "surfaces"),
        loops=_joined(parts, "loops"),
        coedges=_joined(parts, "coedges"),
        edges=_joined(parts, "edges"),
        curves=_joined(parts, "curves"),
        vertices=np.concatenate([part.vertices for part in parts]),
        values=np.concatenate([part.values for part in parts]),
        sources=[source for part in parts for source in part.sources],
    )


def _joined(parts: Sequence[GeometryBatch], name: str) -> npt.NDArray[np.void]:
    """A table of all parts with its pointers moved; negative ones mean none and stay, as do names that are missing."""
    tables = [getattr(part, name) for part in parts]
    lengths = [len(table) for table in tables]
    # Byte for byte: numpy leaves the gaps of structured rows undefined.
    table = np.frombuffer(bytearray(b"".join(table.tobytes() for table in tables)), tables[0].dtype)
    for column, target in _POINTERS[name].items():
        counts = np.array([len(getattr(part, target)) for part in parts], np.int64)
        shift = np.repeat(np.cumsum(counts) - counts, lengths)
        pointers = table[column].astype(np.int64)
        moved = np.where(pointers < 0, pointers, pointers + shift)
        if target == "sources":
            moved = np.where(pointers < np.repeat(counts, lengths), moved, -1)
        table[column] = moved
    return table
