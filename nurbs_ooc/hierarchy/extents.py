"""How large a surface is, roughly: enough to choose the error at which its box is first computed.

Trimmed surfaces are measured by their edges in space (control points of B-splines, three points of
conics), untrimmed ones by their control points or by the lengths in their frame. Nothing certified
depends on the figure: a wrong one costs one more round of ``boxes.sketch_part``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import helper, kernel
from nurbs_cache.surface_record import CurveKind, GeometryBatch, SurfaceKind

NURBS_CURVE, ELLIPSE = int(CurveKind.NURBS), int(CurveKind.ELLIPSE)
NURBS, PLANE, CYLINDER, CONE = (
    int(k) for k in (SurfaceKind.NURBS, SurfaceKind.PLANE, SurfaceKind.CYLINDER, SurfaceKind.CONE)
)
SPHERE, TORUS, EXTRUSION = (int(k) for k in (SurfaceKind.SPHERE, SurfaceKind.TORUS, SurfaceKind.EXTRUSION))


@helper
def _add_point(box: npt.NDArray[np.float64], point: npt.NDArray[np.float64], weight: float) -> None:
    for axis in range(3):
        box[axis] = min(box[axis], point[axis] / weight)
        box[3 + axis] = max(box[3 + axis], point[axis] / weight)


@helper
def _add_net(box: npt.NDArray[np.float64], points: npt.NDArray[np.float64], rational: bool) -> None:
    """Add the control points that lie one after another in ``points``."""
    width = 4 if rational else 3
    for i in range(0, len(points), width):
        _add_point(box, points[i : i + 3], points[i + 3] if rational else 1.0)


@helper
def _add_curve(box: npt.NDArray[np.float64], curve: np.void, values: npt.NDArray[np.float64]) -> None:
    """Add control points, or start, middle and end of a conic."""
    at = curve["points"]
    if curve["kind"] == NURBS_CURVE:
        width = 4 if curve["rational"] else 3
        _add_net(box, values[at : at + width * curve["n"]], curve["rational"] == 1)
        return
    for t in (curve["t0"], 0.5 * (curve["t0"] + curve["t1"]), curve["t1"]):
        c, s = (np.cos(t), np.sin(t)) if curve["kind"] == ELLIPSE else (np.cosh(t), np.sinh(t))
        _add_point(box, values[at : at + 3] + c * values[at + 3 : at + 6] + s * values[at + 6 : at + 9], 1.0)


@helper
def _frame_extent(surface: np.void, values: npt.NDArray[np.float64], profile: float) -> float:
    """Extent of an untrimmed analytic surface from its lengths; ``profile``: extent of its profile curve."""
    frame, kind = values[surface["frame"] : surface["frame"] + 14], surface["kind"]
    x, y = np.sqrt((frame[3:6] ** 2).sum()), np.sqrt((frame[6:9] ** 2).sum())
    du, dv = surface["u1"] - surface["u0"], surface["v1"] - surface["v0"]
    if kind == PLANE:
        return x * du + y * dv
    if kind == CYLINDER:
        return 2 * x + 2 * y + dv
    if kind == CONE:
        return 2 * abs(frame[12]) + 2 * dv
    if kind == SPHERE or kind == TORUS:
        return 2 * abs(frame[12]) + (2 * abs(frame[13]) if kind == TORUS else 0.0)
    return profile + (dv if kind == EXTRUSION else profile)


@kernel
def _extents(
    surfaces: npt.NDArray[np.void],
    loops: npt.NDArray[np.void],
    coedges: npt.NDArray[np.void],
    edges: npt.NDArray[np.void],
    curves: npt.NDArray[np.void],
    values: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    box = np.empty(6)
    for row in range(len(surfaces)):
        surface = surfaces[row]
        box[:3], box[3:] = np.inf, -np.inf
        for loop in loops[surface["first_loop"] : surface["first_loop"] + surface["n_loops"]]:
            for coedge in coedges[loop["first_coedge"] : loop["first_coedge"] + loop["n_coedges"]]:
                curve = edges[coedge["edge"]]["curve"]
                if curve >= 0:
                    _add_curve(box, curves[curve], values)
        if box[0] <= box[3]:
            out[row] = np.sqrt(((box[3:] - box[:3]) ** 2).sum())
            continue
        if surface["kind"] == NURBS:
            n = surface["n_u"] * surface["n_v"] * (4 if surface["rational"] else 3)
            _add_net(box, values[surface["points"] : surface["points"] + n], surface["rational"] == 1)
        elif surface["profile"] >= 0:
            _add_curve(box, curves[surface["profile"]], values)
        extent = np.sqrt(((box[3:] - box[:3]) ** 2).sum()) if box[0] <= box[3] else 0.0
        out[row] = extent if surface["kind"] == NURBS else _frame_extent(surface, values, extent)


def rough_extents(geometry: GeometryBatch) -> npt.NDArray[np.float64]:
    """(n_surfaces,) float64, mm: about the diagonal of each surface; 0 where the record says nothing."""
    out = np.zeros(len(geometry))
    g = geometry
    _extents(g.surfaces, g.loops, g.coedges, g.edges, g.curves, g.values, out)
    return np.where(np.isfinite(out), out, 0.0)
