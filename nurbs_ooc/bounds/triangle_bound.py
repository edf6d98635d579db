r"""How far a triangle with corners on a surface is from it, given bounds of the second derivatives around it.

With barycentric weights l_i of a point, corners p_i and d_ij = p_i - p_j in parameters, the remainder
of Taylor's formula gives for the linear interpolant L ::

    S - L = -1/2 sum_i l_i H_i[p_i - q]        H_i: a mean of the second derivative, H[d] = H(d, d)

If all second derivatives lie within a ball, S_uu in C_uu + r_uu and so on, the common part C is a
quadratic form, for which sum_i l_i C[p_i - q] = sum_{i<j} l_i l_j C[d_ij], and the rest is at most
(a^2 r_uu + 2 a b r_uv + b^2 r_vv) / 8 on a triangle in an a x b box. So ::

    |S - L| <= 1/2 max_l sum_{i<j} l_i l_j |C[d_ij]| + (a^2 r_uu + 2 a b r_uv + b^2 r_vv) / 8

which charges no twist that the diagonal follows, and no more than the longest edge where directions
agree. With C = 0 and norms in place of radii the sum of the pure terms may still be taken over edges.
The smaller of both holds.

Source: D. Filip, R. Magedson, R. Markot, "Surface algorithms using bounds on derivatives",
Computer Aided Geometric Design 3, 1986, theorem 1 (the box's bound); the rest is proved above.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nurbs_cache.jit import leaf
from nurbs_ooc.bounds.derivatives import BOXES

Floats = npt.NDArray[np.float64]

# What is known of second derivatives: |S_uu|, |S_uv|, |S_vv|, the boxes of these vectors, the boxes' radii.
RADII = 3 + BOXES
MEASURES = RADII + 3


@leaf
def largest_mean(p: float, q: float, r: float) -> float:
    """Largest value of l1 l2 p + l1 l3 q + l2 l3 r over non-negative weights of sum 1; p, q, r >= 0."""
    if r >= p + q:
        return 0.25 * r
    if q >= p + r:
        return 0.25 * q
    if p >= q + r:
        return 0.25 * p
    # The denominator is 2 (pq + pr + qr) - p^2 - q^2 - r^2; written with the smallest number apart, of which the others
    # differ by less, it loses no digits however small that is.
    if q < p and q <= r:
        p, q = q, p
    elif r < p:
        p, r = r, p
    return p * q * r / (p * (2.0 * (q + r) - p) - (q - r) * (q - r))


@leaf
def _form(boxes: Floats, x: float, y: float) -> float:
    """|C[d]| for d = (x, y), C the middle of the boxes."""
    size = 0.0
    for k in range(3):
        uu = boxes[k] + boxes[3 + k]
        uv = boxes[6 + k] + boxes[9 + k]
        vv = boxes[12 + k] + boxes[15 + k]
        c = 0.5 * (x * x * uu + 2.0 * x * y * uv + y * y * vv)
        size += c * c
    return math.sqrt(size)


@leaf
def box_radii(m: Floats) -> None:
    """Half the diagonals of the boxes of the second derivatives ``m[3:21]``, to ``m[21:24]``."""
    for which in range(3):
        size = 0.0
        for k in range(3 + 6 * which, 6 + 6 * which):
            size += (m[k + 3] - m[k]) ** 2
        m[RADII + which] = 0.5 * math.sqrt(size)


@leaf
def _middle(boxes: Floats, at: int) -> float:
    """Norm of the middle of the box at ``at``."""
    size = 0.0
    for k in range(3):
        size += (boxes[at + 3 + k] + boxes[at + k]) ** 2
    return 0.5 * math.sqrt(size)


@leaf
def corner_hair(m: Floats, du: float, dv: float) -> float:
    """What second derivatives ``m`` outside of a triangle's box may add if its corners lie up to (du, dv) beyond it.

    Corners p_i are drawn back to p'_i in the box, by d_i. Then S - L at q is that of the drawn back triangle at q',
    and sum_i l_i (grad S(q') - grad S(p'_i)) d_i, which is in ``rounding_slack``, and remainders that this bounds.
    """
    return m[0] * du * du + 2.0 * m[1] * du * dv + m[2] * dv * dv


@leaf
def rounding_slack(m: Floats, a: float, b: float, du: float, dv: float) -> float:
    """What an uncertainty of (du, dv) in the parameters of each corner may add to a bound in an a x b box.

    Four parts for the gradients' change over the box (see ``corner_hair``), one for that of the corners' differences.
    """
    pure = m[0] * (2.0 * a + du) * du + m[2] * (2.0 * b + dv) * dv
    return 1.25 * (0.5 * pure + m[1] * (a * dv + b * du + du * dv))


@leaf
def norm_bound(
    m: Floats, x0: float, y0: float, x1: float, y1: float, x2: float, y2: float, du: float, dv: float
) -> float:
    """Bound of the deviation of a triangle from norms of second derivatives, in the surface's unit of length.

    Args:
        m: |S_uu|, |S_uv|, |S_vv|.
        x0, y0, x1, y1, x2, y2: corners, in parameters.
        du, dv: uncertainty of every corner's parameters.
    """
    a = max(x0, x1, x2) - min(x0, x1, x2)
    b = max(y0, y1, y2) - min(y0, y1, y2)
    p = m[0] * (x1 - x0) ** 2 + m[2] * (y1 - y0) ** 2
    q = m[0] * (x2 - x0) ** 2 + m[2] * (y2 - y0) ** 2
    r = m[0] * (x2 - x1) ** 2 + m[2] * (y2 - y1) ** 2
    return 0.5 * largest_mean(p, q, r) + 0.25 * a * b * m[1] + rounding_slack(m, a, b, du, dv)


@leaf
def vector_bound(
    m: Floats, x0: float, y0: float, x1: float, y1: float, x2: float, y2: float, du: float, dv: float
) -> float:
    """The same from the boxes of the second derivatives and their radii, which follow the norms in ``m``."""
    a = max(x0, x1, x2) - min(x0, x1, x2)
    b = max(y0, y1, y2) - min(y0, y1, y2)
    boxes = m[3:]
    p = _form(boxes, x1 - x0, y1 - y0)
    q = _form(boxes, x2 - x0, y2 - y0)
    r = _form(boxes, x2 - x1, y2 - y1)
    rest = a * a * m[RADII] + 2.0 * a * b * m[RADII + 1] + b * b * m[RADII + 2]
    return 0.5 * largest_mean(p, q, r) + 0.125 * rest + rounding_slack(m, a, b, du, dv)


@leaf
def grid_bounds(m: Floats) -> tuple[float, float, float]:
    """Effective |S_uu|, |S_uv|, |S_vv| for planning a grid of halved rectangles over a cell.

    The middles' part is scaled by what the bound of a right triangle saves on the sum of norms, at the
    shape that spends as much on either side; radii are added. No promise: triangles are checked one by one.
    """
    boxes = m[3:]
    uu, uv, vv = _middle(boxes, 0), _middle(boxes, 6), _middle(boxes, 12)
    r_uu, r_uv, r_vv = m[RADII], m[RADII + 1], m[RADII + 2]
    scale = 1.0
    if uu > 0.0 and vv > 0.0:
        x, y = 1.0 / math.sqrt(uu), 1.0 / math.sqrt(vv)
        diagonal = min(_form(boxes, x, y), _form(boxes, x, -y))
        scale = 0.5 * largest_mean(1.0, 1.0, diagonal) / ((2.0 + 2.0 * x * y * uv) / 8.0)
    return min(scale * uu + r_uu, m[0]), min(scale * uv + r_uv, m[1]), min(scale * vv + r_vv, m[2])
