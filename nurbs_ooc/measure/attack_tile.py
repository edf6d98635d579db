"""Attack one stored tile: the placed surfaces it stands for against what it draws, in both directions.

Every sample of every surface must be within the tile's error of a drawn triangle, line or point, and
every drawn vertex, and every point of a drawn triangle or line, within it of one of the surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nurbs_ooc.measure.ascent import climb
from nurbs_ooc.measure.certify_far import nowhere_near
from nurbs_ooc.measure.closest import ClosestPrimitive, as_primitives
from nurbs_ooc.measure.mesh_sampler import sample_triangles
from nurbs_ooc.measure.sampled_part import SampledPart, SampledParts
from nurbs_ooc.measure.trim_region import inside_for_sure
from nurbs_ooc.measure.violation import Violation

MAX_PLACED = 1_500_000  # samples measured against one tile; surfaces of a tile that has more get fewer each
CLIMBERS = 12  # worst samples per part and tile that climb
MAX_DRAWN = 60_000  # vertices measured back, and points of triangles
EXAMINED = 200  # drawn points that seem too far are proven so one by one, worst first
ENOUGH = 3  # violations of one tile in this direction
TRIED_ITEMS = 40  # surfaces on which a foot is sought for each of these
FINER = 1e-3
ROUNDING = 64 * np.finfo(float).eps

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PlacedSurfaces:
    """The surfaces a tile stands for: (n,) part and row in the part, (n, 3, 4) placement in the tile's space."""

    part: Indices
    row: Indices
    transform: Floats

    def __len__(self) -> int:
        return len(self.part)


@dataclass(frozen=True, eq=False)
class DrawnTile:
    """What a tile draws, in float64: positions (v, 3), and rows in them of triangles, lines and points."""

    positions: Floats
    triangles: Indices
    lines: Indices
    points: Indices

    @property
    def n_primitives(self) -> int:
        """How many triangles, lines and points it draws."""
        return len(self.triangles) + len(self.lines) + len(self.points)


@dataclass(eq=False)
class TileFinding:
    """What the attack on one tile measured (mm) and what it broke."""

    n_samples: int = 0
    surface_to_tile: float = 0.0
    tile_to_surface: float = 0.0
    undecided: int = 0
    skipped_surfaces: int = 0
    violations: list[Violation] = field(default_factory=list)

    @property
    def measured(self) -> float:
        """Larger of the two directions."""
        return max(self.surface_to_tile, self.tile_to_surface)


def attack_tile(
    parts: SampledParts, items: PlacedSurfaces, tile: DrawnTile, limit: float, where: str, row: int, seed: int = 0
) -> TileFinding:
    """Measure a tile against its surfaces.

    Args:
        parts: the store's parts with samples.
        items: every surface the tile stands for.
        tile: what it draws.
        limit: mm; the error it promises.
        where: names the tile in violations.
        row: likewise.
        seed: of the points drawn from its triangles.
    """
    return _TileAttack(parts, items, tile, limit, where, row, seed).run()


class _TileAttack:
    def __init__(
        self, parts: SampledParts, items: PlacedSurfaces, tile: DrawnTile, limit: float, where: str, row: int, seed: int
    ) -> None:
        self.parts, self.items, self.tile, self.promised = parts, items, tile, limit
        self.where, self.row = where, row
        self.rng = np.random.default_rng([seed, row & 0x7FFFFFFF])
        self.finding = TileFinding()
        self.limit = limit + ROUNDING * float(np.abs(tile.positions).max(initial=0.0))
        self.tree = ClosestPrimitive(tile.positions, as_primitives(tile.triangles, tile.lines, tile.points))

    def run(self) -> TileFinding:
        if not self.tile.n_primitives:
            self.finding.violations.append(Violation(self.where, self.row, "lost"))
            return self.finding
        placed = [self._surfaces_of_part(part) for part in np.unique(self.items.part)]
        self._tile_to_surface(placed)
        return self.finding

    # From the surfaces to the tile.

    def _surfaces_of_part(self, part: int) -> tuple[Indices, Indices, Floats]:
        """Measure one part's placed samples; returns their item, sample and place for the way back."""
        sampled = self.parts[part]
        own = np.flatnonzero(self.items.part == part)
        face = sampled.face_of_row[self.items.row[own]]
        self.finding.skipped_surfaces += int((face < 0).sum())
        own, face = own[face >= 0], face[face >= 0]
        item, sample = _expand(own, sampled.first[face], sampled.first[face + 1], MAX_PLACED // max(1, len(self.items)))
        place = _placed(self.items.transform[item], sampled.samples.points[sample])
        distance, _ = self.tree.query(place)
        self.finding.n_samples += len(distance)
        top = np.argsort(-distance, kind="stable")[:CLIMBERS]
        if len(top):
            self._climb(sampled, item[top], sample[top], distance[top])
        return item, sample, place

    def _climb(self, sampled: SampledPart, item: Indices, sample: Indices, distance: Floats) -> None:
        region, samples, transform = sampled.region, sampled.samples, self.items.transform[item]
        face, begin = samples.face[sample], samples.uv[sample]
        step = (region.bounds[face, 2:] - region.bounds[face, :2]) / 8.0

        def measure(start: Indices, p: Floats) -> Floats:
            self.finding.n_samples += len(start)
            return self.tree.query(_placed(transform[start], p))[0]

        uv, value = climb(region, face, begin, distance, step, measure)
        over = np.flatnonzero((value > self.limit) & ~(samples.on_boundary[sample] & (value == distance)))
        fine = np.full(len(over), FINER * sampled.tolerance)
        sure = inside_for_sure(sampled.geometry, region.faces[face[over]], uv[over], fine)
        value[over[~sure]] = -np.inf  # climbed out between two segments of the boundary
        worst = int(np.argmax(value))
        if value[worst] > self.limit:
            p = _placed(transform[[worst]], sampled.points(face[[worst]], uv[[worst]]))[0]
            self._record("surface to mesh", value[worst], p, sampled, face[worst], uv[worst])
        self.finding.surface_to_tile = max(self.finding.surface_to_tile, float(value[worst]))

    # From the tile to the surfaces.

    def _tile_to_surface(self, placed: list[tuple[Indices, Indices, Floats]]) -> None:
        item, sample, place = (np.concatenate(x) for x in zip(*placed, strict=True))
        if not len(item):
            return
        p = self._drawn_points()
        seeds = ClosestPrimitive(place, np.repeat(np.arange(len(place))[:, None], 3, axis=1))
        distance, nearest = seeds.query(p)
        self.finding.n_samples += len(p)
        at = item[nearest]
        for part in np.unique(self.items.part[at]):
            own = np.flatnonzero(self.items.part[at] == part)
            hint = self.parts[part].samples.uv[sample[nearest[own]]]
            distance[own] = np.minimum(distance[own], self._feet(part, at[own], p[own], hint))
        far = np.flatnonzero(distance > self.limit)
        self.finding.tile_to_surface = float(distance[distance <= self.limit].max(initial=0.0))
        before = len(self.finding.violations)
        self.finding.undecided += max(0, len(far) - EXAMINED)
        for k in far[np.argsort(-distance[far], kind="stable")][:EXAMINED]:
            self._examine(p[k], float(distance[k]), item, place)
            if len(self.finding.violations) >= before + ENOUGH:
                break

    def _drawn_points(self) -> Floats:
        """Vertices in use, middles of lines, and points of triangles."""
        tile, rng = self.tile, self.rng
        used = np.unique(np.concatenate([tile.triangles.ravel(), tile.lines.ravel(), tile.points]))
        if len(used) > MAX_DRAWN:
            used = np.sort(rng.choice(used, MAX_DRAWN, replace=False))
        drawn = [tile.positions[used], tile.positions[tile.lines].mean(1)[:MAX_DRAWN]]
        if len(tile.triangles):
            corner = tile.positions[tile.triangles]
            areas = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
            n = min(MAX_DRAWN, 4 * len(areas))
            _, triangle, weight = sample_triangles(areas, np.array([0, len(areas)]), n, rng)
            drawn.append(np.einsum("nk,nki->ni", weight, corner[triangle]))
        return np.concatenate(drawn)

    def _feet(self, part: int, item: Indices, p: Floats, hint: Floats | None) -> Floats:
        """Distances (upper bounds) of points to one placed surface each, all of one part."""
        sampled, transform = self.parts[part], self.items.transform[item]
        face = sampled.face_of_row[self.items.row[item]]
        moved = (p - transform[:, :, 3])[:, :, None]
        local: Floats = np.asarray(np.linalg.solve(transform[:, :, :3], moved)[:, :, 0], np.float64)
        stretch = np.linalg.norm(transform[:, :, :3], axis=1).max(1)
        within: Floats = np.full(len(item), self.limit)
        within /= stretch
        uv, _ = sampled.finder.find(face, local, hint, within)
        distance: Floats = np.linalg.norm(_placed(transform, sampled.points(face, uv)) - p, axis=1)
        return distance

    def _examine(self, p: Floats, distance: float, item: Indices, place: Floats) -> None:
        """Seek a foot on other surfaces; if there is none, prove that there cannot be."""
        nearest = np.full(len(self.items), np.inf)
        np.minimum.at(nearest, item, np.linalg.norm(place - p, axis=1))
        order = np.argsort(nearest, kind="stable")
        order = order[np.isfinite(nearest[order])]
        for i in order[:TRIED_ITEMS]:
            part = int(self.items.part[i])
            distance = min(distance, float(self._feet(part, np.array([i]), p[None], None)[0]))
            if distance <= self.limit:
                self.finding.tile_to_surface = max(self.finding.tile_to_surface, distance)
                return
        for i in order:
            if nearest[i] <= self.limit + self._reach(int(i)) and not self._proven_far(int(i), p):
                self.finding.undecided += 1
                return
        self.finding.tile_to_surface = max(self.finding.tile_to_surface, distance)
        self._record("mesh to surface", distance, p)

    def _reach(self, i: int) -> float:
        """Size of a placed surface by its samples, doubled: farther than this from them is far from it."""
        sampled = self.parts[int(self.items.part[i])]
        face = sampled.face_of_row[self.items.row[i]]
        own = sampled.samples.points[sampled.first[face] : sampled.first[face + 1]]
        scale = np.linalg.norm(self.items.transform[i][:, :3], 2)
        return 2.0 * float(scale * np.linalg.norm(np.ptp(own, axis=0)))

    def _proven_far(self, i: int, p: Floats) -> bool:
        sampled, transform = self.parts[int(self.items.part[i])], self.items.transform[i]
        face = int(sampled.face_of_row[self.items.row[i]])
        local = np.linalg.solve(transform[:, :3], p - transform[:, 3])
        shrink = np.linalg.svd(transform[:, :3], compute_uv=False).min()
        return nowhere_near(sampled.region, face, local, self.limit / float(shrink))

    def _record(
        self,
        kind: str,
        value: float,
        p: Floats,
        sampled: SampledPart | None = None,
        face: int = -1,
        uv: Floats | None = None,
    ) -> None:
        where, at = self.where, None
        if sampled is not None and uv is not None:
            row = int(sampled.region.faces[face])
            source = int(sampled.geometry.surfaces["source"][row])
            name = sampled.geometry.sources[source] if 0 <= source < len(sampled.geometry.sources) else ""
            where, at = f"{where}, face {row} {name}".rstrip(), (float(uv[0]), float(uv[1]))
        place = (float(p[0]), float(p[1]), float(p[2]))
        self.finding.violations.append(Violation(where, self.row, kind, float(value), self.promised, at, place))


def _placed(transform: Floats, p: Floats) -> Floats:
    """(n, 3) points under (n, 3, 4) placements."""
    out: Floats = np.einsum("nij,nj->ni", transform[:, :, :3], p) + transform[:, :, 3]
    return out


def _expand(item: Indices, first: Indices, last: Indices, most: int) -> tuple[Indices, Indices]:
    """Item and sample of all samples first..last of every item, thinned evenly to ``most`` each, but never below 8."""
    counts = np.minimum(last - first, max(8, most))
    which = np.repeat(np.arange(len(item)), counts)
    rank = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    stretch = (last - first)[which] / counts[which]
    return item[which], first[which] + (rank * stretch).astype(np.int64)
