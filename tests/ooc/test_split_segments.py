"""Segments of edges cut into parts."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.ranges import at_once
from nurbs_ooc.geometry.sample_faces import add_cylinder, add_plane
from nurbs_ooc.geometry.tables import Tables, tables
from nurbs_ooc.tessellation.edge_samples import EdgeSamples
from nurbs_ooc.tessellation.edge_uses import EdgeUses, edge_uses
from nurbs_ooc.tessellation.split_segments import GROWN_SAMPLES, most_samples, split_segments
from nurbs_ooc.tessellation.workers import Lengths, Threads


def _sampled() -> tuple[Tables, EdgeUses, EdgeSamples]:
    """Every edge but the first at its ends and two thirds of its range; the first has no samples."""
    builder = BatchBuilder()
    add_cylinder(builder)
    add_plane(builder)
    g = tables(builder.build())
    first = np.append(0, 3 * np.arange(len(g.edges)))
    t = np.stack([g.edges["t0"], g.edges["t0"] / 3 + g.edges["t1"] * 2 / 3, g.edges["t1"]], axis=1)[1:].ravel()
    # Places that no curve has: what is not evaluated anew keeps them.
    position = np.full((len(t), 3), 7777.0)
    return g, edge_uses(g), EdgeSamples(first.astype(np.int64), t, position, np.zeros(len(g.coedges)))


@pytest.mark.kernel
def test_segments_become_equal_parts_and_other_edges_stay() -> None:
    g, uses, old = _sampled()
    parts = np.zeros(len(old.t), np.int64)
    parts[old.first[2]] = 4  # the first segment of edge 2
    parts[old.first[3] - 1] = 9  # the last sample of edge 2 begins none
    new, changed = split_segments(g, uses, old, parts, most_samples(old), at_once)
    assert np.flatnonzero(changed).tolist() == [2]
    assert np.array_equal(np.diff(new.first), np.diff(old.first) + np.where(changed, 3, 0))
    a, b, c = old.t[old.first[2] : old.first[3]]
    mine = slice(new.first[2], new.first[3])
    assert np.allclose(new.t[mine], [*np.linspace(a, b, 5), c], rtol=0, atol=1e-15 * abs(c - a))
    assert new.t[mine][[0, 4, 5]].tolist() == [a, b, c]
    assert (new.position[mine] != 7777.0).all()
    assert (np.delete(new.position, np.arange(mine.start, mine.stop), axis=0) == 7777.0).all()
    assert np.array_equal(np.delete(new.t, np.arange(mine.start, mine.stop)), np.delete(old.t, [3, 4, 5]))


def test_no_edge_gets_more_samples_than_there_may_be() -> None:
    g, uses, old = _sampled()
    parts = np.ones(len(old.t), np.int64)
    parts[old.first[1]], parts[old.first[2]] = GROWN_SAMPLES - 2, GROWN_SAMPLES - 1
    new, changed = split_segments(g, uses, old, parts, most_samples(old), at_once)
    assert np.flatnonzero(changed).tolist() == [1]
    assert new.first[2] - new.first[1] == GROWN_SAMPLES
    assert new.first[3] - new.first[2] == 3


@pytest.mark.kernel
def test_the_result_does_not_depend_on_threads() -> None:
    g, uses, old = _sampled()
    parts = np.arange(len(old.t), dtype=np.int64) % 4
    one, changed_one = split_segments(g, uses, old, parts, most_samples(old), at_once)
    two, changed_two = split_segments(g, uses, old, parts, most_samples(old), Threads(2).runner(Lengths(1, 1)))
    assert np.array_equal(changed_one, changed_two)
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
