"""Attack the promise of an appearance: distance and shading of points of the triangles, combined.

The error of a point is measured as ``shading_length`` defines it, with evaluation of the attack's own: how far the
interpolated normal or attribute is from the surface's at the same parameters, over a rate at which it changes on
the triangle, the largest of many pairs of places. A rate that is too small could accuse a promise that holds, so the
pairs of the point itself with the corners are among them: with these no bound by the triangle's size is exceeded. The
worst points of each face climb inside their triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.measure.ascent import worst_of_each
from nurbs_ooc.measure.attack_normals import NEAREST_CORNER, STEPS
from nurbs_ooc.measure.exact_attribute import exact_attribute
from nurbs_ooc.measure.exact_surface import derivatives, normals, points
from nurbs_ooc.measure.mesh_sampler import sample_triangles
from nurbs_ooc.measure.violation import Violation
from nurbs_ooc.tessellation.appearance import Appearance
from nurbs_ooc.tessellation.mesh import MeshBatch

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

CLIMBERS = 4  # samples per face that climb
ROUNDS = 20
DIGITS = 50
FEET = 4  # steps towards the foot on the surface
# Pairs of places around points near the corners, as shares of the triangle; the bound takes derivatives there.
NEAR_CORNER, PAIR = 1.0 / 16.0, 0.01
# How far beside a corner at which there is no value one is taken, as a share of the triangle.
BESIDE = 1e-3
# What those differences, and values from differences, may be off by; of the promise, and of an attribute's size.
SLACK, VALUE_SLACK = 2e-3, 1e-7
ROUNDING = 64 * np.finfo(float).eps  # of a coordinate


@dataclass(eq=False)
class AppearanceReport:
    """Measured against promised, mm.

    Attributes:
        largest: (n,) combined error, per face of the mesh.
        n_samples: points that were measured.
        violations: points that are off by more than what is promised.
    """

    largest: Floats
    n_samples: int = 0
    violations: list[Violation] = field(default_factory=list)


def attack_appearance(
    geometry: GeometryBatch, mesh: MeshBatch, look: Appearance, unseen_value: float, samples: int = 400, seed: int = 0
) -> AppearanceReport:
    """Attack ``mesh.appearance_error`` of every face, or of a mesh that promises none, measure it.

    Args:
        geometry: the surfaces the mesh was made of.
        mesh: what ``tessellate`` returned.
        look: what it was asked for.
        unseen_value: what the attribute's values may differ by unseen, in its unit.
        samples: points per face.
        seed: the same seed finds the same.
    """
    return _Attack(geometry, mesh, look, unseen_value).run(samples, seed)


class _Attack:
    def __init__(self, geometry: GeometryBatch, mesh: MeshBatch, look: Appearance, unseen_value: float) -> None:
        self.geometry, self.mesh, self.look, self.unseen_value = geometry, mesh, look, unseen_value
        self.attribute = exact_attribute(geometry, look)
        self.report = AppearanceReport(np.zeros(len(mesh.faces)))
        promised = mesh.appearance_error if len(mesh.appearance_error) else np.full(len(mesh.faces), np.inf)
        largest = np.abs(mesh.positions).max(initial=0.0)
        self.limit = (promised + mesh.pcurve_error) * (1.0 + SLACK) + ROUNDING * largest

    def run(self, samples: int, seed: int) -> AppearanceReport:
        rng = np.random.default_rng([seed, 0x0A32])
        corner = self.mesh.positions[self.mesh.triangles]
        areas = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        face, triangle, weight = sample_triangles(areas, self.mesh.triangle_start, samples, rng)
        inside = weight.max(axis=1) < 1.0 - NEAREST_CORNER if len(face) else np.zeros(0, bool)
        face, triangle, weight = face[inside], triangle[inside], weight[inside]
        for i in np.unique(face):
            own = face == i
            self._judge(int(i), triangle[own], weight[own])
        return self.report

    def _judge(self, i: int, triangle: Indices, weight: Floats) -> None:
        error = self._errors(i, triangle, weight)
        top = worst_of_each(np.zeros(len(error), np.int64), error, CLIMBERS)
        weight, error = self._climb(i, triangle[top], weight[top], error[top])
        for k in np.argsort(-error):
            if error[k] > self.limit[i]:
                error[k] = self._look_again(i, triangle[top[k]], weight[k])
        k = int(np.argmax(error))
        self.report.largest[i] = error[k]
        if error[k] > self.limit[i]:
            rows = self.mesh.triangles[triangle[top[k]]]
            uv, place = weight[k] @ self.mesh.parameters[rows], weight[k] @ self.mesh.positions[rows]
            row = int(self.mesh.faces[i])
            self.report.violations.append(
                Violation(
                    f"face {row}", row, "appearance", float(error[k]), float(self.mesh.appearance_error[i]),
                    (float(uv[0]), float(uv[1])), (float(place[0]), float(place[1]), float(place[2])),
                )
            )  # fmt: skip

    def _look_again(self, i: int, triangle: int, weight: Floats) -> float:
        """The error of one point, curvatures with many digits: near poles differences in float64 are not enough."""
        plain, self.attribute = self.attribute, exact_attribute(self.geometry, self.look, DIGITS)
        error = self._errors(i, np.array([triangle]), weight[None])
        self.attribute = plain
        return float(error[0])

    def _climb(self, i: int, triangle: Indices, weight: Floats, value: Floats) -> tuple[Floats, Floats]:
        weight, value = weight.copy(), value.copy()
        step = np.full(len(value), 0.1)
        start = np.repeat(np.arange(len(value)), len(STEPS))
        for _ in range(ROUNDS):
            tried = weight[start] + step[start][:, None] * np.tile(STEPS, (len(value), 1))
            fits = (tried >= 0.0).all(axis=1) & (tried.max(axis=1) <= 1.0 - NEAREST_CORNER)
            found = np.full(len(start), -1.0)
            if fits.any():
                found[fits] = self._errors(i, triangle[start[fits]], tried[fits])
            around = found.reshape(-1, len(STEPS))
            best = np.argmax(around, axis=1)
            top = around[np.arange(len(value)), best]
            up = top > value
            weight[up], value[up] = tried.reshape(-1, len(STEPS), 3)[up, best[up]], top[up]
            step[~up] *= 0.5
        return weight, value

    def _errors(self, i: int, triangle: Indices, weight: Floats) -> Floats:
        """Combined errors of points of face ``i``, mm."""
        row, rows = int(self.mesh.faces[i]), self.mesh.triangles[triangle]
        corners = self.mesh.parameters[rows]
        uv = np.einsum("nk,nki->ni", weight, corners)
        drawn = np.einsum("nk,nki->ni", weight, self.mesh.positions[rows])
        self.report.n_samples += len(uv)
        place = points(self.geometry, row, uv)
        feet = points(self.geometry, row, corners.reshape(-1, 2)).reshape(-1, 3, 3)
        total = self._distance(row, uv, drawn) ** 2
        way = np.concatenate([_along_edges(feet), np.linalg.norm(place[:, None] - feet, axis=2)], axis=1)
        if self.look.normals:
            own, at_corners = normals(self.geometry, row, uv), self.mesh.normals[rows]
            mean = np.einsum("nk,nki->ni", weight, at_corners)
            mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
            off = np.where(np.linalg.norm(own, axis=1) > 0.0, np.linalg.norm(mean - own, axis=1), 0.0)
            angle = 2.0 * np.arcsin(np.clip(0.5 * off, 0.0, 1.0))
            change = np.concatenate(
                [_along_edges(at_corners), np.linalg.norm(own[:, None] - at_corners, axis=2)], axis=1
            )
            total += _length(np.where(angle > np.radians(self.look.unseen_deg), off, 0.0), _rate(change, way)) ** 2
        if self.attribute is not None:
            h, at_corners = self.attribute(row, uv), self._at_corners(row, corners)
            off = np.linalg.norm(np.einsum("nk,nki->ni", weight, at_corners) - h, axis=1)
            off -= VALUE_SLACK * np.abs(at_corners).max(axis=(1, 2))
            change = np.concatenate([_along_edges(at_corners), np.linalg.norm(h[:, None] - at_corners, axis=2)], axis=1)
            rate = np.maximum(_rate(change, way), self._inner_rate(row, corners))
            # NaN compares as not seen.
            total += _length(np.where(off > self.unseen_value, off, 0.0), rate) ** 2
        return np.asarray(np.sqrt(total))

    def _at(self, row: int, uv: Floats) -> Floats:
        assert self.attribute is not None
        return self.attribute(row, uv.reshape(-1, 2)).reshape(*uv.shape[:-1], 3)

    def _at_corners(self, row: int, corners: Floats) -> Floats:
        """Values at corners; where there is none, at a pole or on a crease, that of a place a little inside."""
        found = self._at(row, corners)
        if np.isnan(found).any():
            inside = self._at(row, corners + BESIDE * (corners.mean(axis=1, keepdims=True) - corners))
            found = np.where(np.isnan(found), inside, found)
        return found

    def _inner_rate(self, row: int, corners: Floats) -> Floats:
        """Rates of the attribute between places on either side of points near the corners, along u and along v."""
        inner = corners + NEAR_CORNER * (corners.mean(axis=1, keepdims=True) - corners)
        best = np.zeros(len(corners))
        for k in range(2):
            h = np.zeros_like(inner)
            h[..., k] = PAIR * np.ptp(corners[..., k], axis=1)[:, None]
            change = np.linalg.norm(self._at(row, inner + h) - self._at(row, inner - h), axis=2)
            ends = [points(self.geometry, row, x.reshape(-1, 2)).reshape(-1, 3, 3) for x in (inner + h, inner - h)]
            best = np.maximum(best, _rate(change, np.linalg.norm(ends[0] - ends[1], axis=2)))
        return best

    def _distance(self, row: int, uv: Floats, drawn: Floats) -> Floats:
        """To the surface itself, begun at the same parameters."""
        uv = uv.copy()
        best = np.full(len(uv), np.inf)
        for _ in range(FEET):
            d = derivatives(self.geometry, row, uv)
            off = drawn - d[:, 0]
            best = np.minimum(best, np.linalg.norm(off, axis=1))
            form = np.einsum("nik,njk->nij", d[:, 1:], d[:, 1:])
            form += 1e-12 * np.trace(form, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
            uv += np.linalg.solve(form, np.einsum("nik,nk->ni", d[:, 1:], off)[..., None])[..., 0]
        return best


def _along_edges(x: Floats) -> Floats:
    """(n, 3) distances between the corners of (n, 3, 3)."""
    return np.asarray(np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2))


def _rate(change: Floats, way: Floats) -> Floats:
    with np.errstate(all="ignore"):
        return np.asarray(np.where((way > 0.0) & (change >= 0.0), change / way, 0.0).max(axis=1))


def _length(off: Floats, rate: Floats) -> Floats:
    with np.errstate(all="ignore"):
        return np.where(off > 0.0, off / rate, 0.0)
