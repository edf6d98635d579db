"""A part in which one surface has been replaced by another.

The new surface comes as a batch of its own. Its tables are appended to the part's, its row takes the old one's place,
and what no surface uses any more is left out::

    part   s0 s1 s2      one   s          s0 s  s2
           |  |  |             |    --->  |  |  |       an edge of ``one`` that is an edge of the part, number for
           e0 e1 e2            e1'        e0 e1 e2      number, is that edge: where the border has not changed, the
                                                        surfaces beside it still meet it vertex for vertex
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import CurveKind, GeometryBatch
from nurbs_ooc.geometry.builder import EDGE_ID_PART_SHIFT
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.geometry.subset import CONIC_POINTS, subset


def with_surface(geometry: GeometryBatch, row: int, one: GeometryBatch, part: int) -> GeometryBatch:
    """The part with another surface in ``row``.

    Args:
        geometry: the part.
        row: of the surface that goes; material and source name stay.
        one: the surface that comes, alone. Its edges keep ids that are of this part unless another edge has
            them; the others get new ones.
        part: the part's number, for those ids.

    Raises:
        UsageError: ``one`` has not exactly one surface, or there is no such row.
    """
    if len(one) != 1:
        raise UsageError(f"replacing a surface: {len(one)} surfaces are given, want one")
    if not 0 <= row < len(geometry):
        raise UsageError(f"surface row {row} is outside 0..{len(geometry) - 1}")
    edges = _numbered(geometry, one, part)
    joined = join_parts([geometry, dataclasses.replace(one, edges=edges)])
    # an edge that both have is the part's
    known = {number: place for place, number in enumerate(geometry.edges["id"].tolist())}
    rows_of_edges = [
        known.get(number, len(geometry.edges) + place) for place, number in enumerate(edges["id"].tolist())
    ]
    own = joined.coedges[len(geometry.coedges) :]
    own["edge"] = np.array(rows_of_edges, np.int64)[one.coedges["edge"]]
    for name in ("material", "source"):
        joined.surfaces[name][-1] = geometry.surfaces[name][row]
    rows = np.arange(len(geometry))
    rows[row] = len(geometry)
    return subset(joined, rows)


def _numbered(geometry: GeometryBatch, one: GeometryBatch, part: int) -> npt.NDArray[np.void]:
    """The edges of ``one`` with their ids in the part."""
    edges = one.edges.copy()
    known = {int(number): row for row, number in enumerate(geometry.edges["id"].tolist())}
    own = [number for number in edges["id"].tolist() if number >> EDGE_ID_PART_SHIFT == part]
    following = max([*known, *own, (part << EDGE_ID_PART_SHIFT) - 1]) + 1
    for row, edge in enumerate(edges):
        number, content = int(edge["id"]), _edge_content(one, row)
        if number in known:
            stays = content is not None and content == _edge_content(geometry, known[number])
        else:
            stays = number in own
        if not stays:
            edge["id"] = following
            following += 1
    return edges


def _edge_content(geometry: GeometryBatch, row: int) -> bytes | None:
    """All that an edge is in space; None for one without a curve there, which no other surface can share."""
    edge = geometry.edges[row]
    if edge["curve"] < 0:
        return None
    curve = geometry.curves[edge["curve"]]
    n_points = int(curve["dim"]) * CONIC_POINTS
    pieces = [np.array([edge["t0"], edge["t1"], edge["tolerance"], curve["t0"], curve["t1"]])]
    if curve["kind"] == CurveKind.NURBS:
        n_points = int(curve["n"]) * (int(curve["dim"]) + int(curve["rational"]))
        pieces.append(geometry.values[curve["knots"] : curve["knots"] + curve["n"] + curve["degree"] + 1])
    pieces.append(geometry.values[curve["points"] : curve["points"] + n_points])
    pieces += [geometry.vertices[edge["vertex0"]], geometry.vertices[edge["vertex1"]]]
    kind = ["kind", "dim", "rational", "degree", "n"]
    return repr([int(curve[name]) for name in kind]).encode() + b"".join(piece.tobytes() for piece in pieces)
