"""A face whose control points have moved: certified triangles at once, by the functions of every other face.

The knots and the p-curves stay. The edges' curves in space do not lie on the moved surface any more, so
every edge becomes what its p-curves trace on it (``ON_SURFACE``): no gap, and nothing to fit. Where the
sides of a seam have parted they become two edges with vertices of their own; where a side has shrunk to
a point, or a pole has opened, it becomes one, or an edge::

    v1  +--- seam ---+          +--- top ----+
        |            |   --->   |            |       compared at SAMPLES places along each p-curve
    v0  +--- seam ---+          +-- bottom --+
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.jit import kernel
from nurbs_cache.surface_record import ON_SURFACE, POLE, GeometryBatch, SurfaceKind
from nurbs_ooc.geometry.coedge import coedge_uv
from nurbs_ooc.geometry.natural_boundary import RELATIVE_TOLERANCE
from nurbs_ooc.geometry.subset import subset, take
from nurbs_ooc.geometry.surface import surface_point
from nurbs_ooc.geometry.tables import MAX_DEGREE, Tables, tables
from nurbs_ooc.tessellation.mesh import MeshBatch
from nurbs_ooc.tessellation.tessellate import tessellate

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Places along a p-curve where sides of a seam are compared. A side that leaves the other only between them
# is drawn where the other is, and the distance counts as a gap, which is measured at every sample.
SAMPLES = 17


@kernel
def _trace(g: Tables, out: Floats) -> None:
    """Points of surface 0 along all coedges, in the direction of their edges, to ``out`` (n_coedges, SAMPLES, 3)."""
    scratch = np.empty((4, MAX_DEGREE + 2))
    point = np.empty(12)
    for c in range(len(g.coedges)):
        edge = g.edges[g.coedges[c].edge]
        for i in range(SAMPLES):
            t = edge.t0 + (edge.t1 - edge.t0) * (i / (SAMPLES - 1.0))
            coedge_uv(g, c, t, scratch, point)
            surface_point(g, 0, point[0], point[1], scratch, point)
            for k in range(3):
                out[c, i, k] = point[k]


def _checked_net(surface: np.void, row: int, control_net: npt.ArrayLike, old: Floats) -> Floats:
    """The net (n_u, n_v, 3 or 4) as the record stores it, homogeneous if it has weights; ``old`` is the one it had."""
    if surface["kind"] != SurfaceKind.NURBS:
        kind = SurfaceKind(int(surface["kind"])).name
        raise UsageError(f"surface {row} is a {kind}: only NURBS have control points to move")
    n_u, n_v = int(surface["n_u"]), int(surface["n_v"])
    net = np.array(control_net, np.float64)
    if net.shape not in ((n_u, n_v, 3), (n_u, n_v, 4)):
        raise UsageError(f"control net of surface {row}: shape {net.shape}, must be ({n_u}, {n_v}, 3 or 4)")
    bad = np.argwhere(~np.isfinite(net).all(axis=2))
    if len(bad):
        raise UsageError(f"control point {tuple(bad[0].tolist())} of surface {row}: {net[tuple(bad[0])]} is not finite")
    if net.shape[2] == 3 and surface["rational"]:
        weights = old.reshape(n_u, n_v, 4)[..., 3:]
        net = np.concatenate([net * weights, weights], axis=2)
    if net.shape[2] == 4 and not (net[..., 3] > 0.0).all():
        i, j = np.argwhere(~(net[..., 3] > 0.0))[0].tolist()
        raise UsageError(f"control point ({i}, {j}) of surface {row}: weight {net[i, j, 3]}, must be above 0")
    return net


def _with_net(one: GeometryBatch, row: int, control_net: npt.ArrayLike) -> GeometryBatch:
    """The batch of one surface with another control net; ``row`` is its number in error messages."""
    surfaces = one.surfaces.copy()
    s = surfaces[0]
    n = int(s["n_u"]) * int(s["n_v"]) * (4 if s["rational"] else 3)
    net = _checked_net(s, row, control_net, one.values[s["points"] : s["points"] + n])
    surfaces["points"], surfaces["rational"] = len(one.values), net.shape[2] == 4
    surfaces["approximation_error"] = 0.0
    return replace(one, surfaces=surfaces, values=np.concatenate([one.values, net.ravel()]))


def _owners(edge: Ints, traces: Floats, tolerance: float) -> Ints:
    """For each coedge the first one along the same edge that runs where it does (itself, if there is no other)."""
    owner = np.arange(len(edge))
    first: dict[int, list[int]] = {}
    for c, e in enumerate(edge.tolist()):
        for other in first.setdefault(e, []):
            if np.abs(traces[c] - traces[other]).max() <= tolerance:
                owner[c] = other
                break
        else:
            first[e].append(c)
    return owner


class _Groups:
    """Sets of numbers that are joined pair by pair."""

    def __init__(self, n: int) -> None:
        self._parent = list(range(n))

    def first(self, i: int) -> int:
        """The least number of the set of ``i``."""
        while self._parent[i] != i:
            i = self._parent[i]
        return i

    def join(self, i: int, j: int) -> None:
        low, high = sorted((self.first(i), self.first(j)))
        self._parent[high] = low


def _corners(one: GeometryBatch, owner: Ints, is_point: npt.NDArray[np.bool_], ends: Floats, tolerance: float) -> Ints:
    """(n_coedges, 2) for the end of each coedge at t0 and t1 of its edge: the first of the ends that are one vertex.

    ``ends`` (n_coedges, 2, 3) are their places. Ends are one vertex where loops pass from one to the next, where
    edges are shared, and where they are in one place; never if they were two vertices before.
    """
    edges = one.edges[one.coedges["edge"]]
    old = np.stack([edges["vertex0"], edges["vertex1"]], axis=1).ravel()
    groups = _Groups(len(old))
    for first, n in one.loops.tolist():
        for c in range(first, first + n):
            leave = 2 * c + (0 if one.coedges["reversed"][c] else 1)
            following = first + (c - first + 1) % n
            enter = 2 * following + (1 if one.coedges["reversed"][following] else 0)
            if old[leave] == old[enter]:
                groups.join(leave, enter)
    for c, o in enumerate(owner.tolist()):
        groups.join(2 * c, 2 * o)
        groups.join(2 * c + 1, 2 * o + 1)
        if is_point[c]:
            groups.join(2 * c, 2 * c + 1)
    place = ends.reshape(-1, 3)
    order = np.argsort(old, kind="stable")
    for same in np.split(order, np.flatnonzero(np.diff(old[order])) + 1):
        for i in same.tolist():
            for j in same[same > i][np.abs(place[same[same > i]] - place[i]).max(axis=1) <= tolerance].tolist():
                groups.join(i, j)
    return np.array([groups.first(i) for i in range(len(old))], np.int64).reshape(-1, 2)


def deformed_face(geometry: GeometryBatch, row: int, control_net: npt.ArrayLike) -> GeometryBatch:
    """One surface with another control net, as a batch of its own.

    Args:
        geometry: one part.
        row: surface in it, a NURBS.
        control_net: (n_u, n_v, 3) points in mm, the weights stay; or (n_u, n_v, 4) homogeneous rows
            (w x, w y, w z, w), w > 0.

    Returns:
        The surface with its knots and p-curves; its edges lie on it (``ON_SURFACE``), its vertices too.

    Raises:
        UsageError: no such surface, it is no NURBS, or a net of another shape, with numbers that are not
            finite or weights that are not positive.
    """
    one = _with_net(subset(geometry, [row]), row, control_net)
    traces = np.empty((len(one.coedges), SAMPLES, 3))
    _trace(tables(one), traces)
    tolerance = RELATIVE_TOLERANCE * float(np.abs(traces).max(initial=0.0))
    owner = _owners(one.coedges["edge"].astype(np.int64), traces, tolerance)
    is_point = np.abs(traces - traces[:, :1]).max(axis=(1, 2), initial=0.0) <= tolerance
    ends = traces[:, [0, -1]]
    corners = _corners(one, owner, is_point, ends, tolerance)
    kept, vertex = np.unique(corners, return_inverse=True)
    vertex = vertex.reshape(-1, 2)

    owners, edge_of = np.unique(owner, return_inverse=True)
    edges = take(one.edges, one.coedges["edge"][owners].astype(np.int64))
    edges["curve"] = np.where(is_point[owners], POLE, ON_SURFACE)
    edges["vertex0"], edges["vertex1"] = vertex[owners, 0], vertex[owners, 1]
    coedges = one.coedges.copy()
    coedges["edge"], coedges["pole"] = edge_of, is_point
    coedges["seam"] = np.bincount(edge_of, minlength=len(owners))[edge_of] > 1
    return replace(one, coedges=coedges, edges=edges, vertices=ends.reshape(-1, 3)[kept])


def tessellate_deformed(geometry: GeometryBatch, row: int, control_net: npt.ArrayLike, chord_error: float) -> MeshBatch:
    """Triangulate a surface as if it had another control net, within ``chord_error``; nothing is prepared.

    Args:
        geometry, row, control_net: see ``deformed_face``.
        chord_error: mm, > 0.

    Returns:
        The mesh of that face alone, ``faces == [row]``. Its boundary lies on the moved surface, not on what
        its neighbours have along their common edges.

    Raises:
        UsageError: see ``deformed_face`` and ``tessellate``.
    """
    mesh = tessellate(deformed_face(geometry, row, control_net), chord_error)
    return replace(mesh, faces=np.array([row], np.int64))
