"""Stage 2: the placed surfaces with their boxes, and how every face came through."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.node_record import ITEM_DTYPE
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.workers import run_in_order
from nurbs_ooc.hierarchy.boxes import PartSketch, placed_items, sketch_part

Sketched = tuple[PartSketch, npt.NDArray[np.int32]]


def box_surfaces(
    store: TypedStore, workers: int, advance: Callable[[int], None]
) -> tuple[npt.NDArray[np.void], npt.NDArray[np.int32], npt.NDArray[np.void]]:
    """Sketch every part once and place it as often as it occurs.

    Args:
        store: with parts and scene.
        workers: threads.
        advance: told the number of surfaces of each part that is done.

    Returns:
        The items (``ITEM_DTYPE``, by occurrence, then surface), the material of each, and the face report.
    """
    infos, occurrences = store.part_infos(), store.get_occurrences()
    rows_of_part = np.argsort(occurrences["part"], kind="stable")
    first = np.searchsorted(occurrences["part"][rows_of_part], np.arange(len(infos) + 1))
    items, materials, reports = [np.zeros(0, ITEM_DTYPE)], [np.zeros(0, np.int32)], [np.zeros(0, FACE_REPORT_DTYPE)]
    jobs = (partial(_sketch, store, index) for index in range(len(infos)))
    for index, (sketch, own_materials) in enumerate(run_in_order(jobs, workers)):
        rows = rows_of_part[first[index] : first[index + 1]]
        placed = placed_items(sketch, infos[index].first_surface, rows, occurrences["transform"][rows])
        items.append(placed)
        override = occurrences["material"][placed["occurrence"]]
        own = own_materials[(placed["surface"] - np.uint64(infos[index].first_surface)).astype(np.int64)]
        materials.append(np.where(override >= 0, override, own))
        reports.append(_face_report(sketch, infos[index].first_surface))
        advance(infos[index].n_surfaces)
    return np.concatenate(items), np.concatenate(materials), np.concatenate(reports)


def _sketch(store: TypedStore, index: int) -> Sketched:
    geometry = store.get_part(index)
    return sketch_part(geometry), geometry.surfaces["material"].copy()


def _face_report(sketch: PartSketch, first_surface: int) -> npt.NDArray[np.void]:
    """``FACE_REPORT_DTYPE`` rows of a part."""
    report = np.zeros(len(sketch.error), FACE_REPORT_DTYPE)
    report["surface"] = first_surface + np.arange(len(report))
    report["status"], report["reason"], report["certified"] = sketch.status, sketch.reason, sketch.error
    return report
