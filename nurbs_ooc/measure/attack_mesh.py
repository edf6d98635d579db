"""Attack the promises of a tessellation: every face against its own triangles, in both directions.

1. Samples of the trimmed surface are measured to the triangles; the worst climb to worse ones.
2. Points of the triangles are measured to the trimmed surface; the worst triangles are sampled again.
3. A mesh point over its limit is examined: is there really no foot? Only what stands is a violation.

Nothing is shared with the tessellator but the records.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.measure.ascent import climb, worst_of_each
from nurbs_ooc.measure.certify_far import FarProof
from nurbs_ooc.measure.closest import ClosestPrimitive, as_primitives
from nurbs_ooc.measure.exact_surface import normals, points
from nurbs_ooc.measure.face_sampler import sample_faces
from nurbs_ooc.measure.foot_point import FootFinder
from nurbs_ooc.measure.mesh_sampler import sample_triangles
from nurbs_ooc.measure.trim_region import TrimRegion
from nurbs_ooc.measure.violation import Violation
from nurbs_ooc.tessellation.mesh import MeshBatch

REGION_SHARE = 0.02  # of a face's promise: boundary pieces straight within it are not cut finer
FINEST = 1e-9  # of the part's size: no boundary is cut finer than this
ROUNDING = 64 * np.finfo(float).eps  # of the largest coordinate: what float64 itself may add
CLIMBERS = 3  # samples per face that climb
WORST_TRIANGLES = 2  # triangles per face that are sampled again
AGAIN = 24  # points of each of these

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(eq=False)
class AttackReport:
    """Measured against promised, per face of the mesh; all lengths in mm.

    Attributes:
        faces: (n,) rows in the geometry.
        certified: (n,) what the mesh promises.
        requested: what was asked of the tessellator, or None.
        n_samples: measured distances in both directions together.
        surface_to_mesh_max, surface_to_mesh_mean: (n,) distances of surface points to the triangles.
        worst_uv: (n, 2) where the largest of them was met.
        mesh_to_surface_max, mesh_to_surface_mean: (n,) distances of mesh points to the trimmed surface.
        normal_error_deg: (n,) largest angle between a vertex normal and the surface's.
        inverted: (n,) triangles that look against the surface's outside.
        over_request: (n,) bool, certified above the request.
        undecided: mesh points for which neither a foot was found nor its absence proven.
        violations: what stands after a second look.
    """

    faces: Indices
    certified: Floats
    requested: float | None
    n_samples: int
    surface_to_mesh_max: Floats
    surface_to_mesh_mean: Floats
    worst_uv: Floats
    mesh_to_surface_max: Floats
    mesh_to_surface_mean: Floats
    normal_error_deg: Floats
    inverted: Indices
    over_request: npt.NDArray[np.bool_]
    undecided: int = 0
    violations: list[Violation] = field(default_factory=list)

    @property
    def measured(self) -> Floats:
        """(n,) larger of the two directions' maxima."""
        return np.maximum(self.surface_to_mesh_max, self.mesh_to_surface_max)

    def as_json(self) -> dict[str, Any]:
        """The whole of it in a few numbers, with every violation."""
        shown = self.certified > 0
        ratio = self.measured[shown] / self.certified[shown]
        tightness = 1.0 / ratio[ratio > 1e-6]
        return {
            "faces": len(self.faces),
            "samples": self.n_samples,
            "measured_max_mm": float(self.measured.max(initial=0.0)),
            "surface_to_mesh_max_mm": float(self.surface_to_mesh_max.max(initial=0.0)),
            "mesh_to_surface_max_mm": float(self.mesh_to_surface_max.max(initial=0.0)),
            "certified_max_mm": float(self.certified.max(initial=0.0)),
            "requested_mm": self.requested,
            "worst_measured_over_certified": float(ratio.max(initial=0.0)),
            "median_certified_over_measured": float(np.median(tightness)) if len(tightness) else None,
            "faces_over_request": int(self.over_request.sum()),
            "normal_error_max_deg": float(self.normal_error_deg.max(initial=0.0)),
            "inverted_triangles": int(self.inverted.sum()),
            "undecided": self.undecided,
            "violations": [v.as_json() for v in self.violations],
        }


def attack_mesh(
    geometry: GeometryBatch, mesh: MeshBatch, samples: int = 400, seed: int = 0, requested: float | None = None
) -> AttackReport:
    """Attack every face of ``mesh``.

    Args:
        geometry: the surfaces the mesh was made of.
        mesh: what ``tessellate`` returned.
        samples: points per face and direction.
        seed: the same seed finds the same.
        requested: mm; the chord error that was asked for.

    Returns:
        The report; look at ``violations`` first.
    """
    return _Attack(geometry, mesh, samples, seed, requested).run()


class _Attack:
    def __init__(
        self, geometry: GeometryBatch, mesh: MeshBatch, samples: int, seed: int, requested: float | None
    ) -> None:
        self.geometry, self.mesh, self.samples, self.requested = geometry, mesh, samples, requested
        self.rng = np.random.default_rng([seed, 0xA77A])
        self.certified = np.asarray(mesh.certified_error, float)
        self.violations = _malformed(geometry, mesh)
        broken = {v.row for v in self.violations}
        self.alive = np.array([i for i, row in enumerate(mesh.faces) if int(row) not in broken], np.int64)
        n = len(mesh.faces)
        zeros = [np.zeros(n) for _ in range(5)]
        over = self.certified > (np.inf if requested is None else requested)
        self.report = AttackReport(
            mesh.faces, self.certified, requested, 0, zeros[0], zeros[1], np.full((n, 2), np.nan), zeros[2], zeros[3],
            zeros[4], np.zeros(n, np.int64), over, 0, self.violations,
        )  # fmt: skip
        used = mesh.positions[np.isfinite(mesh.positions).all(1)]
        self.size = float(np.ptp(used, axis=0).max()) if len(used) else 1.0
        self.rounding = ROUNDING * float(np.abs(used).max(initial=0.0))
        if len(self.alive):
            self.limit = self.certified[self.alive] + self.rounding
            tolerance = np.maximum(REGION_SHARE * self.certified[self.alive], FINEST * self.size)
            self.region = TrimRegion(geometry, mesh.faces[self.alive], tolerance)
            self.found = sample_faces(self.region, samples, seed)
            self.tree = self._triangle_tree()

    def run(self) -> AttackReport:
        if len(self.alive):
            self._surface_to_mesh()
            self._mesh_to_surface()
            self._orientation()
        return self.report

    def _triangle_tree(self) -> ClosestPrimitive:
        """The triangles of each face as a group; a face drawn by points alone is its vertices."""
        mesh, parts, groups = self.mesh, [], []
        for group, i in enumerate(self.alive):
            own = mesh.triangles[mesh.triangle_start[i] : mesh.triangle_start[i + 1]]
            if not len(own):
                vertices = np.arange(mesh.vertex_start[i], mesh.vertex_start[i + 1])
                own = as_primitives(np.empty((0, 3), np.int64), points=vertices)
            parts.append(own)
            groups.append(np.full(len(own), group))
        return ClosestPrimitive(mesh.positions, np.concatenate(parts), np.concatenate(groups), len(self.alive))

    def _surface_to_mesh(self) -> None:
        s, report = self.found, self.report
        distance, _ = self.tree.query(s.points, s.face)
        report.n_samples += len(s)
        report.surface_to_mesh_mean[self.alive] = _mean(s.face, distance, len(self.alive))
        top = worst_of_each(s.face, distance, CLIMBERS)
        face = s.face[top]
        step = (self.region.bounds[face, 2:] - self.region.bounds[face, :2]) / np.sqrt(self.samples)

        def measure(start: Indices, p: Floats) -> Floats:
            report.n_samples += len(start)
            return self.tree.query(p, face[start])[0]

        uv, value = climb(self.region, face, s.uv[top], distance[top], step, measure)
        for k in worst_of_each(face, value, 1):
            i = self.alive[face[k]]
            report.surface_to_mesh_max[i], report.worst_uv[i] = value[k], uv[k]
            if value[k] > self.limit[face[k]]:
                p = points(self.geometry, self.mesh.faces[i], [uv[k]])[0]
                self._record(i, "surface to mesh", value[k], uv[k], p)

    def _mesh_to_surface(self) -> None:
        mesh, report = self.mesh, self.report
        self.finder = FootFinder(self.region)
        self.far = FarProof(self.region)
        corner = mesh.positions[mesh.triangles]
        areas = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        face, triangle, weight = sample_triangles(areas, mesh.triangle_start, self.samples, self.rng)
        group = np.full(len(mesh.faces), -1)
        group[self.alive] = np.arange(len(self.alive))
        keep = group[face] >= 0
        face, triangle, weight = group[face[keep]], triangle[keep], weight[keep]
        _, value = self._measure_back(face, triangle, weight)
        report.mesh_to_surface_mean[self.alive] = _mean(face, value, len(self.alive))
        top = worst_of_each(face, value, WORST_TRIANGLES)
        more = (np.repeat(face[top], AGAIN), np.repeat(triangle[top], AGAIN))
        again = self.rng.dirichlet((1.0, 1.0, 1.0), len(more[0])).reshape(-1, 3)
        face, triangle = np.concatenate([face, more[0]]), np.concatenate([triangle, more[1]])
        weight, value = np.concatenate([weight, again]), np.concatenate([value, self._measure_back(*more, again)[1]])
        self._judge_back(face, triangle, weight, value)

    def _measure_back(self, face: Indices, triangle: Indices, weight: Floats) -> tuple[Floats, Floats]:
        rows = self.mesh.triangles[triangle]
        p = np.einsum("nk,nki->ni", weight, self.mesh.positions[rows])
        self.report.n_samples += len(p)
        _, _, value = self.finder.nearest(p, np.arange(len(p) + 1), face)
        return p, value

    def _judge_back(self, face: Indices, triangle: Indices, weight: Floats, value: Floats) -> None:
        """The largest distance of each face; those over the limit are searched again and proven, worst first."""
        order = worst_of_each(face, value, 6)
        settled: set[int] = set()
        for k in order:
            f, i = int(face[k]), self.alive[face[k]]
            if f in settled:
                continue
            distance, limit = float(value[k]), float(self.limit[f])
            if distance > limit:
                p = weight[k] @ self.mesh.positions[self.mesh.triangles[triangle[k]]]
                to_face, to_boundary = self.finder.search(p, f, distance)
                distance = min(distance, to_face)
            if distance > limit:
                if not self.far.nowhere_near(f, p, limit, to_boundary):
                    self.report.undecided += 1
                    continue
                self._record(i, "mesh to surface", distance, None, p)
            self.report.mesh_to_surface_max[i] = distance
            settled.add(f)

    def _orientation(self) -> None:
        """Vertex normals and the sense of the triangles against the surface's own normal."""
        mesh = self.mesh
        of = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.vertex_start))
        alive = np.isin(of, self.alive)
        exact = np.zeros((len(of), 3))
        exact[alive] = normals(self.geometry, mesh.faces[of[alive]], mesh.parameters[alive])
        known = np.linalg.norm(exact, axis=1) > 0
        angle = np.zeros(len(of))
        chord = np.linalg.norm(exact[known] - mesh.normals[known], axis=1)
        angle[known] = np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))
        np.maximum.at(self.report.normal_error_deg, of, angle)
        t = mesh.triangles
        corner = mesh.positions[t]
        flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        against = (np.einsum("ni,nki->nk", flat, exact[t]) < 0).all(1)
        face = np.repeat(np.arange(len(mesh.faces)), np.diff(mesh.triangle_start))
        np.add.at(self.report.inverted, face[against], 1)

    def _record(self, i: int, kind: str, value: float, uv: Floats | None, p: Floats) -> None:
        row = int(self.mesh.faces[i])
        at = None if uv is None else (float(uv[0]), float(uv[1]))
        limit = float(self.certified[i])
        self.violations.append(
            Violation(
                _name(self.geometry, row), row, kind, float(value), limit, at, (float(p[0]), float(p[1]), float(p[2]))
            )
        )


def _mean(face: Indices, value: Floats, n: int) -> Floats:
    return np.bincount(face, value, n) / np.maximum(np.bincount(face, minlength=n), 1)


def _name(geometry: GeometryBatch, row: int) -> str:
    source = int(geometry.surfaces["source"][row])
    name = geometry.sources[source] if 0 <= source < len(geometry.sources) else ""
    return f"face {row} {name}".rstrip()


def _malformed(geometry: GeometryBatch, mesh: MeshBatch) -> list[Violation]:
    """Faces that cannot be measured: lost, not finite, or with triangles that point elsewhere."""
    out = []
    unusable = (FaceReason.NOT_FINITE, FaceReason.BAD_WEIGHTS, FaceReason.BAD_KNOTS)
    for i, row in enumerate(int(r) for r in mesh.faces):
        where = _name(geometry, row)
        first, last = int(mesh.vertex_start[i]), int(mesh.vertex_start[i + 1])
        triangles = mesh.triangles[mesh.triangle_start[i] : mesh.triangle_start[i + 1]]
        if last == first:
            out.append(Violation(where, row, "lost"))
        elif not (np.isfinite(mesh.positions[first:last]).all() and np.isfinite(mesh.normals[first:last]).all()):
            out.append(Violation(where, row, "not finite"))
        elif len(triangles) and (triangles.min() < first or triangles.max() >= last):
            out.append(Violation(where, row, "bad index"))
        elif not len(triangles) and mesh.status[i] < FaceStatus.DEGRADED:
            out.append(Violation(where, row, "lost"))
        elif not np.isfinite(mesh.certified_error[i]) or geometry.surfaces["reason"][row] in unusable:
            out.append(Violation(where, row, "not finite"))
    return out
