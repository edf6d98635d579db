"""What a tile draws, with what the attack looks up in it: made once for all jobs on the tile."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.closest import ClosestPrimitive, as_primitives
from nurbs_ooc.measure.vertex_stars import VertexStars

Indices = npt.NDArray[np.int64]


class DrawnTile:
    """Triangles, lines and points in float64.

    Args:
        positions: (v, 3) mm.
        triangles, lines, points: (t, 3), (l, 2) and (p,) rows of them.
    """

    def __init__(self, positions: npt.NDArray[np.float64], triangles: Indices, lines: Indices, points: Indices) -> None:
        self.positions, self.triangles, self.lines, self.points = positions, triangles, lines, points
        self._lock = threading.Lock()
        self._tree: ClosestPrimitive | None = None
        self._stars: VertexStars | None = None

    @property
    def n_primitives(self) -> int:
        """How many triangles, lines and points it draws."""
        return len(self.triangles) + len(self.lines) + len(self.points)

    @property
    def tree(self) -> ClosestPrimitive:
        """Measures distances to it."""
        with self._lock:
            if self._tree is None:
                self._tree = ClosestPrimitive(self.positions, as_primitives(self.triangles, self.lines, self.points))
            return self._tree

    @property
    def stars(self) -> VertexStars:
        """Neighbours of its triangles."""
        with self._lock:
            if self._stars is None:
                self._stars = VertexStars(self.triangles)
            return self._stars


class RecentTiles:
    """The tiles that were asked for last, for several threads.

    Args:
        load: makes the tile of a name.
        kept: how many stay; jobs on a tile follow one another, so a few more than there are threads.
    """

    def __init__(self, load: Callable[[str], DrawnTile], kept: int) -> None:
        self._load, self._most = load, kept
        self._kept: OrderedDict[str, DrawnTile] = OrderedDict()
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> DrawnTile:
        with self._lock:
            tile = self._kept.get(name)
        if tile is None:
            tile = self._load(name)
        with self._lock:
            tile = self._kept.setdefault(name, tile)
            self._kept.move_to_end(name)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return tile
