"""One direction of the attack on a tile: samples of its surfaces to what it draws; the worst climb."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.ascent import climb, worst_of_each
from nurbs_ooc.measure.face_sampler import SampleSet, sample_faces
from nurbs_ooc.measure.tile_task import Effort, TileTask

SAMPLES_PER_CLIMB = 128  # one sample of so many climbs, which costs as many distances again
BOX_SLACK = 1e-9  # of a box's size and place: what rounding may leave outside

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def surface_to_tile(task: TileTask, effort: Effort, node_box: Floats | None) -> None:
    """Sample the effort's surfaces.

    Args:
        task: prepared with these surfaces.
        effort: which, and how many samples.
        node_box: (6,) box that must hold them; None: there is none, nor are the surfaces' own boxes tested.
    """
    faces = task.face_of[effort.surfaces]
    samples = sample_faces(task.region, effort.per_surface, effort.seed, faces[faces >= 0])
    if node_box is not None:
        _check_boxes(task, samples, node_box)
    distance, _ = task.tile.tree.query(samples.points)
    task.finding.n_samples += len(distance)
    n_climbs = 1 + len(distance) // SAMPLES_PER_CLIMB
    top = worst_of_each(samples.face, distance, 1 + 4 * n_climbs // max(1, len(faces)))
    top = top[np.argsort(-distance[top], kind="stable")][:n_climbs]
    if len(top):
        _climb(task, samples.face[top], samples.uv[top], distance[top], effort.per_surface)


def _climb(task: TileTask, face: Indices, begin: Floats, distance: Floats, per_surface: int) -> None:
    region = task.region
    step = (region.bounds[face, 2:] - region.bounds[face, :2]) / np.sqrt(per_surface)

    def measure(start: Indices, p: Floats) -> Floats:
        task.finding.n_samples += len(start)
        return task.tile.tree.query(p)[0]

    uv, value = climb(region, face, begin, distance, step, measure)
    worst = int(np.argmax(value))
    task.finding.surface_to_tile = float(value[worst])
    if value[worst] > task.limit:
        p = region.placed.points(face[worst], uv[worst])[0]
        task.broken("surface to mesh", float(value[worst]), p, int(face[worst]), uv[worst])


def _check_boxes(task: TileTask, samples: SampleSet, node_box: Floats) -> None:
    """Samples of a surface must lie in its own box and in the node's."""
    own = task.items.boxes[task.item_of[samples.face]]
    for kind, boxes in (("out of its box", node_box), ("out of the box of the surface", own)):
        slack = BOX_SLACK * np.abs(boxes).max(-1)
        out = np.maximum(boxes[..., :3] - samples.points, samples.points - boxes[..., 3:]).max(1) - slack
        if len(out) and out.max() > 0.0:
            k = int(np.argmax(out))
            task.broken(kind, float(out[k]), samples.points[k], int(samples.face[k]), samples.uv[k], limit=0.0)
