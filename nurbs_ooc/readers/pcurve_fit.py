"""P-curves that do not follow their edge, made anew by projection.

Some files, and the kernel's own projections, give p-curves whose image leaves the edge or runs along
it at another pace. Everything downstream pairs the two by parameter, so such a p-curve is replaced by
a cubic through the feet of points of the edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.gp import gp_Pnt, gp_Vec

from nurbs_ooc.geometry import interpolation
from nurbs_ooc.geometry.forms import Array, CurveForm

CHECKS = (0.02, 0.17, 0.4, 0.63, 0.83, 0.98)  # of the edge: fits are worst near their ends
LEAST_GAP = 1e-5  # mm; p-curves closer than this are left alone
SLACK = 3.0  # times the edge's tolerance, likewise
SIZES = (17, 33, 65, 129, 257)  # points of the new p-curve, until it is close enough
GAIN = 0.5  # a new p-curve is taken if it is at least this much closer
GUESSES = 33  # along the old p-curve, from which the projection starts
WINDOW = 0.2  # of the edge: guesses further along may be on the other side of a seam
STEPS = 12
FLAT = 1e-16  # sine squared of the angle between the tangents: no foot at a pole
STALLED = 0.7  # doubling the points gains a factor of 16 if it gains at all


@dataclass(frozen=True)
class EdgeOnSurface:
    """An edge and its p-curve as the kernel has them.

    Attributes:
        surface, curve, pcurve: ``Geom_Surface``, ``Geom_Curve``, ``Geom2d_Curve``.
        over, pover: parameter ranges of the edge and of the p-curve, run through linearly together.
    """

    surface: Any
    curve: Any
    pcurve: Any
    over: tuple[float, float]
    pover: tuple[float, float]

    def space(self, share: float) -> Any:
        """Point of the edge."""
        return self.curve.Value(self.over[0] + share * (self.over[1] - self.over[0]))

    def flat(self, share: float) -> tuple[float, float]:
        """(u, v) of the p-curve."""
        u, v = self.pcurve.Value(self.pover[0] + share * (self.pover[1] - self.pover[0])).Coord()
        return u, v

    def gap(self) -> float:
        """Largest distance between the edge and the image of its p-curve at a few parameters, mm."""
        return float(max(self.space(s).Distance(self.surface.Value(*self.flat(s))) for s in CHECKS))


def refitted(edge: EdgeOnSurface, tolerance: float) -> CurveForm | None:
    """A p-curve that follows the edge better, over the same parameters; None if the old one is as good.

    Args:
        tolerance: the file's own of the edge, mm.
    """
    if _is_closed_form(edge):
        return None
    limit = max(SLACK * tolerance, LEAST_GAP)
    before = edge.gap()
    if not before > limit:
        return None
    best, best_gap, last = None, GAIN * before, np.inf
    guesses = np.array([edge.flat(s) for s in np.linspace(0.0, 1.0, GUESSES).tolist()])
    images = np.array([edge.surface.Value(*uv).Coord() for uv in guesses.tolist()])
    for n in SIZES:
        form = _through_feet(edge, n, guesses, images)
        gap = _form_gap(edge, form, n)
        if gap < best_gap:
            best, best_gap = form, gap
        if best_gap <= limit or gap > STALLED * last:
            break
        last = gap
    return best


def _is_closed_form(edge: EdgeOnSurface) -> bool:
    """Whether the p-curve is the straight image of a line or circle: nothing to be gained."""
    names = (type(edge.pcurve).__name__, type(edge.curve).__name__)
    return names in (("Geom2d_Line", "Geom_Line"), ("Geom2d_Line", "Geom_Circle"))


def _through_feet(edge: EdgeOnSurface, n: int, guesses: Array, images: Array) -> CurveForm:
    feet, shares = [], np.linspace(0.0, 1.0, GUESSES)
    for share in interpolation.nodes(n).tolist():
        target = edge.space(share).Coord()
        near = slice(*np.searchsorted(shares, [share - WINDOW, share + WINDOW]))
        guess = guesses[near][int(np.argmin(np.linalg.norm(images[near] - np.array(target), axis=1)))]
        feet.append(_foot(edge.surface, target, (float(guess[0]), float(guess[1]))))
    feet[0], feet[-1] = edge.flat(0.0), edge.flat(1.0)  # the loop is chained by these
    return interpolation.through(np.array(feet), *edge.pover)


def _foot(surface: Any, target: tuple[float, float, float], guess: tuple[float, float]) -> tuple[float, float]:
    """Parameters of the point of the surface next to ``target``, by Gauss-Newton from ``guess``.

    Each step solves the 2 x 2 normal equations of S_u du + S_v dv = target - S.
    """
    u, v = guess
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    x, y, z = target
    for _ in range(STEPS):
        surface.D1(u, v, point, along_u, along_v)
        px, py, pz = point.Coord()
        ux, uy, uz = along_u.Coord()
        vx, vy, vz = along_v.Coord()
        rx, ry, rz = x - px, y - py, z - pz
        uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
        ru, rv = rx * ux + ry * uy + rz * uz, rx * vx + ry * vy + rz * vz
        area = uu * vv - uv * uv
        if area <= FLAT * uu * vv:
            break
        du, dv = (ru * vv - rv * uv) / area, (rv * uu - ru * uv) / area
        u, v = u + du, v + dv
        if uu * du * du + vv * dv * dv < (0.01 * LEAST_GAP) ** 2:
            break
    return u, v


def _form_gap(edge: EdgeOnSurface, form: CurveForm, n: int) -> float:
    nodes = interpolation.nodes(n)
    gaps = []
    for share in (0.5 * (nodes[1:] + nodes[:-1])).tolist():
        u, v = form.point(form.t0 + share * (form.t1 - form.t0)).tolist()
        gaps.append(edge.space(share).Distance(edge.surface.Value(u, v)))
    return float(max(gaps))
