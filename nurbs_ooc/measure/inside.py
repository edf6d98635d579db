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

CAUTION = 2.0  # times the bend that middles show: the band of a piece
THIN = 4.0 * np.finfo(float).eps  # of the largest parameters: bands below it are rounding
MAX_DEPTH = 60  # halvings within one another
MAX_HALVINGS = 2000  # of one piece for one ray; a handful is usual, contact of high order takes some more


@leaf
def _push(stack, top, t0, t1, a, b, c, d, band_u, band_v) -> None:  # type: ignore[no-untyped-def]
    piece = stack[top]
    piece[0], piece[1], piece[2], piece[3] = t0, t1, a, b
    piece[4], piece[5], piece[6], piece[7] = c, d, band_u, band_v


@leaf
def crosses(curves, values, coedges, segment, u, v, thin_u, thin_v, scratch, stack) -> bool:  # type: ignore[no-untyped-def]
    """Does the ray from (u, v) along +u cross the boundary piece an odd number of times?

    ``scratch`` is (2, MAX_DEGREE + 1), ``stack`` (MAX_DEPTH + 2, 8); bands below ``thin_u``, ``thin_v`` are none.
    """
    left, middle, right = local_table(2, 3), local_table(2, 3), local_table(2, 3)
    (a, b), (c, d) = segment.uv0, segment.uv1
    _push(stack, 0, segment.t0, segment.t1, a, b, c, d, segment.band[0], segment.band[1])
    odd, top, n = False, 1, 0
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
        half = 0.5 * (t0 + t1)
        if (band_u <= thin_u and band_v <= thin_v) or top + 2 > MAX_DEPTH or n == MAX_HALVINGS or not t0 < half < t1:
            # Orient the chord upwards, so that both its users round alike.
            if b > d:
                a, b, c, d = c, d, a, b
            odd = odd != (up and (c - a) * (v - b) - (u - a) * (d - b) > 0.0)
            continue
        n += 1
        curve = curves[coedges[segment.coedge].pcurve]
        curve_point(values, curve, half, scratch, middle)
        curve_point(values, curve, 0.5 * (t0 + half), scratch, left)
        curve_point(values, curve, 0.5 * (half + t1), scratch, right)
        p, q = middle[0, 0], middle[0, 1]
        # A half bends as its own middle shows, or a quarter as much as the whole.
        whole_u, whole_v = 0.25 * abs(p - 0.5 * (a + c)), 0.25 * abs(q - 0.5 * (b + d))
        own_u, own_v = abs(left[0, 0] - 0.5 * (a + p)), abs(left[0, 1] - 0.5 * (b + q))
        _push(stack, top, t0, half, a, b, p, q, CAUTION * max(own_u, whole_u), CAUTION * max(own_v, whole_v))
        own_u, own_v = abs(right[0, 0] - 0.5 * (p + c)), abs(right[0, 1] - 0.5 * (q + d))
        _push(stack, top + 1, half, t1, p, q, c, d, CAUTION * max(own_u, whole_u), CAUTION * max(own_v, whole_v))
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
    thin_u, thin_v = THIN * (abs(own[0]) + abs(own[2])), THIN * (abs(own[1]) + abs(own[3]))
    strip = strip_start[face] + strip_of(own, strip_start[face + 1] - strip_start[face], v)
    odd = False
    for e in range(entry_start[strip], entry_start[strip + 1]):
        if crosses(curves, values, coedges, segments[entries[e]], u, v, thin_u, thin_v, scratch, stack):
            odd = not odd
    return odd
