"""Random trimmed faces, the same for the same seed: any degree to 15, any knots, wild weights, loops with holes.

``fuzz_batch(seed, n)`` makes one part; a face is known by its seed and row, and says in its source name
what it is. Boundaries are lines and quadratic curves in (u, v); their edges in space are cubics through
33 points of the surface, and what these miss is a gap as real files have it, stated as tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.geometry import interpolation
from nurbs_ooc.geometry.builder import BatchBuilder, Coedge
from nurbs_ooc.geometry.forms import CurveForm, SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop

Array = npt.NDArray[np.float64]

SIZE = 10.0  # mm, of most faces
ERROR = 0.2  # mm, the chord error that is asked for
HIGHEST_DEGREE = 15
WEIGHT_DECADES = 4.0  # wild weights are 10^-4 .. 10^4
EDGE_NODES = 33
CROSSING = ", crossing"  # in the name of a face one of whose loops crosses itself


@dataclass(frozen=True)
class Kinds:
    """Shares of what the faces are made of; each face is drawn by itself.

    Attributes:
        wild_weights: of the rational faces: weights over eight decades instead of a factor of four.
        rational, trimmed, tangled, collapsed, closed: of all faces.
        bent: of the sides of loops: quadratic instead of straight.
        crossing: of the holes: their corners are shuffled, so that the loop crosses itself.
        lowest_degree: of all surfaces.
    """

    rational: float = 0.5
    wild_weights: float = 0.5
    trimmed: float = 0.6
    tangled: float = 0.15
    collapsed: float = 0.1
    closed: float = 0.1
    bent: float = 0.4
    crossing: float = 0.04
    lowest_degree: int = 1


ALL_KINDS = Kinds()


def fuzz_batch(seed: int, n: int, kinds: Kinds = ALL_KINDS) -> GeometryBatch:
    """``n`` random faces as one part; face i depends on (seed, i) alone."""
    builder = BatchBuilder()
    for i in range(n):
        rng = np.random.default_rng([seed, i, 0xF022])
        form, name = _surface(rng, kinds)
        if rng.random() < kinds.trimmed:
            rings, crossing = _rings(rng, kinds)
            name += f", {len(rings)} loops" + (CROSSING if crossing else "")
            low, size = np.array([form.u0, form.v0]), np.array([form.u1 - form.u0, form.v1 - form.v0])
            corners = low + np.concatenate(rings) * size
            (u0, v0), (u1, v1) = corners.min(axis=0), corners.max(axis=0)
            builder.surface(form.over(u0, u1, v0, v1), source=f"seed {seed} face {i}: {name}")
            for k, ring in enumerate(rings):
                _loop(builder, form, ring, (low, size), rng, kinds.bent if k else 0.0)
        else:
            builder.surface(form, source=f"seed {seed} face {i}: {name}")
            builder.loop(natural_loop(builder, form))
    return builder.build()


def _knots(rng: np.random.Generator, degree: int, n_inner: int) -> Array:
    """Clamped knots: even, clustered at one place, or repeated; over some range or other."""
    inner = np.sort(rng.random(n_inner))
    kind = rng.integers(0, 3)
    if kind == 1:
        inner = np.sort(
            np.clip(rng.random() + 10.0 ** rng.uniform(-9, -1, n_inner) * rng.choice([-1, 1], n_inner), 0, 1)
        )
    elif kind == 2 and n_inner:
        inner = np.sort(rng.choice(inner, n_inner))
    low, length = rng.choice([0.0, -3.0, 1e3]), 10.0 ** rng.uniform(-3, 3)
    knots = low + length * np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    return _at_most(knots, degree)


def _at_most(knots: Array, degree: int) -> Array:
    """Inner knots of a multiplicity above ``degree``, or on the ends, are left out."""
    kept: list[float] = []
    for t in knots[degree + 1 : -degree - 1]:
        if knots[0] < t < knots[-1] and kept.count(t) < degree:
            kept.append(float(t))
    return np.concatenate([knots[: degree + 1], kept, knots[-degree - 1 :]])


def _surface(rng: np.random.Generator, kinds: Kinds) -> tuple[SurfaceForm, str]:
    p, q = (int(x) for x in rng.integers(kinds.lowest_degree, HIGHEST_DEGREE + 1, 2))
    knots_u, knots_v = _knots(rng, p, int(rng.integers(0, 5))), _knots(rng, q, int(rng.integers(0, 5)))
    n_u, n_v = len(knots_u) - p - 1, len(knots_v) - q - 1
    name = f"degrees {p} x {q}, {n_u} x {n_v} points"
    if rng.random() < kinds.tangled:
        points = SIZE * rng.random((n_u, n_v, 3))
        name += ", tangled"
    else:
        points = np.empty((n_u, n_v, 3))
        x, y = np.linspace(0, SIZE, n_u), np.linspace(0, SIZE * 10.0 ** rng.uniform(-3, 0), n_v)
        points[..., 0], points[..., 1] = x[:, None], y[None, :]
        points[..., 2] = 10.0 ** rng.uniform(-2, 0.5) * rng.normal(size=(n_u, n_v))
        points[..., :2] += rng.normal(size=(n_u, n_v, 2)) * 0.1 * np.array([x[1], y[1]])
    if rng.random() < kinds.collapsed:
        points[0] = points[0, 0]
        name += ", collapsed"
    elif rng.random() < kinds.closed and n_v > 3:
        points[:, -1] = points[:, 0]
        name += ", closed"
    weights = None
    if rng.random() < kinds.rational:
        wild = rng.random() < kinds.wild_weights
        decades = WEIGHT_DECADES if wild else 0.3
        weights = 10.0 ** rng.uniform(-decades, decades, (n_u, n_v))
        if "closed" in name:
            weights[:, -1] = weights[:, 0]
        name += ", wild weights" if wild else ", rational"
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return SurfaceForm.nurbs(p, q, knots_u, knots_v, points @ turn + 100.0 * rng.normal(size=3), weights), name


def _points(form: SurfaceForm, uv: Array) -> Array:
    """(n, 3) points at (u, v), by scipy's basis."""
    u = np.clip(uv[:, 0], form.knots_u[0], form.knots_u[-1])
    v = np.clip(uv[:, 1], form.knots_v[0], form.knots_v[-1])
    in_u = BSpline.design_matrix(u, form.knots_u, form.degree_u).toarray()
    in_v = BSpline.design_matrix(v, form.knots_v, form.degree_v).toarray()
    rows = np.einsum("ni,nj,ijk->nk", in_u, in_v, form.points, optimize=True)
    return np.asarray(rows[:, :3] / rows[:, 3:] if form.rational else rows)


def _star(rng: np.random.Generator, centre: Array, radius: float) -> Array:
    """A star-shaped polygon of 4 to 9 corners; its sides keep a fifth of ``radius`` from the centre."""
    n = int(rng.integers(4, 10))
    turn = 2.0 * np.pi * (np.arange(n) + 0.3 * rng.random(n)) / n + 7.0 * rng.random()
    reach = radius * rng.uniform(0.4, 1.0, n)
    return np.asarray(centre + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def _rings(rng: np.random.Generator, kinds: Kinds) -> tuple[list[Array], bool]:
    """Loops in the unit square: an outer one, holes in a 3 x 3 raster inside it, now and then an island in a hole.

    Returns:
        (n, 2) corners of each, and whether one of them crosses itself.
    """
    crossing = False
    if rng.random() < 0.5:
        rings, reach = [np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])], 0.33
    else:
        rings, reach = [_star(rng, np.array([0.5, 0.5]), 0.5)], 0.05
    for cell in rng.permutation(9)[: int(rng.integers(0, 5))]:
        centre = 0.5 + reach * (np.array([cell % 3, cell // 3]) - 1.0)
        radius = 0.45 * reach
        rings.append(_star(rng, centre, radius)[::-1])
        if rng.random() < kinds.crossing:
            rng.shuffle(rings[-1])
            crossing = True
        if rng.random() < 0.2:
            rings.append(_star(rng, centre, 0.2 * radius))
    return rings, crossing


def _loop(
    builder: BatchBuilder,
    form: SurfaceForm,
    unit: Array,
    box: tuple[Array, Array],
    rng: np.random.Generator,
    bent: float,
) -> None:
    """One loop through corners given in the unit square, its sides straight or quadratic."""
    low, size = box
    ring = low + unit * size
    nodes = interpolation.nodes(EDGE_NODES)
    between = 0.5 * (nodes[1:] + nodes[:-1])
    t = np.concatenate([nodes, between])
    vertices = [builder.vertex(p) for p in _points(form, ring)]
    coedges = []
    for i, start in enumerate(ring):
        end = ring[(i + 1) % len(ring)]
        pcurve = CurveForm.line(start, end)
        uv = start + t[:, None] * (end - start)
        if rng.random() < bent:
            side = (end - start) / size
            middle = 0.5 * (start + end) + rng.uniform(-0.1, 0.1) * size * side[::-1] * [1.0, -1.0]
            pcurve = CurveForm.nurbs(2, np.array([0, 0, 0, 1, 1, 1.0]), np.stack([start, middle, end]))
            uv = ((1 - t) ** 2)[:, None] * start + (2 * t * (1 - t))[:, None] * middle + (t**2)[:, None] * end
        points = _points(form, uv)
        curve = interpolation.through(points[:EDGE_NODES])
        basis = BSpline.design_matrix(between, curve.knots, curve.degree).toarray()
        gap = float(np.linalg.norm(basis @ curve.points - points[EDGE_NODES:], axis=1).max())
        edge = builder.edge(curve, vertices[i], vertices[(i + 1) % len(ring)], gap)
        coedges.append(Coedge(edge, pcurve))
    builder.loop(coedges)


def without(kinds: Kinds, *names: str) -> Kinds:
    """The same shares with some set to none."""
    return replace(kinds, **dict.fromkeys(names, 0.0))
