"""Cases whose whole truth the tessellator does not meet yet; docs/hard_cases.md says how it fares with them.

A name leaves this list with the change that makes its tests pass.
"""

from __future__ import annotations

OPEN_DEFECTS = frozenset(
    {
        # A few triangles beside a pole or a collapsed edge are folded over.
        "rational_cone",
        "rational_lemon",
        "quarter_disc_collapsed_edge",
        # An apex has one normal for all directions.
        "cone",
        "lemon",
        # A knot of multiplicity p has one normal instead of two, one of multiplicity p + 1 is refused instead of
        # drawn as two components.
        "crease_flat",
        "crease_between_arcs",
        "knot_p+1_two_components",
        # Its web is drawn by the even-odd rule at one error.
        "near_hole_web_5e-07",
    }
)
