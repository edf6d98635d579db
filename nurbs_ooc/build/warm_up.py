"""What a worker can do before its first job: load the code of the stages, while the builder reads.

Python modules take half a second, the compiled kernels of the tessellator another half.
"""

from __future__ import annotations

import inspect

from nurbs_cache.jit import ran_before


def warm_up() -> None:
    """Import the stages; if their kernels have been compiled before, load those too.

    They are not compiled here: all workers would do it at once.
    """
    from nurbs_ooc.build import box_stage, mesh_stage, tile_stage  # noqa: F401 - loads them
    from nurbs_ooc.geometry.builder import BatchBuilder
    from nurbs_ooc.geometry.sample_faces import add_plane
    from nurbs_ooc.hierarchy.boxes import sketch_part

    if ran_before(inspect.getfile(box_stage)):
        builder = BatchBuilder()
        add_plane(builder)
        sketch_part(builder.build())
