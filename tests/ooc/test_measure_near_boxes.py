"""Boxes near points against the plain test of all of them."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_ooc.measure.near_boxes import NearBoxes


@pytest.mark.kernel
@pytest.mark.parametrize("n", [0, 1, 3, 60])
@pytest.mark.parametrize("reach", [0.0, 0.2, 100.0])
def test_every_near_box_and_no_other(n: int, reach: float) -> None:
    rng = np.random.default_rng(n)
    low = rng.normal(size=(n, 3)).round(1)
    boxes = np.concatenate([low, low + rng.random((n, 3)).round(1)], 1)
    p = rng.normal(size=(40, 3)).round(1)
    start, found = NearBoxes(boxes).find(p, reach)
    for i, q in enumerate(p):
        away = np.linalg.norm(np.maximum(0, np.maximum(boxes[:, :3] - q, q - boxes[:, 3:])), axis=1)
        assert sorted(found[start[i] : start[i + 1]]) == np.flatnonzero(away <= reach).tolist()


@pytest.mark.kernel
def test_a_box_without_end_is_near_everything() -> None:
    start, found = NearBoxes(np.array([[-np.inf] * 3 + [np.inf] * 3])).find(np.zeros((2, 3)), 1e-9)
    assert start.tolist() == [0, 1, 2]
    assert found.tolist() == [0, 0]
