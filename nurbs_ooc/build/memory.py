"""What a build may use of the machine's memory, and what it needs at least.

All processes together: this one with the tables of the trees, and the workers with one job each. Jobs are
cut to a size that does not depend on the model, so the tables alone grow with it.
"""

from __future__ import annotations

from nurbs_cache.errors import UsageError
from nurbs_ooc.build.forest import Forest

MIB = 1 << 20
DEFAULT_MEMORY = 1 << 30

OWN_BYTES = 180 * MIB  # this process without tables: interpreter, libraries, a transaction of parts
WORKER_BYTES = 230 * MIB  # a worker with its kernels loaded, 160 MiB, and a job: measured at most 60 MiB
TABLE_BYTES_PER_ITEM = 280  # item 88, its diagonal 8, sorting and mesh keys at most 180 while they are made


def check_memory(memory: int, workers: int) -> None:
    """Refuse a budget that the workers alone exceed.

    Raises:
        UsageError: with the least that will do.
    """
    least = OWN_BYTES + WORKER_BYTES * (workers if workers > 1 else 0)
    if memory < least:
        fewer = ", or fewer workers" if workers > 1 else ""
        raise UsageError(f"--memory {memory // MIB} MiB: --workers {workers} needs at least {least // MIB} MiB{fewer}")


def check_tables(memory: int, workers: int, forest: Forest) -> None:
    """Refuse a model whose trees do not fit beside the workers.

    Raises:
        UsageError: with the least that will do.
    """
    tables = TABLE_BYTES_PER_ITEM * len(forest.items) + 2 * forest.nodes.nbytes
    least = OWN_BYTES + WORKER_BYTES * (workers if workers > 1 else 0) + tables
    if memory < least:
        raise UsageError(
            f"--memory {memory // MIB} MiB: {len(forest.items)} placed surfaces need at least {least // MIB} MiB "
            f"with --workers {workers}"
        )
