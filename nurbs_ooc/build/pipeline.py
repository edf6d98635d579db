"""The build: files in, a cache out.

::

    inputs --read--> parts, scene --box--> items --plant--> trees --tiles--> nodes --order--> errors
                        |                    |                |                |
                        `--------------------+--- store ------+----------------'

Each stage ends with a table in the store, and is skipped when that table is there: so a killed build
resumes. Nothing depends on the number of threads or on where a build was killed.
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
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build import tunables
from nurbs_ooc.build.box_stage import box_surfaces
from nurbs_ooc.build.codec_choice import DEFAULT_CODEC, codec_plan
from nurbs_ooc.build.error_order import order_errors
from nurbs_ooc.build.fingerprint import fingerprint
from nurbs_ooc.build.read_stage import read_inputs
from nurbs_ooc.build.target import open_target
from nurbs_ooc.build.tile_stage import Forest, build_tiles
from nurbs_ooc.hierarchy.lazy_octree import build_lazy_octree

Levels = Literal["root", "all"]


class Counter(Protocol):
    """A progress bar."""

    def advance(self, n: float = 1) -> None:
        """Count ``n`` more units as done."""


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
        workers: threads.
        resume: go on with what is there.
        force: replace what is there.
        codec: entropy coder of the tiles, "zstd" or "huffman".
    """

    levels: Levels = "all"
    workers: int = 1
    resume: bool = False
    force: bool = False
    codec: str = DEFAULT_CODEC


def build(inputs: Sequence[Path], cache: Path, options: BuildOptions, progress: ProgressBars, watch: Watch) -> None:
    """Build ``cache`` from ``inputs``.

    Args:
        inputs: CAD files or surface stores; several make one scene.
        cache: the folder to make; an existing one stays as it is until the new one is complete.
        options: see ``BuildOptions``.
        progress: makes a progress bar from a label and a total.
        watch: times the stages read, tessellate, hierarchy, hlod and write.

    Raises:
        UsageError, InputFileError, CacheError: one line each; nothing is half-written.
    """
    _check(inputs, cache)
    with open_target(cache, _plan(inputs, options.codec), resume=options.resume, force=options.force) as store:
        with watch.stage("read"), progress("reading surfaces", None) as bar:
            read_inputs(inputs, store, bar.advance)
        if not store.n_items():
            plant(store, options.workers, progress, watch)
        with watch.stage("hlod"), progress("building nodes", None) as bar:
            forest = Forest.load(store)
            missing = missing_tiles(forest.nodes, options.levels)
            build_tiles(store, forest, missing, options.workers, bar.advance)
        with watch.stage("write"):
            order_errors(store, forest.nodes, np.isin(np.arange(len(forest.nodes)), missing))


def plant(store: TypedStore, workers: int, progress: ProgressBars, watch: Watch) -> None:
    """Boxes of all surfaces, then the trees."""
    with watch.stage("tessellate"), progress("boxing surfaces", None) as bar:
        items, materials, faces = box_surfaces(store, workers, bar.advance)
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
            "shares": [
                tunables.SHARES.tessellation_levels,
                tunables.SHARES.quantisation,
                tunables.SHARES.point_diagonal,
            ],
        },
    }
