"""How many columns and rows the grid of triangles over a cell needs.

(a^2 M_uu / n_u^2 + 2 a b M_uv / (n_u n_v) + b^2 M_vv / n_v^2) / 8 <= error
"""

from __future__ import annotations

import math

from nurbs_cache.jit import leaf


@leaf
def grid_counts(muu: float, muv: float, mvv: float, a: float, b: float, error: float) -> tuple[int, int]:
    """Fewest columns and rows (in product, nearly) whose triangles keep the error."""
    cu = a * a * muu / (8.0 * error)
    cv = b * b * mvv / (8.0 * error)
    cm = 2.0 * a * b * muv / (8.0 * error)
    if cu + cv + cm <= 1.0:
        return 1, 1
    nu = max(1.0, math.floor(math.sqrt(min(cu, 1e16))))
    nv = max(1.0, math.floor(math.sqrt(min(cv, 1e16))))
    total = cu / (nu * nu) + cv / (nv * nv) + cm / (nu * nv)
    if total > 1.0:
        # Scale both as the optimum of the continuous problem asks, then finish in single steps.
        grow = math.sqrt(total)
        if cu > 1.0 and cv > 1.0:
            nu = max(1.0, math.floor(nu * grow * 0.9))
            nv = max(1.0, math.floor(nv * grow * 0.9))
        elif cm > 1.0 and cu <= 1.0 and cv <= 1.0:
            side = math.sqrt(cm)
            nu = max(1.0, math.floor(side * math.sqrt(a / b) * 0.5)) if b > 0.0 else 1.0
            nu = min(nu, side)
            nv = max(1.0, math.floor(0.9 * cm / nu))
    steps = 0
    while steps < 4096:
        # Of a cell: its width, and that of one column or row more.
        u, v, finer_u, finer_v = 1.0 / nu, 1.0 / nv, 1.0 / (nu + 1.0), 1.0 / (nv + 1.0)
        if cu * u * u + cv * v * v + cm * u * v <= 1.0:
            break
        less_u = (u - finer_u) * (cu * (u + finer_u) + cm * v)
        less_v = (v - finer_v) * (cv * (v + finer_v) + cm * u)
        # What a step saves against what it costs.
        if less_u * nu >= less_v * nv:
            nu += max(1.0, math.floor(nu * 0.02))
        else:
            nv += max(1.0, math.floor(nv * 0.02))
        steps += 1
    return int(min(nu, 1e9)), int(min(nv, 1e9))
