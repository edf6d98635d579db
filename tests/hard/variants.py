"""The same faces scaled, moved, mirrored, or with their control nets reversed or transposed.

Each variant is a function of a whole batch and changes the records as a file would hold them: native
parameters that are lengths scale with the surface, and the p-curves in them too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.void]

# Which of u and v are lengths, by kind.
LENGTHS = {
    SurfaceKind.PLANE: (True, True),
    SurfaceKind.CYLINDER: (False, True),
    SurfaceKind.CONE: (False, True),
    SurfaceKind.EXTRUSION: (False, True),
}
FRAME = 14


@dataclass(frozen=True)
class Variant:
    """How a case is changed before it is tessellated.

    Attributes:
        name: for test ids.
        change: batch to changed batch.
        scale: lengths grow by it (errors too).
        shift: mm; every coordinate moves by it.
        turns_nets: only meant for B-splines.
    """

    name: str
    change: Callable[[GeometryBatch], GeometryBatch]
    scale: float = 1.0
    shift: float = 0.0
    turns_nets: bool = False


def _copy(batch: GeometryBatch) -> GeometryBatch:
    values = [getattr(batch, f.name).copy() for f in fields(batch) if f.name != "sources"]
    return GeometryBatch(*values, sources=list(batch.sources))


def curve_rows(batch: GeometryBatch, c: Rows) -> Array:
    """View of a curve's point rows in the pool."""
    dim = int(c["dim"])
    n, width = (3, dim) if c["kind"] != CurveKind.NURBS else (int(c["n"]), dim + int(c["rational"]))
    return batch.values[int(c["points"]) : int(c["points"]) + n * width].reshape(n, width)


def net(batch: GeometryBatch, s: Rows) -> Array:
    """View of a B-spline surface's control points in the pool."""
    n_u, n_v, width = int(s["n_u"]), int(s["n_v"]), 3 + int(s["rational"])
    return batch.values[int(s["points"]) : int(s["points"]) + n_u * n_v * width].reshape(n_u, n_v, width)


def knots(batch: GeometryBatch, s: Rows, axis: int) -> Array:
    """View of a B-spline surface's knots along u (0) or v (1)."""
    n, p, at = (int(s[name]) for name in (("n_u", "degree_u", "knots_u"), ("n_v", "degree_v", "knots_v"))[axis])
    return batch.values[at : at + n + p + 1]


def pcurves_of(batch: GeometryBatch, s: Rows) -> list[int]:
    """Rows of the p-curves of a surface's loops."""
    loops = batch.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]
    return [int(c["pcurve"]) for k in loops for c in batch.coedges[k["first_coedge"] :][: k["n_coedges"]]]


def _map_curve(batch: GeometryBatch, row: int, matrix: Array, offset: Array) -> None:
    """x -> matrix x + offset for one curve, in place."""
    c = batch.curves[row]
    rows = curve_rows(batch, c)
    dim = int(c["dim"])
    rows[:, :dim] = rows[:, :dim] @ matrix.T
    if c["kind"] != CurveKind.NURBS:
        rows[0] += offset
    else:
        rows[:, :dim] += (rows[:, dim:] if c["rational"] else 1.0) * offset


def _map_space(batch: GeometryBatch, matrix: Array, shift: Array) -> GeometryBatch:
    """Vertices, edge curves, profiles, control points and frames under x -> matrix x + shift."""
    out = _copy(batch)
    out.vertices[:] = out.vertices @ matrix.T + shift
    for row, c in enumerate(out.curves):
        if c["dim"] == 3:
            _map_curve(out, row, matrix, shift)
    for s in out.surfaces:
        if s["kind"] == SurfaceKind.NURBS:
            points = net(out, s)
            points[..., :3] = points[..., :3] @ matrix.T + (points[..., 3:] if s["rational"] else 1.0) * shift
        else:
            frame = out.values[int(s["frame"]) : int(s["frame"]) + FRAME]
            frame[:12] = (frame[:12].reshape(4, 3) @ matrix.T).ravel()
            frame[:3] += shift
    return out


def moved(shift: float) -> Callable[[GeometryBatch], GeometryBatch]:
    """Every coordinate moved by ``shift`` mm."""
    return lambda batch: _map_space(batch, np.eye(3), np.full(3, shift))


def mirrored(batch: GeometryBatch) -> GeometryBatch:
    """The image in the plane x = 0, with the outside of each face on the same side of its material."""
    out = _map_space(batch, np.diag([-1.0, 1.0, 1.0]), np.zeros(3))
    for s in out.surfaces:
        s["reversed"] ^= 1
        if s["kind"] == SurfaceKind.REVOLUTION:  # turns the other way about the same axis: turn the axis over
            frame = out.values[int(s["frame"]) : int(s["frame"]) + FRAME]
            frame[9:12] *= -1.0
    return out


def scaled(factor: float) -> Callable[[GeometryBatch], GeometryBatch]:
    """All lengths times ``factor``."""

    def change(batch: GeometryBatch) -> GeometryBatch:
        out = _map_space(batch, factor * np.eye(3), np.zeros(3))
        for name in ("approximation_error", "tolerance"):
            out.surfaces[name] *= factor
        out.edges["tolerance"] *= factor
        for s in out.surfaces:
            kind = SurfaceKind(int(s["kind"]))
            in_u, in_v = LENGTHS.get(kind, (False, False))
            factors = np.array([factor if in_u else 1.0, factor if in_v else 1.0])
            if kind != SurfaceKind.NURBS:
                _scale_frame(out, s, kind, factor)
            for name, along in (("u0", 0), ("u1", 0), ("v0", 1), ("v1", 1)):
                s[name] *= factors[along]
            for row in pcurves_of(out, s):
                _map_curve(out, row, np.diag(factors), np.zeros(2))
        return out

    return change


def _scale_frame(batch: GeometryBatch, s: Rows, kind: SurfaceKind, factor: float) -> None:
    """Axes that carry no length go back to what they were; radii grow."""
    frame = batch.values[int(s["frame"]) : int(s["frame"]) + FRAME]
    kept = slice(9, 12) if kind == SurfaceKind.CYLINDER else slice(3, 12)
    frame[kept] /= factor
    if kind in (SurfaceKind.CONE, SurfaceKind.SPHERE, SurfaceKind.TORUS):
        frame[12] *= factor
    if kind == SurfaceKind.TORUS:
        frame[13] *= factor


def _turn_loops(batch: GeometryBatch, s: Rows, matrix: Array, offset: Array) -> None:
    """p-curves under an orientation-reversing map of (u, v); loops run the other way round."""
    for row in pcurves_of(batch, s):
        _map_curve(batch, row, matrix, offset)
    for k in batch.loops[s["first_loop"] : s["first_loop"] + s["n_loops"]]:
        first, n = int(k["first_coedge"]), int(k["n_coedges"])
        batch.coedges[first : first + n] = batch.coedges[first : first + n][::-1].copy()
        batch.coedges["reversed"][first : first + n] ^= 1
    s["reversed"] ^= 1


def reversed_nets(batch: GeometryBatch) -> GeometryBatch:
    """B-splines run through backwards in u."""
    out = _copy(batch)
    for s in out.surfaces:
        if s["kind"] != SurfaceKind.NURBS:
            continue
        points, along = net(out, s), knots(out, s, 0)
        ends = along[0] + along[-1]
        points[:] = points[::-1].copy()
        along[:] = (ends - along)[::-1].copy()
        s["u0"], s["u1"] = ends - s["u1"], ends - s["u0"]
        _turn_loops(out, s, np.diag([-1.0, 1.0]), np.array([ends, 0.0]))
    return out


def transposed(batch: GeometryBatch) -> GeometryBatch:
    """B-splines with u and v exchanged."""
    out = _copy(batch)
    for s in out.surfaces:
        if s["kind"] != SurfaceKind.NURBS:
            continue
        points = net(out, s).transpose(1, 0, 2).copy()
        net(out, s).reshape(-1)[:] = points.reshape(-1)
        for a, b in (
            ("n_u", "n_v"), ("degree_u", "degree_v"), ("knots_u", "knots_v"), ("u0", "v0"), ("u1", "v1"),
            ("u_period", "v_period"),
        ):  # fmt: skip
            s[a], s[b] = s[b].copy(), s[a].copy()
        _turn_loops(out, s, np.array([[0.0, 1.0], [1.0, 0.0]]), np.zeros(2))
    return out


def as_is(batch: GeometryBatch) -> GeometryBatch:
    """No change."""
    return batch


PLAIN = Variant("plain", as_is)
VARIANTS = (
    PLAIN,
    Variant("scaled_2^20", scaled(2.0**20), scale=2.0**20),
    Variant("scaled_2^-20", scaled(2.0**-20), scale=2.0**-20),
    Variant("moved_1e6", moved(1e6), shift=1e6),
    Variant("moved_1e9", moved(1e9), shift=1e9),
    Variant("mirrored", mirrored),
    Variant("reversed", reversed_nets, turns_nets=True),
    Variant("transposed", transposed, turns_nets=True),
)


def joined(batches: list[GeometryBatch]) -> GeometryBatch:
    """Several parts as one; rows follow one another in the order given."""
    out: dict[str, Any] = {}
    counts = {f.name: np.cumsum([0, *(len(getattr(b, f.name)) for b in batches)]) for f in fields(GeometryBatch)}
    pointers = {
        "surfaces": {
            "first_loop": "loops", "knots_u": "values", "knots_v": "values", "points": "values",
            "frame": "values", "profile": "curves", "source": "sources",
        },
        "loops": {"first_coedge": "coedges"},
        "coedges": {"edge": "edges", "pcurve": "curves"},
        "edges": {"curve": "curves", "vertex0": "vertices", "vertex1": "vertices"},
        "curves": {"knots": "values", "points": "values"},
    }  # fmt: skip
    for f in fields(GeometryBatch):
        if f.name == "sources":
            continue
        tables = []
        for i, batch in enumerate(batches):
            table = getattr(batch, f.name).copy()
            for column, target in pointers.get(f.name, {}).items():
                table[column] = np.where(table[column] >= 0, table[column] + counts[target][i], table[column])
            tables.append(table)
        out[f.name] = np.concatenate(tables)
    out["edges"]["id"] = np.arange(len(out["edges"]))
    return GeometryBatch(**out, sources=[s for b in batches for s in b.sources])
