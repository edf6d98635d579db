"""What is measured of a mesh against closed forms: area, volume, Euler number, components, angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.tessellation.mesh import MeshBatch

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MeshMeasures:
    """All of them at once; lengths in mm."""

    area: float
    volume: float
    euler: int
    components: int
    closed: bool
    smallest_area: float
    n_triangles: int
    normal_deviation_deg: float  # largest angle between a vertex normal and its triangle's own
    edge_length: float  # of all triangles together
    inverted_height: float  # largest height of a triangle that all its vertex normals are against


def corners(mesh: MeshBatch) -> Array:
    """(t, 3, 3) corners of all triangles."""
    return np.asarray(mesh.positions[mesh.triangles])


def measure(mesh: MeshBatch, origin: Array) -> MeshMeasures:
    """Measure a mesh; ``origin`` (3,) is subtracted first, so that far meshes lose no digits twice."""
    p = corners(mesh) - origin
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    volume = float(np.einsum("ni,ni->n", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6.0)
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = weld.reshape(-1)[mesh.triangles]
    t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]  # counted by their area, not here
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    n_vertices = len(np.unique(t))
    return MeshMeasures(
        area=float(areas.sum()),
        volume=volume,
        euler=n_vertices - len(edges) + len(t),
        components=_components(t),
        closed=bool(len(count)) and bool((count == 2).all()),
        smallest_area=float(areas.min(initial=np.inf)),
        n_triangles=len(mesh.triangles),
        normal_deviation_deg=_normal_deviation(mesh, cross),
        edge_length=float(np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).sum()),
        inverted_height=_inverted_height(mesh, p, cross),
    )


def _components(t: npt.NDArray[np.int64]) -> int:
    """Connected sets of triangles that share welded vertices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if not len(t):
        return 0
    _, rows = np.unique(t, return_inverse=True)
    rows = rows.reshape(-1, 3)
    a, b = rows[:, [0, 1]].ravel(), rows[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(rows.max() + 1,) * 2)
    return int(connected_components(graph, directed=False)[0])


def _inverted_height(mesh: MeshBatch, p: Array, cross: Array) -> float:
    against = (np.einsum("ni,nki->nk", cross, mesh.normals[mesh.triangles]) < 0.0).all(axis=1)
    longest = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).max(axis=1)
    height = np.linalg.norm(cross, axis=1) / np.maximum(longest, 1e-300)
    return float(height[against].max(initial=0.0))


def _normal_deviation(mesh: MeshBatch, cross: Array) -> float:
    size = np.linalg.norm(cross, axis=1)
    flat = cross[size > 0] / size[size > 0][:, None]
    if not len(flat):
        return 0.0
    cosine = np.einsum("ni,nki->nk", flat, mesh.normals[mesh.triangles[size > 0]]).min()
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def inside_points(mesh: MeshBatch, per_triangle: int, seed: int = 0) -> Array:
    """Random points of every triangle, its corners included."""
    weights = np.concatenate([np.eye(3), np.random.default_rng(seed).dirichlet((1, 1, 1), per_triangle)])
    return np.einsum("nk,tkd->tnd", weights, corners(mesh)).reshape(-1, 3)
