"""Where a loop runs: parameters on the surface at a parameter of the shared edge."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.geometry.curve import curve_point
from nurbs_ooc.geometry.tables import Tables

Floats = npt.NDArray[np.float64]


@leaf
def coedge_uv(g: Tables, c: int, t: float, scratch: Floats, out: Floats) -> None:
    """Write (u, v) of coedge ``c`` at parameter ``t`` of its edge to ``out[:2]`` (size >= 6).

    ``scratch`` is (>= 2, MAX_DEGREE + 2).
    """
    coedge = g.coedges[c]
    edge = g.edges[coedge.edge]
    curve = g.curves[coedge.pcurve]
    along = (t - edge.t0) * (curve.t1 - curve.t0) / (edge.t1 - edge.t0)
    curve_point(g, coedge.pcurve, curve.t0 + along, scratch, out)
