"""Stage 2: the placed surfaces with their boxes, and how every face came through, run by run of surfaces."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nurbs_cache import record
from nurbs_cache.errors import CorruptRecordError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.node_record import ITEM_DTYPE
from nurbs_cache.surface_record import GeometryBatch
from nurbs_ooc.build.crew import Crew
from nurbs_ooc.build.run_geometry import part_batches
from nurbs_ooc.build.spill import new_file
from nurbs_ooc.build.surface_runs import PartSlice, SurfaceRun
from nurbs_ooc.build.workshop import Bench, Workshop
from nurbs_ooc.geometry.join import join_parts
from nurbs_ooc.geometry.subset import subset
from nurbs_ooc.hierarchy.boxes import PartSketch, placed_items, sketch_part

_COUNTS = struct.Struct("<II")  # items, faces

Boxes = tuple[npt.NDArray[np.void], npt.NDArray[np.int32], npt.NDArray[np.void]]


def box_surfaces(crew: Crew, shop: Workshop, runs: Sequence[SurfaceRun], advance: Callable[[int], None]) -> Boxes:
    """Sketch every surface once and place it as often as it occurs.

    Args:
        crew: does the work.
        shop: its store has parts and scene; the runs' files go to its folder.
        runs: of all surfaces.
        advance: told the number of surfaces that are done.

    Returns:
        The items (``ITEM_DTYPE``, by part, occurrence, surface), the material of each, and the face report.
    """
    done: list[Boxes] = [(np.zeros(0, ITEM_DTYPE), np.zeros(0, np.int32), np.zeros(0, FACE_REPORT_DTYPE))]
    for run, path in zip(runs, crew.run(box_run, shop, range(len(runs))), strict=True):
        done.append(read_boxes(path))
        advance(run.n_surfaces)
    items, materials, faces = (np.concatenate(column) for column in zip(*done, strict=True))
    return items, materials, faces


def box_run(bench: Bench, number: int) -> Path:
    """Make the file of a run if it is not there yet; returns its path."""
    run = bench.runs[number]
    path = bench.shop.spill / f"{run.name}.boxes"
    if not _left_from_before(path):
        items, materials, faces = _boxes(bench, run)
        content = _COUNTS.pack(len(items), len(faces)) + items.tobytes() + materials.tobytes() + faces.tobytes()
        with new_file(path) as file:
            file.write(record.pack(content))
        bench.rest()
    return path


def read_boxes(path: Path) -> Boxes:
    """Items, their materials and face report of a run.

    Raises:
        CorruptRecordError: the file is damaged.
    """
    content = record.unpack(path.read_bytes(), str(path))
    n_items, n_faces = _COUNTS.unpack_from(content)
    at = _COUNTS.size
    items = np.frombuffer(content, ITEM_DTYPE, n_items, at)
    materials = np.frombuffer(content, np.int32, n_items, at + items.nbytes)
    faces = np.frombuffer(content, FACE_REPORT_DTYPE, n_faces, at + items.nbytes + materials.nbytes)
    return items, materials, faces


def _left_from_before(path: Path) -> bool:
    """Whether a former build has left the file, whole."""
    try:
        read_boxes(path)
    except (FileNotFoundError, CorruptRecordError):
        return False
    return True


def _boxes(bench: Bench, run: SurfaceRun) -> Boxes:
    """Sketch the surfaces of a run together, and place them part by part."""
    placed = []
    for loaded in part_batches(bench.store, run.slices):
        parts = [_surfaces_of(part, piece) for piece, part in loaded]
        sketch, at = sketch_part(join_parts(parts)), 0
        for (piece, _), own in zip(loaded, parts, strict=True):
            placed.append(_place(bench, piece, sketch.of_rows(at, at + len(own)), own.surfaces["material"]))
            at += len(own)
    items, materials, faces = (np.concatenate(column) for column in zip(*placed, strict=True))
    return items, materials, faces


def _surfaces_of(part: GeometryBatch, piece: PartSlice) -> GeometryBatch:
    """The surfaces of a slice; boxes need no neighbours."""
    return part if piece.whole else subset(part, np.arange(piece.first_row, piece.first_row + piece.n_surfaces))


def _place(bench: Bench, piece: PartSlice, sketch: PartSketch, own_materials: npt.NDArray[np.int32]) -> Boxes:
    """A slice as often as it occurs."""
    placed = bench.occurrences_of(piece.part)
    items = placed_items(sketch, piece.first_surface, placed, bench.occurrences["transform"][placed])
    override = bench.occurrences["material"][items["occurrence"]]
    own = own_materials[(items["surface"] - np.uint64(piece.first_surface)).astype(np.int64)]
    return items, np.where(override >= 0, override, own).astype(np.int32), _face_report(sketch, piece.first_surface)


def _face_report(sketch: PartSketch, first_surface: int) -> npt.NDArray[np.void]:
    """``FACE_REPORT_DTYPE`` rows of a part."""
    report = np.zeros(len(sketch.error), FACE_REPORT_DTYPE)
    report["surface"] = first_surface + np.arange(len(report))
    report["status"], report["reason"], report["certified"] = sketch.status, sketch.reason, sketch.error
    return report
