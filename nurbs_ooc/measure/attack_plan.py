"""How a budget of samples is spread over the tiles of a cache.

Half of the budget goes from the surfaces to the tiles, equally over all pairs of a tile and a surface
that it shows; the other half goes back from the tiles, in proportion to what they draw. Every tile gets
some of both, however small the budget; where it does not reach for every surface of a tile, a random choice
of them is sampled. Tiles with much to do are cut into jobs, by surfaces and by primitives, so that memory
and the work between two strokes of the progress bar stay bounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.tile_task import Effort

DEFAULT_SAMPLES = 2_000_000  # some 200 a surface and level of an assembly of 2,000 faces, in half a minute
PER_TILE = 48  # of each direction, at least
PER_SURFACE = 24  # at least, of the surfaces that are sampled: the kinds of samples need so many
PER_JOB = 30_000  # samples of one direction, about


@dataclass(frozen=True)
class TileSize:
    """What there is to attack in a tile: how many surfaces it shows and primitives it draws."""

    surfaces: int
    primitives: int


def efforts(sizes: list[TileSize], samples: int, seed: int) -> list[list[Effort]]:
    """The jobs of each tile.

    Args:
        sizes: of the tiles.
        samples: the budget, before climbing; tiles' minima can exceed it.
        seed: of what is chosen and of what the jobs draw.
    """
    n_pairs, n_primitives = sum(s.surfaces for s in sizes), sum(s.primitives for s in sizes)
    per_pair = samples / 2 / max(1, n_pairs)
    per_primitive = samples / 2 / max(1, n_primitives)
    return [_of_tile(size, per_pair, per_primitive, seed, tile) for tile, size in enumerate(sizes)]


def _of_tile(size: TileSize, per_pair: float, per_primitive: float, seed: int, tile: int) -> list[Effort]:
    wanted = max(PER_TILE, round(size.surfaces * per_pair))
    per_surface = max(PER_SURFACE, round(wanted / max(1, size.surfaces)))
    chosen = np.arange(size.surfaces)
    if size.surfaces * per_surface > 1.5 * wanted:
        n = max(1, wanted // per_surface)
        chosen = np.sort(np.random.default_rng([seed, tile, 0x91A7]).choice(size.surfaces, n, replace=False))
    drawn = max(PER_TILE, round(size.primitives * per_primitive))
    n_jobs = max(1, round(max(len(chosen) * per_surface, drawn) / PER_JOB))
    rounds = -(-n_jobs // max(1, len(chosen)))  # a surface with more samples than a job takes several
    return [
        Effort(
            surfaces=part,
            per_surface=-(-per_surface // rounds),
            share=(job, n_jobs),
            drawn=-(-drawn // n_jobs),
            seed=(seed, tile, job),
        )
        for job, part in enumerate(_dealt(chosen, n_jobs, rounds))
    ]


def _dealt(chosen: npt.NDArray[np.int64], n_jobs: int, rounds: int) -> list[npt.NDArray[np.int64]]:
    """The chosen surfaces, ``rounds`` times over, in ``n_jobs`` runs."""
    return [np.unique(part) for part in np.array_split(np.tile(chosen, rounds), n_jobs)]
