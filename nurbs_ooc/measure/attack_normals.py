"""Attack the promise of normals: interpolated in the triangles against the surfaces' own, at the same parameters.

In both senses: points of the triangles, whose parameters are interpolated like their normals, and points of the
trimmed surfaces, with the triangle that their parameters lie in. The worst of each face climb to worse ones inside
their triangle. What then exceeds the promise is computed again with 50 digits before it counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.ascent import worst_of_each
from nurbs_ooc.measure.closest import ClosestPrimitive
from nurbs_ooc.measure.exact_reference import multiprecision, surface_point
from nurbs_ooc.measure.exact_surface import normals
from nurbs_ooc.measure.face_sampler import SampleSet
from nurbs_ooc.measure.mesh_sampler import sample_triangles
from nurbs_ooc.measure.violation import Violation
from nurbs_ooc.tessellation.mesh import MeshBatch

CLIMBERS = 4  # samples per face that climb
ROUNDS = 24  # each moves them or halves their step
JUDGED = 6  # samples per face that are looked at with 50 digits
NEAREST_CORNER = 1e-5  # of a triangle: poles, where the surface has no normal, are corners
# Directions of steps in barycentric weights.
STEPS = np.array([[1, -1, 0], [-1, 1, 0], [1, 0, -1], [-1, 0, 1], [0, 1, -1], [0, -1, 1.0]])
ROUNDING = 64 * np.finfo(float).eps  # of a coordinate: what the record itself may be off by
DIGITS = 50

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(eq=False)
class NormalReport:
    """Measured against promised, in degrees.

    Attributes:
        largest: (n,) angle between interpolated and exact normal, per face of the mesh.
        mean: of all samples.
        n_samples: angles that were measured.
        violations: what stands after a second look.
    """

    largest: Floats
    mean: float
    n_samples: int
    violations: list[Violation] = field(default_factory=list)


@dataclass(eq=False)
class _Points:
    """Points of triangles: place of the face in the mesh, triangle, barycentric weights (n, 3)."""

    face: Indices
    triangle: Indices
    weight: Floats


def attack_normals(
    geometry: GeometryBatch, mesh: MeshBatch, samples: int = 400, seed: int = 0, found: SampleSet | None = None
) -> NormalReport:
    """Attack ``mesh.normal_error`` of every face; where it was not asked for, angles are measured alone.

    Args:
        geometry: the surfaces the mesh was made of.
        mesh: what ``tessellate`` returned.
        samples: points per face.
        seed: the same seed finds the same.
        found: points of the trimmed surfaces; their ``face`` counts the mesh's faces.
    """
    return _Attack(geometry, mesh).run(samples, seed, found)


class _Attack:
    def __init__(self, geometry: GeometryBatch, mesh: MeshBatch) -> None:
        self.geometry, self.mesh = geometry, mesh
        self.corner = mesh.positions[mesh.triangles]
        n = len(mesh.faces)
        self.limit = mesh.normal_error if len(mesh.normal_error) else np.full(n, np.inf)
        self.report = NormalReport(np.zeros(n), 0.0, 0)

    def run(self, samples: int, seed: int, found: SampleSet | None) -> NormalReport:
        rng = np.random.default_rng([seed, 0x0A31])
        areas = np.linalg.norm(
            np.cross(self.corner[:, 1] - self.corner[:, 0], self.corner[:, 2] - self.corner[:, 0]), axis=1
        )
        face, triangle, weight = sample_triangles(areas, self.mesh.triangle_start, samples, rng)
        inside = weight.max(axis=1) < 1.0 if len(face) else np.zeros(0, bool)
        drawn = _Points(face[inside], triangle[inside], weight[inside])
        self._judge(drawn)
        if found is not None and len(found):
            self._judge(self._in_triangles(found))
        return self.report

    def _judge(self, p: _Points) -> None:
        if not len(p.face):
            return
        angle = self._angles(p)
        before = self.report.n_samples - len(angle)
        self.report.mean = (self.report.mean * before + float(angle.sum())) / self.report.n_samples
        top = worst_of_each(p.face, angle, CLIMBERS)
        worst, value = self._climb(_Points(p.face[top], p.triangle[top], p.weight[top]), angle[top])
        np.maximum.at(self.report.largest, worst.face, value)
        # Relative to what is promised, roundoff allowed for.
        excess = value - self.limit[worst.face] - self._rounding(worst)
        for k in worst_of_each(worst.face, excess, JUDGED):
            if excess[k] > 0.0:
                self._look_again(worst, int(k))

    def _in_triangles(self, s: SampleSet) -> _Points:
        """The triangle, in parameters, of each point of a surface that lies in one."""
        mesh = self.mesh
        of = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.vertex_start))
        low, size = np.zeros((len(mesh.faces), 2)), np.ones((len(mesh.faces), 2))
        for i in np.flatnonzero(np.diff(mesh.vertex_start)):
            own = mesh.parameters[mesh.vertex_start[i] : mesh.vertex_start[i + 1]]
            low[i], size[i] = own.min(axis=0), np.maximum(np.ptp(own, axis=0), 1e-300)
        flat = np.zeros((len(of), 3))
        flat[:, :2] = (mesh.parameters - low[of]) / size[of]
        group = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.triangle_start))
        at = np.zeros((len(s), 3))
        at[:, :2] = (s.uv - low[s.face]) / size[s.face]
        distance, triangle = ClosestPrimitive(flat, mesh.triangles, group, len(mesh.faces)).query(at, s.face)
        rows = np.flatnonzero((distance < 1e-9) & (triangle >= 0))
        a, b, c = (flat[mesh.triangles[triangle[rows], k], :2] for k in range(3))
        p = at[rows, :2]
        with np.errstate(all="ignore"):
            whole = _cross(b - a, c - a)
            weight = (
                np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)], axis=1) / whole[:, None]
            )
        good = np.isfinite(weight).all(axis=1) & (np.abs(whole) > 1e-12)
        weight = np.clip(weight[good], 0.0, None)
        weight /= weight.sum(axis=1)[:, None]
        keep = weight.max(axis=1) < 1.0 - NEAREST_CORNER
        return _Points(s.face[rows[good]][keep], triangle[rows[good]][keep], weight[keep])

    def _angles(self, p: _Points) -> Floats:
        """Degrees; 0 where the surface has no normal."""
        rows = self.mesh.triangles[p.triangle]
        uv = np.einsum("nk,nki->ni", p.weight, self.mesh.parameters[rows])
        drawn = np.einsum("nk,nki->ni", p.weight, self.mesh.normals[rows])
        exact = normals(self.geometry, self.mesh.faces[p.face], uv)
        self.report.n_samples += len(uv)
        length = np.linalg.norm(drawn, axis=1)
        known = (np.linalg.norm(exact, axis=1) > 0.0) & (length > 0.0)
        angle = np.zeros(len(uv))
        chord = np.linalg.norm(drawn[known] / length[known][:, None] - exact[known], axis=1)
        angle[known] = np.degrees(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0)))
        angle[length == 0.0] = 180.0
        return angle

    def _climb(self, p: _Points, value: Floats) -> tuple[_Points, Floats]:
        """Local maxima of the angle inside triangles, away from their corners."""
        weight, value = p.weight.copy(), value.copy()
        step = np.full(len(value), 0.1)
        start = np.repeat(np.arange(len(value)), len(STEPS))
        for _ in range(ROUNDS):
            tried = weight[start] + step[start][:, None] * np.tile(STEPS, (len(value), 1))
            fits = (tried >= 0.0).all(axis=1) & (tried.max(axis=1) <= 1.0 - NEAREST_CORNER)
            angle = np.full(len(start), -1.0)
            angle[fits] = self._angles(_Points(p.face[start[fits]], p.triangle[start[fits]], tried[fits]))
            around = angle.reshape(-1, len(STEPS))
            best = np.argmax(around, axis=1)
            top = around[np.arange(len(value)), best]
            up = top > value
            weight[up], value[up] = tried.reshape(-1, len(STEPS), 3)[up, best[up]], top[up]
            step[~up] *= 0.5
        return _Points(p.face, p.triangle, weight), value

    def _rounding(self, p: _Points) -> Floats:
        """Degrees that roundoff of the record's coordinates may turn a surface so near to a corner, a pole perhaps."""
        corner = self.corner[p.triangle]
        place = np.einsum("nk,nki->ni", p.weight, corner)
        nearest = np.linalg.norm(corner - place[:, None], axis=2).min(axis=1)
        return np.asarray(np.degrees(ROUNDING * np.abs(corner).max(axis=(1, 2)) / np.maximum(nearest, 1e-300)))

    def _look_again(self, p: _Points, k: int) -> None:
        i, rows = int(p.face[k]), self.mesh.triangles[p.triangle[k]]
        row = int(self.mesh.faces[i])
        angle, uv = exact_angle(self.geometry, row, self.mesh.parameters[rows], self.mesh.normals[rows], p.weight[k])
        if angle > self.limit[i] + self._rounding(p)[k]:
            place = p.weight[k] @ self.corner[p.triangle[k]]
            source = int(self.geometry.surfaces["source"][row])
            name = self.geometry.sources[source] if 0 <= source < len(self.geometry.sources) else ""
            self.report.violations.append(
                Violation(
                    f"face {row} {name}".rstrip(), row, "normal", angle, float(self.limit[i]), uv,
                    (float(place[0]), float(place[1]), float(place[2])), unit="degrees",
                )
            )  # fmt: skip


def exact_angle(
    geometry: GeometryBatch, row: int, parameters: Floats, drawn: Floats, weight: Floats
) -> tuple[float, tuple[float, float]]:
    """Degrees between the normal interpolated from ``drawn`` (3, 3) and the surface's, with 50 digits; the (u, v).

    Partial derivatives are central differences of points, of a step that such digits leave exact to 20.
    """
    arithmetic = multiprecision(DIGITS)
    import mpmath  # type: ignore[import-untyped]

    number = arithmetic.number
    w = [number(float(x)) for x in weight]
    total = sum(w)
    u, v = (sum(w[k] * number(float(parameters[k, m])) for k in range(3)) / total for m in range(2))
    m = [sum(w[k] * number(float(drawn[k, c])) for k in range(3)) for c in range(3)]
    s = geometry.surfaces[row]
    step_u = number(float(s["u1"]) - float(s["u0"])) * number(10) ** -15
    step_v = number(float(s["v1"]) - float(s["v0"])) * number(10) ** -15
    along_u = [surface_point(geometry, row, u + sign * step_u, v, arithmetic) for sign in (-1, 1)]
    along_v = [surface_point(geometry, row, u, v + sign * step_v, arithmetic) for sign in (-1, 1)]
    a = [(y - x) / (2 * step_u) for x, y in zip(*along_u, strict=True)]
    b = [(y - x) / (2 * step_v) for x, y in zip(*along_v, strict=True)]
    n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    if s["reversed"]:
        n = [-x for x in n]
    across = [n[1] * m[2] - n[2] * m[1], n[2] * m[0] - n[0] * m[2], n[0] * m[1] - n[1] * m[0]]
    sine = mpmath.sqrt(sum(x * x for x in across))
    cosine = sum(x * y for x, y in zip(n, m, strict=True))
    return float(mpmath.degrees(mpmath.atan2(sine, cosine))), (float(u), float(v))


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
