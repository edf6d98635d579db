"""Brute-force distances from points to what is drawn, in plain numpy: the oracle of the hierarchy's tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def to_segments(points: Array, a: Array, b: Array) -> Array:
    """(n,) distance of each point to the nearest of the segments (m, 3) a-b; inf if there is none."""
    best = np.full(len(points), np.inf)
    for p, q in zip(a, b, strict=True):
        d = q - p
        t = np.clip((points - p) @ d / max(d @ d, 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * d, axis=1))
    return best


def to_triangles(points: Array, corners: Array) -> Array:
    """(n,) distance of each point to the nearest of the triangles (m, 3, 3)."""
    best = np.full(len(points), np.inf)
    for p, q, r in corners:
        normal = np.cross(q - p, r - p)
        square = normal @ normal
        if square > 0:
            w = points - p
            beta = np.cross(w, r - p) @ normal / square
            gamma = np.cross(q - p, w) @ normal / square
            inside = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
            best = np.minimum(best, np.where(inside, np.abs(w @ normal) / np.sqrt(square), np.inf))
        best = np.minimum(best, to_segments(points, np.array([p, q, r]), np.array([q, r, p])))
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
