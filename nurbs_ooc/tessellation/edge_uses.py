"""Which faces look at an edge: the tables of a part turned round."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import kernel
from nurbs_ooc.geometry.tables import Tables

Ints = npt.NDArray[np.int64]


class EdgeUses(NamedTuple):
    """Which coedges run along an edge, and which surface a coedge bounds."""

    first: Ints  # (n_edges + 1,)
    coedge: Ints  # (n_coedges,) sorted by edge
    surface: Ints  # (n_coedges,) by coedge; -1 for those of no surface


@kernel
def _invert(g: Tables, uses: EdgeUses) -> None:
    for c in range(len(g.coedges)):
        uses.surface[c] = -1
    for row in range(len(g.surfaces)):
        s = g.surfaces[row]
        for m in range(s.first_loop, s.first_loop + s.n_loops):
            for c in range(g.loops[m].first_coedge, g.loops[m].first_coedge + g.loops[m].n_coedges):
                uses.surface[c] = row
    # Count, add up, fill from behind.
    for e in range(len(uses.first)):
        uses.first[e] = 0
    for c in range(len(g.coedges)):
        uses.first[g.coedges[c].edge] += 1
    total = 0
    for e in range(len(uses.first)):
        total += uses.first[e]
        uses.first[e] = total
    for c in range(len(g.coedges) - 1, -1, -1):
        e = g.coedges[c].edge
        uses.first[e] -= 1
        uses.coedge[uses.first[e]] = c


def edge_uses(g: Tables) -> EdgeUses:
    """Invert surface -> loop -> coedge -> edge; of one edge the coedges ascend."""
    n = len(g.coedges)
    uses = EdgeUses(np.empty(len(g.edges) + 1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64))
    _invert(g, uses)
    return uses


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
