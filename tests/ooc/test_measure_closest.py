"""Distances to primitives against libigl and hand-made cases."""

from __future__ import annotations

import igl
import numpy as np
import pytest

from nurbs_ooc.measure.box_forest import LEAF, box_forest
from nurbs_ooc.measure.closest import ClosestPrimitive, as_primitives
from tests.ooc.measure_shapes import octasphere


@pytest.mark.parametrize("n", [1, 3, 5, 700, 30_000])
def test_triangles_equal_libigl(n: int) -> None:
    rng = np.random.default_rng(n)
    v = rng.normal(size=(3 * n, 3))
    v += np.repeat(rng.normal(size=(n, 3)) * 5, 3, axis=0)
    t = np.arange(3 * n).reshape(-1, 3)
    p = rng.normal(size=(2000, 3)) * 6
    got, at = ClosestPrimitive(v, t).query(p)
    d2, _, _ = igl.point_mesh_squared_distance(p, v, t)
    np.testing.assert_allclose(got, np.sqrt(d2), atol=1e-12)
    again = np.array([ClosestPrimitive(v, t[[i]]).query(q)[0][0] for q, i in zip(p[:20], at[:20], strict=True)])
    np.testing.assert_array_equal(again, got[:20])


@pytest.mark.kernel
def test_groups_do_not_see_each_other() -> None:
    v, t = octasphere(1.0, 3)
    both = np.concatenate([v, v + np.array([10.0, 0, 0])])
    groups = np.repeat([0, 2], len(t))
    tree = ClosestPrimitive(both, np.concatenate([t, t + len(v)]), groups, n_groups=4)
    d, at = tree.query(np.zeros((4, 3)), [0, 1, 2, 3])
    assert d[0] < 1.0
    assert d[2] > 8.9
    assert np.isinf(d[[1, 3]]).all()
    assert (at[[1, 3]] == -1).all()


@pytest.mark.kernel
def test_segments_and_points() -> None:
    v = np.array([[0, 0, 0], [10, 0, 0], [5, 5, 5]], float)
    tree = ClosestPrimitive(v, as_primitives(np.zeros((0, 3), int), np.array([[0, 1]]), np.array([2])))
    d, at = tree.query([[5, 1, 0], [-3, 4, 0], [5, 5, 7]])
    np.testing.assert_allclose(d, [1, 5, 2])
    assert at.tolist() == [0, 0, 1]


@pytest.mark.kernel
@pytest.mark.parametrize("height", [1e-3, 1e-9, 1e-13, 1e-17, 0.0])
def test_needles_are_never_closer_than_they_are(height: float) -> None:
    v = np.array([[0, 0, 0], [1, 0, 0], [0.3, height, 0]], float)
    p = np.array([[0.3, 0.0, 2.0], [0.7, -1.0, 0.0], [3.0, 0.0, 0.0]])
    d, _ = ClosestPrimitive(v, np.array([[0, 1, 2]])).query(p)
    np.testing.assert_allclose(d, [2.0, 1.0, 2.0], rtol=1e-12)


@pytest.mark.kernel
def test_empty() -> None:
    d, at = ClosestPrimitive(np.zeros((0, 3)), np.zeros((0, 3), np.int64)).query([[0, 0, 0]])
    assert np.isinf(d[0])
    assert at[0] == -1


@pytest.mark.kernel
def test_leaves_hold_few_boxes_and_every_box_is_in_one() -> None:
    rng = np.random.default_rng(3)
    low = rng.normal(size=(300, 3)).round(1)  # many centres are equal
    boxes = np.concatenate([low, low + rng.random((300, 3)).round(1)], 1)
    forest = box_forest(boxes, np.repeat([0, 2], [100, 200]), 3)
    assert forest.roots[1] == -1
    assert sorted(forest.order[:100]) == list(range(100))
    assert sorted(forest.order) == list(range(300))
    nodes = [int(r) for r in forest.roots if r >= 0]
    for node in nodes:
        own = boxes[forest.order[forest.first[node] : forest.first[node] + forest.length[node]]]
        np.testing.assert_array_equal(forest.box[node], [*own[:, :3].min(0), *own[:, 3:].max(0)])
        if forest.child[node] < 0:
            assert forest.length[node] <= LEAF
        else:
            nodes += [int(forest.child[node]), int(forest.child[node]) + 1]
    assert sum(forest.length[n] for n in nodes if forest.child[n] < 0) == 300
