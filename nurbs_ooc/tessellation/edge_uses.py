"""Which faces look at an edge: the tables of a part turned round."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_ooc.geometry.tables import Tables

Ints = npt.NDArray[np.int64]


class EdgeUses(NamedTuple):
    """Which coedges run along an edge, and which surface a coedge bounds."""

    first: Ints  # (n_edges + 1,)
    coedge: Ints  # (n_coedges,) sorted by edge
    surface: Ints  # (n_coedges,) by coedge; -1 for those of no surface


def edge_uses(g: Tables) -> EdgeUses:
    """Invert coedge -> edge; loops and coedges are stored in the order of their surfaces."""
    n_edges = len(g.edges)
    loop_of = np.repeat(np.arange(len(g.loops)), g.loops["n_coedges"])
    surface_of_loop = np.repeat(np.arange(len(g.surfaces)), g.surfaces["n_loops"])
    surface = np.full(len(g.coedges), -1, np.int64)
    rows = _ranges(g.loops["first_coedge"], g.loops["n_coedges"])
    loops = _ranges(g.surfaces["first_loop"], g.surfaces["n_loops"])
    owner = np.full(len(g.loops), -1, np.int64)
    owner[loops] = surface_of_loop
    surface[rows] = owner[loop_of]
    edge = g.coedges["edge"].astype(np.int64)
    order = np.argsort(edge, kind="stable").astype(np.int64)
    first = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=n_edges))]).astype(np.int64)
    return EdgeUses(first, order, surface)


def _ranges(first: npt.NDArray[np.int32], count: npt.NDArray[np.int32]) -> Ints:
    """first[i], first[i] + 1, ..., first[i] + count[i] - 1 for all i, in one array."""
    count = count.astype(np.int64)
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(first.astype(np.int64) - (ends - count), count)


def uses_of_faces(uses: EdgeUses, faces: npt.NDArray[np.bool_]) -> EdgeUses:
    """The uses by the faces in the mask (n_surfaces,) alone: to the others no coedge belongs."""
    kept = np.append(faces, False)[uses.surface]
    by_edge = kept[uses.coedge]
    before = np.concatenate([[0], np.cumsum(by_edge)]).astype(np.int64)
    return EdgeUses(before[uses.first], uses.coedge[by_edge], np.where(kept, uses.surface, -1))


def with_neighbours(g: Tables, uses: EdgeUses, faces: Ints) -> Ints:
    """The faces and all that share an edge with one of them, ascending; unchanged if they are all of the part."""
    if len(faces) == len(g.surfaces):
        return faces
    inside = np.zeros(len(g.surfaces) + 1, bool)  # the last for coedges of no surface
    inside[faces] = True
    touched = np.zeros(len(g.edges), bool)
    touched[g.coedges["edge"][inside[uses.surface]]] = True
    inside[uses.surface[touched[g.coedges["edge"]]]] = True
    return np.flatnonzero(inside[:-1])


def faces_of_edges(g: Tables, uses: EdgeUses, edges: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask (n_surfaces,) of the faces that use any of the edges in the mask ``edges`` (n_edges,)."""
    hit = np.zeros(len(g.surfaces) + 1, bool)  # the last for coedges of no surface
    hit[uses.surface[edges[g.coedges["edge"]]]] = True
    return hit[:-1]
