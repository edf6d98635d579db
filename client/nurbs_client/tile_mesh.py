"""A decoded tile in the form that goes to the graphics card, made on a loader's thread.

A vertex takes 16 bytes: three float32 relative to the tile's origin, and the normal as two 16-bit
octahedral coordinates. The map to the octahedron and its inverse are good to 1e-4 rad, far below what
10-bit tiles carry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_cache.tile import decode_tile

VERTEX_DTYPE = np.dtype([("position", "<f4", (3,)), ("normal", "<i2", (2,))])


@dataclass(frozen=True, eq=False)
class TileMesh:
    """What the renderer takes.

    Attributes:
        origin: (3,) float64 mm, in the tile's space.
        vertices: (n,) ``VERTEX_DTYPE``.
        triangles: (t, 3), lines: (l, 2), points: (p,) uint32 rows in ``vertices``.
        error: mm, the sum of the tile's ledger.
        positions: (n, 3) float32 mm, relative to the origin: for measuring distances.
    """

    origin: npt.NDArray[np.float64]
    vertices: npt.NDArray[np.void]
    triangles: npt.NDArray[np.uint32]
    lines: npt.NDArray[np.uint32]
    points: npt.NDArray[np.uint32]
    error: float
    positions: npt.NDArray[np.float32]

    @property
    def n_bytes(self) -> int:
        """Of graphics memory."""
        return self.vertices.nbytes + self.triangles.nbytes + self.lines.nbytes + self.points.nbytes


def read_tile(data: bytes) -> TileMesh:
    """Decode a tile.

    Raises:
        CorruptRecordError: it is truncated or fails its checksum.
    """
    tile = decode_tile(data)
    return make_mesh(
        tile.origin, tile.positions, tile.normals, tile.triangles, tile.lines, tile.points, tile.ledger.total
    )


def make_mesh(
    origin: npt.NDArray[np.float64],
    positions: npt.NDArray[np.float32],
    normals: npt.NDArray[np.float32],
    triangles: npt.NDArray[np.uint32],
    lines: npt.NDArray[np.uint32],
    points: npt.NDArray[np.uint32],
    error: float,
) -> TileMesh:
    """Pack plain arrays; shapes as in ``TileMesh``, normals (n, 3) unit."""
    vertices = np.zeros(len(positions), VERTEX_DTYPE)
    vertices["position"] = positions
    vertices["normal"] = octahedral(normals)
    return TileMesh(
        np.asarray(origin, np.float64),
        vertices,
        np.ascontiguousarray(triangles, np.uint32).reshape(-1, 3),
        np.ascontiguousarray(lines, np.uint32).reshape(-1, 2),
        np.ascontiguousarray(points, np.uint32).reshape(-1),
        float(error),
        np.ascontiguousarray(positions, np.float32).reshape(-1, 3),
    )


def octahedral(normals: npt.NDArray[np.float32]) -> npt.NDArray[np.int16]:
    """(n, 3) unit normals to (n, 2) coordinates on the unfolded octahedron, -32767 to 32767.

    Source: Cigolle et al., A survey of efficient representations for independent unit vectors, 2014.
    """
    n = np.asarray(normals, np.float64)
    flat = n / np.maximum(np.abs(n).sum(axis=1, keepdims=True), 1e-30)
    folded = (1.0 - np.abs(flat[:, 1::-1])) * np.where(flat[:, :2] >= 0, 1.0, -1.0)
    return np.asarray(np.rint(np.where(flat[:, 2:] >= 0, flat[:, :2], folded) * 32767.0), np.int16)
