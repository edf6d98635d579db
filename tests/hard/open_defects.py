"""Cases whose whole truth the tessellator does not meet yet; docs/hard_cases.md says how it fares with them.

A name leaves this list with the change that makes its tests pass.
"""

from __future__ import annotations

OPEN_DEFECTS = frozenset(
    {
        # A knot of multiplicity p + 1 is refused instead of drawn as two components.
        "knot_p+1_two_components",
    }
)
