r"""Is a parameter inside a trimmed face? The even-odd rule against the exact boundary curves.

A ray to the right is tested against the boundary pieces of its own height. A piece is known to stay
within a band around its chord, so most are decided by their two ends; where the point lies in the
band itself, the exact curve is halved there until its band is as thin as float64 allows::

        piece wholly to the right: its ends decide       in its band: halve
    p --------------------/----->                     p --(--/--)-->

Source: M. Shimrat, Algorithm 112: Position of point relative to polygon, CACM 5(8), 1962.
"""

from __future__ import annotations

import numpy as np

from nurbs_cache.jit import leaf
from nurbs_cache.local_array import local_table
from nurbs_ooc.measure.exact_curve import curve_point

BAND_SHRINKS = 1.0 / 3.0  # of a smooth piece's band when it is halved: 1/4 in the limit
MAX_DEPTH = 60
STRAIGHT = 4.0 * np.finfo(float).eps  # bands below this share of the parameters are rounding


@leaf
def crosses(curves, values, coedges, segment, u, v, scratch, stack) -> bool:  # type: ignore[no-untyped-def]
    """Does the ray from (u, v) along +u cross the boundary piece an odd number of times?

    ``scratch`` is (2, MAX_DEGREE + 1), ``stack`` (MAX_DEPTH + 2, 8).
    """
    at = local_table(2, 3)
    stack[0, 0], stack[0, 1] = segment.t0, segment.t1
    stack[0, 2], stack[0, 3], stack[0, 4], stack[0, 5] = segment.uv0[0], segment.uv0[1], segment.uv1[0], segment.uv1[1]
    stack[0, 6], stack[0, 7] = segment.band[0], segment.band[1]
    odd, top = False, 1
    while top > 0:
        top -= 1
        t0, t1, a, b = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        c, d, band_u, band_v = stack[top, 4], stack[top, 5], stack[top, 6], stack[top, 7]
        if v < min(b, d) - band_v or v > max(b, d) + band_v or u > max(a, c) + band_u:
            continue
        up = (b <= v) != (d <= v)
        if u < min(a, c) - band_u:
            odd = odd != up
            continue
        middle = 0.5 * (t0 + t1)
        thin = band_u <= STRAIGHT * (abs(a) + abs(c)) and band_v <= STRAIGHT * (abs(b) + abs(d))
        if thin or top > MAX_DEPTH - 2 or not t0 < middle < t1:
            # Orient the chord upwards, so that both its users round alike.
            if b > d:
                a, b, c, d = c, d, a, b
            odd = odd != (up and (c - a) * (v - b) - (u - a) * (d - b) > 0.0)
            continue
        curve_point(values, curves[coedges[segment.coedge].pcurve], middle, scratch, at)
        for k in range(2):
            stack[top + k, 6], stack[top + k, 7] = BAND_SHRINKS * band_u, BAND_SHRINKS * band_v
        stack[top, 0], stack[top, 1] = t0, middle
        stack[top, 2], stack[top, 3], stack[top, 4], stack[top, 5] = a, b, at[0, 0], at[0, 1]
        stack[top + 1, 0], stack[top + 1, 1] = middle, t1
        stack[top + 1, 2], stack[top + 1, 3], stack[top + 1, 4], stack[top + 1, 5] = at[0, 0], at[0, 1], c, d
        top += 2
    return odd


@leaf
def strip_of(bounds, n, v) -> int:  # type: ignore[no-untyped-def]
    """Which of ``n`` horizontal strips over a face's bounds the height ``v`` falls in."""
    height = bounds[3] - bounds[1]
    share = (v - bounds[1]) / height if height > 0.0 else 0.0
    return min(n - 1, max(0, int(share * n)))


@leaf
def is_inside(pieces, face, u, v, scratch, stack) -> bool:  # type: ignore[no-untyped-def]
    """Even-odd rule for one face; ``pieces`` is ``TrimRegion.pieces``."""
    curves, values, coedges, segments, bounds, strip_start, entry_start, entries = pieces
    own = bounds[face]
    if not (own[0] <= u <= own[2] and own[1] <= v <= own[3]):
        return False
    strip = strip_start[face] + strip_of(own, strip_start[face + 1] - strip_start[face], v)
    odd = False
    for e in range(entry_start[strip], entry_start[strip + 1]):
        if crosses(curves, values, coedges, segments[entries[e]], u, v, scratch, stack):
            odd = not odd
    return odd
