"""Points of what a tile draws: vertices, middles and random points of lines, and points of triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.drawn_tile import DrawnTile
from nurbs_ooc.measure.mesh_sampler import sample_triangles


def sample_drawn(
    tile: DrawnTile, share: tuple[int, int], n: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """About ``n`` points of the k-th of m equal shares of the triangles, lines and points.

    Half of them are vertices, as long as there are so many.

    Args:
        tile: what is drawn.
        share: k and m.
        n: how many.
        rng: where chance comes from.

    Returns:
        (p, 3) points in mm and (p,) the row of a triangle that each lies on, -1 where there is none.
    """
    k, m = share
    t, lines, lone = (slice(len(x) * k // m, len(x) * (k + 1) // m) for x in (tile.triangles, tile.lines, tile.points))
    drawn = [_vertices(tile, t, lines, lone, max(1, n // 2), rng)]
    if lines.stop > lines.start:
        ends = tile.positions[tile.lines[rng.integers(lines.start, lines.stop, n // 4)]]
        along = np.where(rng.random(len(ends)) < 0.5, 0.5, rng.random(len(ends)))[:, None]
        drawn.append(((1.0 - along) * ends[:, 0] + along * ends[:, 1], np.full(len(ends), -1)))
    left = n - sum(len(p) for p, _ in drawn)
    if t.stop > t.start and left > 0:
        corner = tile.positions[tile.triangles[t]]
        areas = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        _, row, weight = sample_triangles(areas, np.array([0, len(areas)]), left, rng)
        drawn.append((np.einsum("nk,nki->ni", weight, corner[row]), row + t.start))
    return np.concatenate([p for p, _ in drawn]), np.concatenate([row for _, row in drawn])


def _vertices(
    tile: DrawnTile, t: slice, lines: slice, lone: slice, most: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Some of the vertices in use, each with a triangle that it is a corner of."""
    used = np.concatenate([tile.triangles[t].ravel(), tile.lines[lines].ravel(), tile.points[lone]])
    row = np.full(len(used), -1)
    row[: 3 * (t.stop - t.start)] = np.repeat(np.arange(t.start, t.stop), 3)
    used, first = np.unique(used, return_index=True)
    if len(used) > most:
        kept = np.sort(rng.choice(len(used), most, replace=False))
        used, first = used[kept], first[kept]
    return tile.positions[used], row[first]
