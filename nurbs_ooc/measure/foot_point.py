"""Feet of points on trimmed faces: the witnesses that a drawn point is near its surface.

A foot found is a proof that the distance is no larger; that none was found proves nothing. So feet are
sought from several seeds on the surface and along the boundary, and what is still too far then goes
to ``nowhere_near`` of ``certify_far``.

Source: K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares Problems, 2004,
section 3.2 (Levenberg-Marquardt), with steps clamped to the face's parameter box.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_ooc.measure.closest import ClosestPrimitive
from nurbs_ooc.measure.exact_curve import MAX_DEGREE, curve_point
from nurbs_ooc.measure.exact_surface import points, surface_point
from nurbs_ooc.measure.face_sampler import SampleSet
from nurbs_ooc.measure.trim_region import TrimRegion

MAX_STEPS = 60
SHRINK, GROW = 0.2, 6.0  # of the damping, after a good and a bad step
FIRST_SHARES = 7  # points of a boundary segment that are tried: it is nearly straight
SLIDES = 8  # steps from the best of them


@helper
def _offset2(p, s):  # type: ignore[no-untyped-def]
    return (s[0] - p[0]) ** 2 + (s[1] - p[1]) ** 2 + (s[2] - p[2]) ** 2


@kernel
def _descend(surfaces, curves, values, rows, bounds, p, uv, distance):  # type: ignore[no-untyped-def]
    """Move each ``uv`` downhill to a local foot of ``p``, inside its box; ``distance`` gets what is left."""
    scratch = np.empty((3, 2, MAX_DEGREE + 1))
    s, trial = np.empty((3, 3)), np.empty((3, 3))
    step, at, goal, zero = np.empty(2), np.empty(2), np.empty(2), np.zeros(3)
    for i in range(len(rows)):
        box = bounds[i]
        for k in range(2):
            at[k] = min(box[2 + k], max(box[k], uv[i, k]))
        surface_point(surfaces, curves, values, rows[i], at[0], at[1], scratch, s)
        d2 = _offset2(p[i], s[0])
        damping = 1e-4
        for _ in range(MAX_STEPS):
            a, b, c, g, h = 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                r = p[i, k] - s[0, k]
                a += s[1, k] * s[1, k]
                b += s[1, k] * s[2, k]
                c += s[2, k] * s[2, k]
                g += s[1, k] * r
                h += s[2, k] * r
            # A coordinate that would leave the box is held.
            hold_u = (at[0] <= box[0] and g <= 0.0) or (at[0] >= box[2] and g >= 0.0) or a == 0.0
            hold_v = (at[1] <= box[1] and h <= 0.0) or (at[1] >= box[3] and h >= 0.0) or c == 0.0
            if hold_u and hold_v:
                break
            a, c = a * (1.0 + damping), c * (1.0 + damping)
            det = a * c - b * b
            if hold_u or hold_v or det <= 1e-14 * a * c:
                step[0] = 0.0 if hold_u else g / a
                step[1] = 0.0 if hold_v else h / c
            else:
                step[0], step[1] = (c * g - b * h) / det, (a * h - b * g) / det
            for k in range(2):
                goal[k] = min(box[2 + k], max(box[k], at[k] + step[k]))
            surface_point(surfaces, curves, values, rows[i], goal[0], goal[1], scratch, trial)
            better = _offset2(p[i], trial[0])
            if better < d2:
                moved = _offset2(s[0], trial[0])
                small = moved <= 1e-31 * _offset2(zero, s[0]) or d2 - better <= 1e-13 * d2
                d2 = better
                at[:] = goal
                s[:] = trial
                damping = max(1e-12, damping * SHRINK)
                if small:
                    break
            else:
                damping *= GROW
                if damping > 1e9:
                    break
        uv[i, 0], uv[i, 1] = at[0], at[1]
        distance[i] = np.sqrt(d2)


@helper
def _on_segment(surfaces, curves, values, coedges, segment, row, share, work):  # type: ignore[no-untyped-def]
    """Point of the exact boundary curve at ``share`` of a segment: uv in ``on[0]``, S in ``s[0]``, dS in ``along``."""
    scratch, on, s, along = work
    if segment.coedge >= 0:
        t = segment.t0 + share * (segment.t1 - segment.t0)
        curve_point(values, curves[coedges[segment.coedge].pcurve], t, scratch[0], on)
        for j in range(2):
            on[1, j] *= segment.t1 - segment.t0
    else:
        for j in range(2):
            on[1, j] = segment.uv1[j] - segment.uv0[j]
            on[0, j] = segment.uv0[j] + share * on[1, j]
    surface_point(surfaces, curves, values, row, on[0, 0], on[0, 1], scratch, s)
    for k in range(3):
        along[k] = on[1, 0] * s[1, k] + on[1, 1] * s[2, k]


@kernel
def _slide(surfaces, curves, values, coedges, segments, rows, at_segment, p, uv, distance):  # type: ignore[no-untyped-def]
    """Foot of ``p`` on the exact boundary curve over one segment: the best of a few, then Gauss-Newton steps."""
    on, s, along = np.zeros((2, 3)), np.empty((3, 3)), np.empty(3)
    work = (np.empty((3, 2, MAX_DEGREE + 1)), on, s, along)
    for i in range(len(rows)):
        segment = segments[at_segment[i]]
        best, share, step = np.inf, 0.0, 0.0
        for k in range(FIRST_SHARES + SLIDES):
            if k < FIRST_SHARES:
                trial = k / (FIRST_SHARES - 1)
            else:
                # Step from the best point so far; after a bad step, only half as far.
                trial = min(1.0, max(0.0, share + step))
            _on_segment(surfaces, curves, values, coedges, segment, rows[i], trial, work)
            d2 = _offset2(p[i], s[0])
            if d2 < best:
                best, share = d2, trial
                uv[i, 0], uv[i, 1] = on[0, 0], on[0, 1]
                up, down = 0.0, 0.0
                for j in range(3):
                    up += (p[i, j] - s[0, j]) * along[j]
                    down += along[j] * along[j]
                step = up / down if down > 0.0 else 0.0
            elif k >= FIRST_SHARES:
                step *= 0.5
        distance[i] = np.sqrt(best)


Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class FootFinder:
    """Finds points of trimmed faces near given points.

    Args:
        region: the faces.
        samples: points of the faces, as seeds; in ascending order of face.
    """

    def __init__(self, region: TrimRegion, samples: SampleSet) -> None:
        self.region, self.samples = region, samples
        n = len(region.faces)
        self._seeds = ClosestPrimitive(
            samples.points, np.repeat(np.arange(len(samples))[:, None], 3, 1), samples.face, n
        )
        segments = region.segments
        of = np.repeat(np.arange(n), np.diff(region.start))
        rows = region.faces[of]
        ends = [points(region.geometry, rows, segments[name]) for name in ("uv0", "uv1")]
        m = len(segments)
        chords = np.stack([np.arange(m), np.arange(m) + m, np.arange(m) + m], 1)
        self._chords = ClosestPrimitive(np.concatenate(ends), chords, of, n)

    def descend(self, face: Indices, p: Floats, seed_uv: Floats) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
        """Local feet from the seeds: their (n, 2) parameters, the distances, and whether each is inside its face."""
        g = self.region.geometry
        uv, distance = np.array(seed_uv, float), np.empty(len(face))
        tables = (g.surfaces, g.curves, g.values, self.region.faces[face], self.region.bounds[face])
        _descend(*tables, np.ascontiguousarray(p), uv, distance)
        return uv, distance, self.region.contains(face, uv)

    def on_boundary(self, face: Indices, p: Floats) -> tuple[Floats, Floats]:
        """Feet on the boundary curves: (n, 2) parameters and distances; the nearest segment is searched."""
        g = self.region.geometry
        _, segment = self._chords.query(p, face)
        uv, distance = np.full((len(face), 2), np.nan), np.full(len(face), np.inf)
        some = np.flatnonzero(segment >= 0)
        found_uv, found = np.empty((len(some), 2)), np.empty(len(some))
        tables = (g.surfaces, g.curves, g.values, g.coedges, self.region.segments, self.region.faces[face[some]])
        _slide(*tables, segment[some], np.ascontiguousarray(p[some]), found_uv, found)
        uv[some], distance[some] = found_uv, found
        return uv, distance

    def find(self, face: Indices, p: Floats, hint_uv: Floats | None, limit: Floats) -> tuple[Floats, Floats]:
        """Feet of (n, 3) points on their faces: (n, 2) parameters and distances (upper bounds of the true ones).

        Args:
            face: (n,) indices into the region's faces.
            p: (n, 3), mm.
            hint_uv: (n, 2) where to begin, or None; the nearest sample is tried whenever it is nearer.
            limit: (n,) mm; only points that seem farther than this cost a search from more seeds.
        """
        rows = self.region.faces[face]
        distance, nearest = self._seeds.query(p, face)
        uv = self.samples.uv[np.maximum(nearest, 0)]
        if hint_uv is not None:
            hinted = np.linalg.norm(points(self.region.geometry, rows, hint_uv) - p, axis=1)
            uv = np.where((hinted < distance)[:, None], hint_uv, uv)
        best_uv, best = self.samples.uv[np.maximum(nearest, 0)].copy(), distance
        self._improve(face, p, uv, best_uv, best)
        edge = np.flatnonzero(best > 0.0)
        edge_uv, at_edge = self.on_boundary(face[edge], p[edge])
        nearer = at_edge < best[edge]
        best[edge[nearer]], best_uv[edge[nearer]] = at_edge[nearer], edge_uv[nearer]
        far = np.flatnonzero(best > limit)
        seeds = [self._at_seam(face[far], best_uv[far], at_end) for at_end in (False, True)]
        seeds += self._more_seeds(face[far], p[far])
        for seed in seeds:
            sub_uv, sub = best_uv[far], best[far]
            self._improve(face[far], p[far], seed, sub_uv, sub)
            best_uv[far], best[far] = sub_uv, sub
        return best_uv, best

    def _at_seam(self, face: Indices, uv: Floats, at_end: bool) -> Floats:
        """Parameters moved to the start or the end of what is periodic: a search does not cross a seam by itself."""
        surfaces = self.region.geometry.surfaces[self.region.faces[face]]
        other = uv.copy()
        for k, (low, high, period) in enumerate((("u0", "u1", "u_period"), ("v0", "v1", "v_period"))):
            side = surfaces[high if at_end else low]
            other[:, k] = np.where(surfaces[period] > 0.0, side, uv[:, k])
        return other

    def _improve(self, face: Indices, p: Floats, seed: Floats, best_uv: Floats, best: Floats) -> None:
        uv, d, inside = self.descend(face, p, seed)
        better = inside & (d < best)
        best_uv[better], best[better] = uv[better], d[better]

    def _more_seeds(self, face: Indices, p: Floats, n: int = 12) -> list[Floats]:
        """``n`` further seeds for every point: near samples of its face, then ever farther ones."""
        seeds = np.empty((n, len(face), 2))
        start = np.searchsorted(self.samples.face, np.arange(len(self.region.faces) + 1))
        for i, f in enumerate(face):
            own = slice(start[f], start[f + 1])
            order = np.argsort(((self.samples.points[own] - p[i]) ** 2).sum(1))
            if len(order) == 0:
                seeds[:, i] = self.region.bounds[f, :2]
                continue
            ranks = np.minimum(
                np.concatenate([np.arange(1, n // 2 + 1), 2 ** np.arange(3, 3 + n - n // 2)]), len(order) - 1
            )
            seeds[:, i] = self.samples.uv[own][order[ranks]]
        return list(seeds)
