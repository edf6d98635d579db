"""Every number that trades size, speed and quality of a build, with its unit and the reason for its value."""

from __future__ import annotations

from nurbs_ooc.hlod.budget import Shares

EDGE_OVER_ERROR = 512.0
"""r: a node's longest edge over its error budget, which is then rounded down to a power of two.

A node takes over from its parent while a pixel is about four budgets wide and gives way to its children at
two: it covers r / 4 to r / 2 pixels (128 to 256) when it becomes active and twice that at the end. Larger
r means fewer nodes and direct surfaces in a view but more primitives in each; docs/build.md has the figures.
"""

PRIMITIVES_PER_NODE = 1 << 16
"""Triangles, lines and points of a node at most: r^2 / 4, one for four of the pixels that it covers at its largest.

Where a node's budget gives more, its clustering is coarsened and its error is larger than its budget: it gives way to
its children earlier. docs/build.md has the figures.
"""

STEP_LEVELS = 6
"""A tile's positions lie on a grid of 2**-6 of its budget: 2 r budgets need 16 bits, and rounding costs
0.0136 budgets. Tiles of one level share the grid, so positions that are equal stay equal in all of them."""

POSITION_BITS = 21
"""Most bits per coordinate: what float32 holds. A coarser grid is taken, and charged, where it is too few."""

NORMAL_BITS = 10
"""Bits per octahedral coordinate of a normal: 0.2 degrees."""

SHARES = Shares(tessellation_levels=1, quantisation=2.0**-STEP_LEVELS, point_diagonal=1.0, coarsest_mesh=4)
"""How a node's budget is shared: half for the tessellation, 1/64 for quantisation, the rest for clustering.

A surface with a box diagonal of one budget becomes a point at a cost of half a budget, the tessellation's.
Meshes are no coarser than a sixteenth of the diagonal: a surface of up to four pixels has one mesh for all nodes that
show it so small, whose vertices clustering merges anyway. That makes 3 % more bytes and 15 % fewer meshes.
"""

SURFACES_PER_RUN = 512
"""Surfaces that one job boxes or tessellates, in one batch: a fifth of a second of work, some 20 MiB. Half as many take
4 % more processor time, four times as many 3 % less and 50 MiB more a worker.
Parts with twice as many are cut; at each cut the surfaces beside it are tessellated twice."""

BATCH_BYTES = 4 << 20
"""Knots and control points in one batch: their derivative bounds take up to seven times as much. Runs of the c-class
have 2 MB in the mean; runs of more are done in several batches, of whole parts or of pieces of a large one."""

MESHES_PER_JOB = 2_000
"""Placed meshes in the nodes of one job: a second of work, some 40 MiB. A node is never cut in two."""

ITEMS_PER_JOB = 100_000
"""Placed surfaces in the nodes of one job, meshes or points: some 10 MiB to send."""

STORED_AT_ONCE = 4 << 20
"""Bytes of tiles in one transaction: what a kill loses. Tiles go to random pages of the store, and the system maps
16 pages around each that is touched, so that 16 MiB of tiles would take 400 MiB of memory."""
