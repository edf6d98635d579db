"""The budget of an attack: spread over all tiles and surfaces, cut into jobs."""

from __future__ import annotations

import numpy as np
import pytest

from nurbs_ooc.measure.attack_plan import PER_JOB, PER_SURFACE, PER_TILE, TileSize, efforts
from nurbs_ooc.measure.tile_task import Effort


def _sampled(jobs: list[Effort]) -> int:
    return sum(len(job.surfaces) * job.per_surface for job in jobs)


def _drawn(jobs: list[Effort]) -> int:
    return sum(job.drawn for job in jobs)


SIZES = [TileSize(1, 12), TileSize(900, 20_000), TileSize(90, 3_000), TileSize(5, 100)]


@pytest.mark.parametrize("samples", [100_000, 1_000_000, 30_000_000])
def test_a_budget_is_spent_half_in_each_direction(samples: int) -> None:
    plan = efforts(SIZES, samples, seed=3)
    assert sum(map(_sampled, plan)) == pytest.approx(samples / 2, rel=0.05)
    assert sum(map(_drawn, plan)) == pytest.approx(samples / 2, rel=0.05)
    for size, jobs in zip(SIZES, plan, strict=True):
        every = np.unique(np.concatenate([job.surfaces for job in jobs]))
        np.testing.assert_array_equal(every, np.arange(size.surfaces))
        assert [job.share for job in jobs] == [(k, len(jobs)) for k in range(len(jobs))]


def test_jobs_are_bounded() -> None:
    jobs = [job for own in efforts([*SIZES, TileSize(1, 5)], 50_000_000, seed=0) for job in own]
    assert max(len(job.surfaces) * job.per_surface for job in jobs) < 2 * PER_JOB
    assert max(job.drawn for job in jobs) < 2 * PER_JOB
    assert len({job.seed for job in jobs}) == len(jobs)


def test_too_small_a_budget_samples_some_surfaces_of_every_tile() -> None:
    plan = efforts(SIZES, 1, seed=0)
    for jobs in plan:
        assert len(jobs) == 1
        assert jobs[0].drawn == PER_TILE
        assert jobs[0].per_surface >= PER_SURFACE
        assert 1 <= len(jobs[0].surfaces) <= 3
    assert plan[1][0].surfaces.tolist() != efforts(SIZES, 1, seed=1)[1][0].surfaces.tolist()


def test_no_tiles() -> None:
    assert efforts([], 1000, seed=0) == []
