"""Attack one stored tile: the placed surfaces it stands for against what it draws, in both directions.

Every sample of every surface must be within the tile's error of a drawn triangle, line or point, and
every drawn vertex, and every point of a drawn triangle or line, within it of one of the surfaces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.drawn_sampler import sample_drawn
from nurbs_ooc.measure.surface_to_tile import surface_to_tile
from nurbs_ooc.measure.tile_task import Effort, TileFinding, TileTask
from nurbs_ooc.measure.tile_to_surface import tile_to_surface


def attack_tile(task: TileTask, effort: Effort, node_box: npt.NDArray[np.float64] | None = None) -> TileFinding:
    """Measure a tile against its surfaces.

    Args:
        task: the tile and its surfaces.
        effort: which surfaces and primitives, and how many points of them.
        node_box: (6,) box that must hold all surfaces; None: boxes are not tested.
    """
    if not task.tile.n_primitives:
        task.broken("lost", np.nan)
        return task.finding
    rng = np.random.default_rng(effort.seed)
    p, triangle = sample_drawn(task.tile, effort.share, effort.drawn, rng)
    _, near = task.near.find(p, task.limit)
    task.prepare(np.union1d(effort.surfaces, near))
    task.finding.skipped_surfaces = int(task.unusable[effort.surfaces].sum())
    surface_to_tile(task, effort, node_box)
    tile_to_surface(task, p, triangle)
    return task.finding
