"""Hand-made one-face geometry and meshes with a known error, for attacking the attacker."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import (
    COEDGE_DTYPE,
    CURVE_DTYPE,
    EDGE_DTYPE,
    LOOP_DTYPE,
    SURFACE_DTYPE,
    CurveKind,
    GeometryBatch,
    SurfaceKind,
)
from nurbs_ooc.tessellation.mesh import MeshBatch

Floats = npt.NDArray[np.float64]


class Shape:
    """Collects records and numbers; ``batch()`` gives the geometry."""

    def __init__(self) -> None:
        self.surfaces: list[dict[str, object]] = []
        self.curves: list[dict[str, object]] = []
        self.loops: list[tuple[int, int]] = []
        self.coedges: list[dict[str, object]] = []
        self.values: list[float] = []

    def pool(self, numbers: npt.ArrayLike) -> int:
        start = len(self.values)
        self.values.extend(np.asarray(numbers, float).ravel().tolist())
        return start

    def curve(self, net: npt.ArrayLike, degree: int, knots: npt.ArrayLike, dim: int, rational: bool = False) -> int:
        points, knots = np.asarray(net, float), np.asarray(knots, float)
        n = len(points)
        record = {"kind": CurveKind.NURBS, "dim": dim, "rational": rational, "degree": degree, "n": n}
        record |= {"knots": self.pool(knots), "points": self.pool(points), "t0": knots[degree], "t1": knots[n]}
        self.curves.append(record)
        return len(self.curves) - 1

    def conic(
        self, kind: CurveKind, centre: npt.ArrayLike, a: npt.ArrayLike, b: npt.ArrayLike, t0: float, t1: float
    ) -> int:
        points = np.stack([np.asarray(x, float) for x in (centre, a, b)])
        self.curves.append({"kind": kind, "dim": points.shape[1], "points": self.pool(points), "t0": t0, "t1": t1})
        return len(self.curves) - 1

    def loop(self, pcurves: list[int]) -> None:
        first = len(self.coedges)
        self.coedges.extend({"edge": -1, "pcurve": p} for p in pcurves)
        self.loops.append((first, len(pcurves)))

    def polygon(self, corners: npt.ArrayLike) -> None:
        at = np.asarray(corners, float)
        self.loop([self.curve([at[i], at[(i + 1) % len(at)]], 1, [0, 0, 1, 1], 2) for i in range(len(at))])

    def analytic(self, kind: SurfaceKind, domain: tuple[float, float, float, float], **more: object) -> int:
        frame = np.concatenate(
            [
                np.array(more.pop(k, d), float)
                for k, d in (("origin", (0, 0, 0)), ("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1)))
            ]
        )
        numbers = np.concatenate([frame, [float(more.pop("a", 0.0)), float(more.pop("b", 0.0))]])  # type: ignore[arg-type]
        return self._surface(domain, kind=kind, frame=self.pool(numbers), **more)

    def nurbs(self, net: Floats, degrees: tuple[int, int], knots: tuple[Floats, Floats], rational: bool = False) -> int:
        (p, q), (ku, kv) = degrees, knots
        n_u, n_v = net.shape[:2]
        domain = (ku[p], ku[n_u], kv[q], kv[n_v])
        return self._surface(
            domain,
            kind=SurfaceKind.NURBS,
            rational=rational,
            degree_u=p,
            degree_v=q,
            n_u=n_u,
            n_v=n_v,
            knots_u=self.pool(ku),
            knots_v=self.pool(kv),
            points=self.pool(net),
            frame=-1,
        )

    def _surface(self, domain: tuple[float, float, float, float], **record: object) -> int:
        u0, u1, v0, v1 = domain
        first = sum(int(s["n_loops"]) for s in self.surfaces)  # type: ignore[call-overload]
        base: dict[str, object] = {
            "profile": -1,
            "u0": u0,
            "u1": u1,
            "v0": v0,
            "v1": v1,
            "first_loop": first,
            "n_loops": len(self.loops) - first,
        }
        self.surfaces.append(base | record)
        return len(self.surfaces) - 1

    def batch(self) -> GeometryBatch:
        def table(records: list[dict[str, object]], dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
            out = np.zeros(len(records), dtype)
            for i, record in enumerate(records):
                for name, value in record.items():
                    out[name][i] = value
            return out

        return GeometryBatch(
            table(self.surfaces, SURFACE_DTYPE),
            np.array(self.loops, LOOP_DTYPE),
            table(self.coedges, COEDGE_DTYPE),
            np.zeros(0, EDGE_DTYPE),
            table(self.curves, CURVE_DTYPE),
            np.zeros((0, 3)),
            np.asarray(self.values, float),
        )


def sphere(radius: float = 10.0, **more: object) -> GeometryBatch:
    shape = Shape()
    shape.analytic(
        SurfaceKind.SPHERE, (0, 2 * math.pi, -math.pi / 2, math.pi / 2), a=radius, u_period=2 * math.pi, **more
    )
    return shape.batch()


def random_nurbs(
    rng: np.random.Generator, degrees: tuple[int, int], counts: tuple[int, int], rational: bool
) -> GeometryBatch:
    shape = Shape()
    net = np.empty((*counts, 4 if rational else 3))
    net[..., 0], net[..., 1] = np.meshgrid(np.linspace(0, 10, counts[0]), np.linspace(0, 7, counts[1]), indexing="ij")
    net[..., 2] = rng.normal(size=counts)
    if rational:
        w = np.exp(rng.normal(size=counts))
        net[..., :3] *= w[..., None]
        net[..., 3] = w
    knots = []
    for p, n in zip(degrees, counts, strict=True):
        inner = np.sort(rng.choice(np.round(rng.random(n), 2), n - p - 1))
        knots.append(np.concatenate([np.zeros(p + 1), inner, np.ones(p + 1)]))
    shape.nurbs(net, degrees, (knots[0], knots[1]), rational)
    return shape.batch()


def octasphere(radius: float, levels: int) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Octahedron divided ``levels`` times, vertices on the sphere, counter-clockwise from outside."""
    v = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    t = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]])
    for _ in range(levels):
        edges = np.sort(t[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = len(v) + inverse.reshape(-1, 3)
        v = np.concatenate([v, v[unique].mean(1)])
        v /= np.linalg.norm(v, axis=1)[:, None]
        a, b, c = t.T
        ab, bc, ca = middle.T
        t = np.concatenate([np.stack(x, 1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return v * radius, t


def sagitta(radius: float, v: Floats, t: npt.NDArray[np.int64]) -> float:
    """Largest distance of a sphere to triangles with corners on it: radius minus distance of the plane."""
    a, b, c = v[t[:, 0]], v[t[:, 1]], v[t[:, 2]]
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1)[:, None]
    return float(radius - np.abs((n * a).sum(1)).min())


def grid_mesh(geometry: GeometryBatch, nu: int, nv: int, error: float) -> MeshBatch:
    """The first surface's whole domain as a regular grid of triangles."""
    from nurbs_ooc.measure.exact_surface import normals, points

    s = geometry.surfaces[0]
    u, v = np.meshgrid(np.linspace(s["u0"], s["u1"], nu + 1), np.linspace(s["v0"], s["v1"], nv + 1), indexing="ij")
    uv = np.stack([u.ravel(), v.ravel()], 1)
    i = (np.arange(nu)[:, None] * (nv + 1) + np.arange(nv)).ravel()
    t = np.concatenate([np.stack([i, i + nv + 1, i + nv + 2], 1), np.stack([i, i + nv + 2, i + 1], 1)])
    return mesh_of(points(geometry, 0, uv), t, error, uv, normals(geometry, 0, uv))


def mesh_of(
    v: Floats, t: npt.NDArray[np.int64], error: float, uv: Floats | None = None, normal: Floats | None = None
) -> MeshBatch:
    one = np.zeros(1)
    return MeshBatch(
        faces=np.zeros(1, np.int64),
        vertex_start=np.array([0, len(v)]),
        triangle_start=np.array([0, len(t)]),
        segment_start=np.array([0, 0]),
        positions=v,
        normals=normal if normal is not None else v / np.linalg.norm(v, axis=1)[:, None],
        parameters=uv if uv is not None else np.zeros((len(v), 2)),
        triangles=t,
        segments=np.zeros((0, 2), np.int64),
        surface_error=one + error,
        trim_error=one,
        pcurve_error=one,
        status=np.zeros(1, np.uint8),
        reason=np.zeros(1, np.uint16),
    )


def plate_with_hole() -> GeometryBatch:
    """A square of 10 with a round hole of radius 3 in its middle."""
    shape = Shape()
    shape.polygon([[0, 0], [10, 0], [10, 10], [0, 10]])
    shape.loop([shape.conic(CurveKind.ELLIPSE, [5, 5], [3, 0], [0, 3], 0.0, 2.0 * np.pi)])
    shape.analytic(SurfaceKind.PLANE, (0, 10, 0, 10))
    return shape.batch()
