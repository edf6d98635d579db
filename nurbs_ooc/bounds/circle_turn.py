r"""How far interpolated normals of circular cylinders and of cones may turn from the surface's: the worst case.

Of a circular cylinder the worst case is known: x_i, the angles from their mean, make a turn of
atan(sum l_i sin x_i / sum l_i cos x_i), which for given l_i x_i of sum 0 is largest for two corners only (a
linear functional on a polygon of weights has its largest value at a corner), so with h = a / 2, t = tan h ::

    f(a) = max over w of |atan(w t) - w h| = atan(x) - h x / t      x = sqrt(t / h - 1)

A cone's normals make an angle b with the plane across the axis, the horizontal part of m shrinks to cos(a / 2)
at worst, so m is steeper by at most atan(tan b / cos(a / 2)) - b, and turned about the axis by f(a).
"""

from __future__ import annotations

import math

from nurbs_cache.jit import leaf
from nurbs_ooc.geometry.surface import CYLINDER
from nurbs_ooc.geometry.tables import Tables

# What roundoff of a few hundred operations on numbers of size 1 may add to an angle.
HAIR = 2.0**-40


@leaf
def turn_of_circle(a: float) -> float:
    """f(a) of the module: the largest error of interpolating normals on an arc of ``a`` radians, a < pi."""
    h = 0.5 * a
    if h < 1e-4:
        # 2 h^3 / (9 sqrt(3)), and a little for the next term.
        return 0.1284 * h * h * h
    t = math.tan(h)
    x = math.sqrt(max(t / h - 1.0, 0.0))
    return math.atan(x) - h * x / t


@leaf
def is_circular(g: Tables, row: int) -> bool:
    """Whether a cylinder is a circular, straight one."""
    f = g.surfaces[row].frame
    xx, yy, xy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        x, y, z = g.values[f + 3 + k], g.values[f + 6 + k], g.values[f + 9 + k]
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    hair = 1e-13
    return (
        abs(xx - yy) <= hair * xx and abs(xy) <= hair * xx
        and xz * xz <= hair * hair * xx * zz and yz * yz <= hair * hair * yy * zz
    )  # fmt: skip


@leaf
def circle_bound(g: Tables, row: int, a: float) -> float:
    """Bound for a circular cylinder or a cone over an angle ``a``."""
    if not a < 2.5:
        return math.inf
    turn = turn_of_circle(a)
    if g.surfaces[row].kind == CYLINDER:
        return turn + HAIR
    b = abs(g.values[g.surfaces[row].frame + 13])
    steeper = math.atan2(math.sin(b), math.cos(b) * math.cos(0.5 * a)) - b
    return math.cos(b) * turn + steeper + HAIR
