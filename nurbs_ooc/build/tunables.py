"""Every number that trades size, speed and quality of a build, with its unit and the reason for its value."""

from __future__ import annotations

from nurbs_ooc.hlod.budget import Shares

EDGE_OVER_ERROR = 256.0
"""r: a node's longest edge over its error budget, which is then rounded down to a power of two.

A node is drawn while a pixel is between one and two budgets wide, so it covers r / 4 to r pixels: 64 to
256 here. The paper bounds the primitives of a node by r**3 / 8.
"""

STEP_LEVELS = 6
"""A tile's positions lie on a grid of 2**-6 of its budget: 2 r budgets need 15 bits, and rounding costs
0.0136 budgets. Tiles of one level share the grid, so positions that are equal stay equal in all of them."""

POSITION_BITS = 21
"""Most bits per coordinate: what float32 holds. A coarser grid is taken, and charged, where it is too few."""

NORMAL_BITS = 10
"""Bits per octahedral coordinate of a normal: 0.2 degrees."""

SHARES = Shares(tessellation_levels=1, quantisation=2.0**-STEP_LEVELS, point_diagonal=1.0)
"""How a node's budget is shared: half for the tessellation, 1/64 for quantisation, the rest for clustering.

A surface with a box diagonal of one budget becomes a point at a cost of half a budget, the tessellation's.
"""

SURFACES_PER_BATCH = 20_000
"""Meshes (surface, level) held at a time; at 10 KiB each some 200 MiB. A node is never cut in two."""

ITEMS_PER_BATCH = 400_000
"""Placed surfaces in the nodes of one batch: bounds the index arrays at some tens of MiB."""
