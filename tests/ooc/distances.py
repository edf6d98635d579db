"""Brute-force distances from points to what is drawn, in plain numpy: the oracle of the hierarchy's tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


CHUNK = 64  # primitives that are compared with all points at once


def to_segments(points: Array, a: Array, b: Array) -> Array:
    """(n,) distance of each point to the nearest of the segments (m, 3) a-b; inf if there is none."""
    best = np.full(len(points), np.inf)
    for first in range(0, len(a), CHUNK):
        p, d = a[first : first + CHUNK], (b - a)[first : first + CHUNK]
        w = points[:, None] - p
        t = np.clip((w * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(w - t[:, :, None] * d, axis=2).min(axis=1))
    return best


def to_triangles(points: Array, corners: Array) -> Array:
    """(n,) distance of each point to the nearest of the triangles (m, 3, 3)."""
    best = np.full(len(points), np.inf)
    for k in range(3):
        best = np.minimum(best, to_segments(points, corners[:, k], corners[:, (k + 1) % 3]))
    for first in range(0, len(corners), CHUNK):
        p, q, r = (corners[first : first + CHUNK, k] for k in range(3))
        normal = np.cross(q - p, r - p)
        square = np.maximum((normal * normal).sum(axis=1), 1e-300)
        w = points[:, None] - p
        beta = (w * np.cross(r - p, normal)).sum(axis=2) / square
        gamma = (w * np.cross(normal, q - p)).sum(axis=2) / square
        inside = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (square > 1e-300)
        height = np.abs((w * normal).sum(axis=2)) / np.sqrt(square)
        best = np.minimum(best, np.where(inside, height, np.inf).min(axis=1))
    return best


def to_drawn(points: Array, positions: Array, triangles: Array, lines: Array, dots: Array) -> Array:
    """(n,) distance of each point to the nearest triangle, line or point."""
    best = to_triangles(points, positions[triangles])
    best = np.minimum(best, to_segments(points, positions[lines[:, 0]], positions[lines[:, 1]]))
    return np.minimum(best, to_segments(points, positions[dots], positions[dots]))


def samples_of(positions: Array, triangles: Array, lines: Array, dots: Array, n: int = 6) -> Array:
    """Points spread over triangles (their corners included), lines and points."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    inside = (i + j <= n).ravel()
    weights = np.stack([i.ravel(), j.ravel(), (n - i - j).ravel()], axis=1)[inside] / n
    t = np.linspace(0, 1, n)
    on_lines = np.stack([t, 1 - t], axis=1)
    return np.concatenate(
        [
            (weights[None] @ positions[triangles]).reshape(-1, 3),
            (on_lines[None] @ positions[lines]).reshape(-1, 3),
            positions[dots],
        ]
    )
