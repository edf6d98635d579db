"""The build: files in, a cache out.

::

    inputs --read--> parts, scene --box--> items --plant--> trees --mesh--> meshes --tiles--> nodes --order--> errors
                        |                    |                |               |                 |
                        |                  spill              |             spill               |
                        `--------------------+--------------- store ----------+-----------------'

Each stage ends with a table in the store or files in the spill folder, and what is there is not made
again: so a killed build resumes. Nothing depends on who does the jobs or on where a build was killed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError
from nurbs_cache.store import Store
from nurbs_ooc.build import tunables
from nurbs_ooc.build.box_stage import box_surfaces
from nurbs_ooc.build.codec_choice import DEFAULT_CODEC, codec_plan
from nurbs_ooc.build.crew import Crew, SoloCrew
from nurbs_ooc.build.dask_crew import DaskCrew
from nurbs_ooc.build.error_order import order_errors
from nurbs_ooc.build.fingerprint import fingerprint
from nurbs_ooc.build.forest import Forest
from nurbs_ooc.build.freed_memory import return_freed_memory
from nurbs_ooc.build.memory import DEFAULT_MEMORY, check_memory, check_tables
from nurbs_ooc.build.mesh_stage import mesh_surfaces_of_runs
from nurbs_ooc.build.process_crew import ProcessCrew
from nurbs_ooc.build.read_stage import read_inputs
from nurbs_ooc.build.spill import spill_folder
from nurbs_ooc.build.surface_runs import surface_runs
from nurbs_ooc.build.target import open_target
from nurbs_ooc.build.tile_stage import build_tiles
from nurbs_ooc.build.workshop import Workshop
from nurbs_ooc.hierarchy.lazy_octree import build_lazy_octree

Levels = Literal["root", "all"]


class Counter(Protocol):
    """A progress bar."""

    def advance(self, n: float = 1) -> None:
        """Count ``n`` more units as done."""

    def set_total(self, total: float) -> None:
        """Tell how many units there are."""


class Watch(Protocol):
    """A stop watch of named stages."""

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Count the block's time as ``name``."""


ProgressBars = Callable[[str, float | None], AbstractContextManager[Counter]]


@dataclass(frozen=True)
class BuildOptions:
    """What the user chose.

    Attributes:
        levels: tiles of the roots only, or of all nodes; the rest is built on demand.
        workers: processes that work beside this one; 1: this one alone.
        resume: go on with what is there.
        force: replace what is there.
        codec: entropy coder of the tiles, "zstd" or "huffman".
        memory: bytes for all processes together.
        dask: address of a Dask scheduler whose workers do the work instead; they are outside ``memory``.
    """

    levels: Levels = "all"
    workers: int = 1
    resume: bool = False
    force: bool = False
    codec: str = DEFAULT_CODEC
    memory: int = DEFAULT_MEMORY
    dask: str | None = None

    @property
    def local_workers(self) -> int:
        """Workers that share this machine's memory with the builder."""
        return 1 if self.dask else self.workers


def build(inputs: Sequence[Path], cache: Path, options: BuildOptions, progress: ProgressBars, watch: Watch) -> None:
    """Build ``cache`` from ``inputs``.

    Args:
        inputs: CAD files or surface stores; several make one scene.
        cache: the folder to make; an existing one stays as it is until the new one is complete.
        options: see ``BuildOptions``.
        progress: makes a progress bar from a label and a total.
        watch: times the stages read, box, hierarchy, tables, tessellate, hlod and write.

    Raises:
        UsageError, InputFileError, CacheError: one line each; nothing is half-written.
    """
    _check(inputs, cache)
    check_memory(options.memory, options.local_workers)
    return_freed_memory()
    with (
        _crew(options) as crew,
        open_target(cache, _plan(inputs, options.codec), resume=options.resume, force=options.force) as store,
        spill_folder(cache, fresh=not options.resume) as spill,
    ):
        shop = Workshop(store.path.resolve(), spill.resolve(), options.codec)
        with watch.stage("read"), progress("reading surfaces", None) as bar:
            read_inputs(inputs, store, bar.advance)
        if not store.n_items():
            plant(store, crew, shop, progress, watch)
        with watch.stage("tables"):
            forest = Forest.load(store)
            check_tables(options.memory, options.local_workers, forest)
            missing = missing_tiles(forest.nodes, options.levels)
            demand = forest.demand
            wanted = demand if len(missing) == len(forest.nodes) else forest.demand_of(missing)
        with watch.stage("tessellate"), progress("tessellating surfaces", len(wanted)) as bar:
            runs = surface_runs(store.part_infos())
            mesh_surfaces_of_runs(store, crew, shop, runs, wanted, demand, bar.advance)
        with watch.stage("hlod"), progress("building nodes", len(missing)) as bar:
            build_tiles(store, forest, missing, crew, shop, bar.advance)
        with watch.stage("write"):
            order_errors(store, forest.nodes, np.isin(np.arange(len(forest.nodes)), missing))


def _crew(options: BuildOptions) -> Crew:
    if options.dask:
        return DaskCrew(options.dask)
    return SoloCrew() if options.workers == 1 else ProcessCrew(options.workers)


def plant(store: Store, crew: Crew, shop: Workshop, progress: ProgressBars, watch: Watch) -> None:
    """Boxes of all surfaces, then the trees."""
    runs = surface_runs(store.part_infos())
    n_surfaces = sum(run.n_surfaces for run in runs)
    with watch.stage("box"), progress("boxing surfaces", n_surfaces) as bar:
        items, materials, faces = box_surfaces(crew, shop, runs, bar.advance)
    with watch.stage("hierarchy"):
        nodes, items = build_lazy_octree(items, materials, tunables.EDGE_OVER_ERROR)
        store.put_face_report(faces)
        store.put_tree(nodes, items, {"edge_over_error": tunables.EDGE_OVER_ERROR})


def missing_tiles(nodes: npt.NDArray[np.void], levels: Levels) -> npt.NDArray[np.int64]:
    """Rows of the wanted nodes that have no tile."""
    wanted = nodes["parent"] < 0 if levels == "root" else np.ones(len(nodes), np.bool_)
    return np.flatnonzero(wanted & (nodes["tile_hash"] == b""))


def _check(inputs: Sequence[Path], cache: Path) -> None:
    if not inputs:
        raise UsageError("build: no input")
    for path in inputs:
        if path.resolve() == cache.resolve():
            raise UsageError(f"{cache}: is an input and cannot be the cache too")


def _plan(inputs: Sequence[Path], codec: str) -> dict[str, Any]:
    """What a build is made from; kept in the store so that it is not resumed with something else."""
    return {
        **codec_plan(codec),
        "inputs": [fingerprint(path) for path in inputs],
        "tunables": {
            "edge_over_error": tunables.EDGE_OVER_ERROR,
            "primitives_per_node": tunables.PRIMITIVES_PER_NODE,
            "shares": [
                tunables.SHARES.tessellation_levels,
                tunables.SHARES.quantisation,
                tunables.SHARES.point_diagonal,
                tunables.SHARES.coarsest_mesh,
            ],
        },
    }
