"""The other direction of the attack on a tile: points of what it draws to its surfaces; around the worst, more.

The triangles around the worst points are measured again, denser, and those around the worst of these: a
displaced vertex is found from its neighbourhood. A point that seems too far is searched from every start
near it, and counts only if it is proven that no surface is near enough.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.certify_far import FarProof
from nurbs_ooc.measure.foot_point import FootFinder
from nurbs_ooc.measure.mesh_sampler import CENTROID, CORNERS, MIDDLES
from nurbs_ooc.measure.tile_task import TileTask

SAMPLES_PER_STAR = 512  # one point of so many has its neighbourhood measured again, which costs about as many
ROUNDS = 3
EXAMINED = 1000  # points that seem too far are searched one by one, worst first; a millisecond each
ENOUGH = 3  # violations of one attack

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def tile_to_surface(task: TileTask, p: Floats, triangle: Indices) -> None:
    """Measure drawn points.

    Args:
        task: prepared with all surfaces whose boxes are within the promise of ``p``.
        p: (n, 3) mm.
        triangle: (n,) row of the tile's triangle each lies on, -1 for points of lines and lone points.
    """
    _DrawnAttack(task).run(p, triangle)


class _DrawnAttack:
    def __init__(self, task: TileTask) -> None:
        self.task = task
        self.finder = FootFinder(task.region)
        self.far = FarProof(task.region)

    def run(self, p: Floats, triangle: Indices) -> None:
        distance = self._measure(p)
        all_p, all_distance = [p], [distance]
        done = np.zeros(0, np.int64)
        for _ in range(ROUNDS):
            on_triangle = np.flatnonzero(triangle >= 0)
            worst = on_triangle[np.argsort(-distance[on_triangle], kind="stable")]
            around = self.task.tile.stars.around(triangle[worst[: 1 + len(all_p[0]) // SAMPLES_PER_STAR]])
            around = np.setdiff1d(around, done)
            done = np.union1d(done, around)
            p, triangle = self._points_of(around)
            distance = self._measure(p)
            all_p.append(p)
            all_distance.append(distance)
        self._judge(np.concatenate(all_p), np.concatenate(all_distance))

    def _points_of(self, triangles: Indices) -> tuple[Floats, Indices]:
        """Corners, middles and centroids."""
        tile, fixed = self.task.tile, np.concatenate([CORNERS, MIDDLES, CENTROID])
        p = np.einsum("nk,tki->tni", fixed, tile.positions[tile.triangles[triangles]])
        return p.reshape(-1, 3), np.repeat(triangles, len(fixed))

    def _measure(self, p: Floats) -> Floats:
        """Distances; 0 where a surface that cannot be evaluated, or was not prepared, may be what is drawn."""
        task = self.task
        start, near = task.near.find(p, task.limit)
        _, _, distance = self.finder.nearest(p, *self._candidates(start, near))
        task.finding.n_samples += len(p)
        of = np.repeat(np.arange(len(p)), np.diff(start))
        unknown = np.zeros(len(p), np.bool_)
        unknown[of[task.face_of[near] < 0]] = True
        distance[unknown & (distance > task.limit)] = 0.0
        return distance

    def _candidates(self, start: Indices, near: Indices) -> tuple[Indices, Indices]:
        """The same lists, of faces instead of items."""
        face = self.task.face_of[near]
        kept = np.concatenate([[0], np.cumsum(face >= 0)])
        return kept[start], face[face >= 0]

    def _judge(self, p: Floats, distance: Floats) -> None:
        task = self.task
        fits = distance <= task.limit
        task.finding.tile_to_surface = float(distance[fits].max(initial=0.0))
        far = np.flatnonzero(~fits)
        far = far[np.argsort(-distance[far], kind="stable")]
        n_broken = 0
        for n, k in enumerate(far):
            if n_broken == ENOUGH:
                return
            if n == EXAMINED:
                task.finding.undecided += len(far) - n
                return
            n_broken += self._is_broken(p[k], float(distance[k]))

    def _is_broken(self, p: Floats, distance: float) -> bool:
        """Search everything near a point; if that finds no foot, prove that there is none."""
        task = self.task
        _, faces = self._candidates(*task.near.find(p[None], task.limit))
        if not len(faces):  # in no surface's box: at least as far as the nearest box
            low, high = task.items.boxes[:, :3], task.items.boxes[:, 3:]
            distance = float(np.linalg.norm(np.maximum(0.0, np.maximum(low - p, p - high)), axis=1).min())
        found = [self.finder.search(p, int(f), distance) for f in faces]
        distance = min([distance, *(to_face for to_face, _ in found)])
        if distance > task.limit:
            for f, (_, to_boundary) in zip(faces, found, strict=True):
                if not self.far.nowhere_near(int(f), p, task.limit, to_boundary):
                    task.finding.undecided += 1
                    return False
            task.broken("mesh to surface", distance, p)
        task.finding.tile_to_surface = max(task.finding.tile_to_surface, distance)
        return bool(distance > task.limit)
