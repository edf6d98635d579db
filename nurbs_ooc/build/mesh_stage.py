"""Stage 4: every mesh that a node needs, run by run of surfaces, to files.

The parts of a run are read once and tessellated together, at all their levels in a row; however many nodes
and placements show a surface at a level, its mesh is made once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.crew import Crew
from nurbs_ooc.build.face_report import add_to_report, worst_rows
from nurbs_ooc.build.fragments import checked_slots, write_fragments
from nurbs_ooc.build.mesh_demand import SURFACE_MASK, Keys, MeshDemand
from nurbs_ooc.build.surface_meshes import mesh_slices
from nurbs_ooc.build.surface_runs import SurfaceRun
from nurbs_ooc.build.workshop import Bench, Workshop


class MeshJob(NamedTuple):
    """The meshes of a run.

    Attributes:
        run: its number.
        keys: mesh keys to make, ascending.
        demanded: all keys of the run's parts that any node needs, ascending.
    """

    run: int
    keys: Keys
    demanded: Keys


def mesh_jobs(runs: Sequence[SurfaceRun], missing: MeshDemand, demand: MeshDemand) -> list[MeshJob]:
    """Share out the missing meshes among the runs; runs that need none are left out."""
    jobs = []
    for number, run in enumerate(runs):
        keys = missing.of_surfaces(run.first_surface, run.n_surfaces)
        if len(keys):
            jobs.append(MeshJob(number, keys, demand.of_surfaces(*run.surfaces_of_parts)))
    return jobs


def mesh_run(bench: Bench, job: MeshJob) -> npt.NDArray[np.void]:
    """Make the file of a run if it is not there yet.

    Returns:
        ``FACE_REPORT_DTYPE`` rows: how its surfaces came through.
    """
    run = bench.runs[job.run]
    path = bench.shelf.path_of(run)
    slots = _left_from_before(path, job.keys)
    if slots is None:
        slots = write_fragments(path, mesh_slices(bench.store, run.slices, job.keys, job.demanded))
        bench.rest()
    return worst_rows(slots["key"] & SURFACE_MASK, slots["status"], slots["reason"], slots["errors"].sum(axis=1))


def _left_from_before(path: Path, keys: Keys) -> npt.NDArray[np.void] | None:
    """The slots of a file that a former build has left, if it is whole and has all ``keys``."""
    if not path.exists():
        return None
    try:
        slots = checked_slots(path)
    except CorruptRecordError:
        return None
    return slots if np.isin(keys, slots["key"]).all() else None


def mesh_surfaces_of_runs(
    store: TypedStore, crew: Crew, shop: Workshop, runs: Sequence[SurfaceRun], missing: MeshDemand,
    demand: MeshDemand, advance: Callable[[int], None],
) -> None:  # fmt: skip
    """Have all missing meshes made, and the face report brought up to date.

    Args:
        store: the report is written to it.
        crew: does the work.
        shop: where the files go.
        runs: of all surfaces.
        missing: what the nodes need that are built now.
        demand: what all nodes need.
        advance: told how many meshes were made.
    """
    jobs = mesh_jobs(runs, missing, demand)
    reports = []
    for job, report in zip(jobs, crew.run(mesh_run, shop, jobs), strict=True):
        reports.append(report)
        advance(len(job.keys))
    add_to_report(store, reports)
