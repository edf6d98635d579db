"""Smallest angles of triangles, against triangles whose angles are known."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_ooc.export.smallest_angles import LARGEST, AngleCount, smallest_angles


def triangle(alpha: float, beta: float, scale: float = 1.0) -> np.ndarray:
    """Corners of a triangle with two given angles (degrees), turned in space."""
    a, b = np.radians([alpha, beta])
    foot = np.tan(b) / (np.tan(a) + np.tan(b))
    flat = np.array([[0, 0, 0], [1, 0, 0], [foot, foot * np.tan(a), 0]]) * scale
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return flat @ turn.T + [5.0, -2.0, 9.0]


@pytest.mark.parametrize(("alpha", "beta", "least"), [(60, 60, 60), (30, 80, 30), (20, 85, 20), (1e-3, 45, 1e-3)])
def test_known_angles(alpha: float, beta: float, least: float) -> None:
    for order in ([0, 1, 2], [2, 0, 1], [1, 0, 2]):
        angle = smallest_angles(triangle(alpha, beta, 40.0)[order], np.array([[0, 1, 2]]))
        assert angle == pytest.approx([least], rel=1e-6)


def test_corners_in_one_place_and_on_a_line_count_as_zero() -> None:
    p = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    assert smallest_angles(p, np.array([[0, 1, 2], [0, 2, 3]])).tolist() == [0.0, 0.0]


def test_summary_of_many() -> None:
    rng = np.random.default_rng(1)
    p, t = rng.normal(size=(3000, 3)), np.arange(3000).reshape(-1, 3)
    count = AngleCount()
    count.add(p, t[:400])
    count.add(p, t[400:])
    summary, angles = count.as_json(), smallest_angles(p, t)
    assert summary is not None
    assert summary["min"] == angles.min() and angles.max() <= LARGEST + 1e-9
    assert summary["median"] == pytest.approx(np.quantile(angles, 0.5, method="inverted_cdf"), abs=0.05)
    assert summary["p1"] == pytest.approx(np.quantile(angles, 0.01, method="inverted_cdf"), abs=0.05)
    assert AngleCount().as_json() is None
