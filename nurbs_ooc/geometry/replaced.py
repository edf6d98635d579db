"""A part in which one surface has been replaced by another.

The new surface comes as a batch of its own. Its tables are appended to the part's, its row takes the old one's place,
and what no surface uses any more is left out::

    part   s0 s1 s2      one   s          s0 s  s2
           |  |  |             |    --->  |  |  |       an edge of ``one`` that is an edge of the part, number for
           e0 e1 e2            e1'        e0 e1 e2      number, is that edge: where the border has not changed, the
                                                        surfaces beside it still meet it vertex for vertex
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.builder import EDGE_ID_PART_SHIFT
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
    joined = _joined(geometry, one, _numbered(geometry, one, part))
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


def _joined(geometry: GeometryBatch, one: GeometryBatch, edges: npt.NDArray[np.void]) -> GeometryBatch:
    """Both batches' tables one after another; edges with the id of one of ``geometry`` are that one."""
    known = {int(number): row for row, number in enumerate(geometry.edges["id"].tolist())}
    edge_rows = np.array([known.get(int(n), len(geometry.edges) + i) for i, n in enumerate(edges["id"].tolist())], int)
    surfaces, loops, coedges, curves = (table.copy() for table in (one.surfaces, one.loops, one.coedges, one.curves))
    framed = surfaces["kind"] != SurfaceKind.NURBS
    for name in ("knots_u", "knots_v", "points"):
        surfaces[name] = np.where(framed, surfaces[name], surfaces[name] + len(geometry.values))
    surfaces["frame"] = np.where(framed, surfaces["frame"] + len(geometry.values), surfaces["frame"])
    surfaces["first_loop"] += len(geometry.loops)
    loops["first_coedge"] += len(geometry.coedges)
    coedges["edge"] = edge_rows[coedges["edge"]]
    curves["knots"] += len(geometry.values)
    curves["points"] += len(geometry.values)
    for table, name in ((surfaces, "profile"), (coedges, "pcurve"), (edges, "curve")):
        table[name] = np.where(table[name] < 0, table[name], table[name] + len(geometry.curves))
    for name in ("vertex0", "vertex1"):
        edges[name] += len(geometry.vertices)
    return GeometryBatch(
        np.concatenate([geometry.surfaces, surfaces]),
        np.concatenate([geometry.loops, loops]),
        np.concatenate([geometry.coedges, coedges]),
        np.concatenate([geometry.edges, edges]),
        np.concatenate([geometry.curves, curves]),
        np.concatenate([geometry.vertices, one.vertices]),
        np.concatenate([geometry.values, one.values]),
        geometry.sources,
    )
