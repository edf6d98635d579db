"""How every face came through, over all tessellations of a build: the worst status, the finest error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_cache.typed_store import TypedStore

STATUS_NAMES = {status: status.name.lower() for status in FaceStatus}


def worst_rows(
    surfaces: npt.NDArray[np.uint64],
    status: npt.NDArray[np.uint8],
    reason: npt.NDArray[np.uint16],
    certified: npt.NDArray[np.float64],
) -> npt.NDArray[np.void]:
    """One ``FACE_REPORT_DTYPE`` row a surface, ascending: its worst status and reason, its smallest error (mm)."""
    order = np.lexsort((reason, status, surfaces))
    ids, first = np.unique(surfaces[order], return_index=True)
    last = np.append(first[1:], len(order))[: len(first)] - 1
    rows = np.zeros(len(ids), FACE_REPORT_DTYPE)
    rows["surface"] = ids
    rows["status"], rows["reason"] = status[order][last], reason[order][last]
    if len(ids):
        rows["certified"] = np.minimum.reduceat(certified[order], first)
    return rows


def add_to_report(store: TypedStore, reports: Sequence[npt.NDArray[np.void]]) -> None:
    """Merge rows into the stored report and store those that changed; the order of ``reports`` does not matter."""
    added = np.concatenate([np.zeros(0, FACE_REPORT_DTYPE), *reports])
    before = store.get_face_rows(np.unique(added["surface"]))
    both = np.concatenate([before, added])
    after = worst_rows(both["surface"], both["status"], both["reason"], both["certified"])
    old = np.searchsorted(before["surface"], after["surface"])
    is_old = np.isin(after["surface"], before["surface"])
    changed = ~is_old
    changed[is_old] = after[is_old] != before[old[is_old]]
    if changed.any():
        store.put_face_report(after[changed])


def status_counts(store: TypedStore) -> dict[str, int]:
    """``read`` and the number of faces of each status, as reports have them."""
    statuses = store.get_face_report()["status"]
    counts = {"read": sum(info.n_surfaces for info in store.part_infos())}
    return counts | {name: int((statuses == status).sum()) for status, name in STATUS_NAMES.items()}


def reason_counts(store: TypedStore) -> dict[str, int]:
    """Number of faces that are not exact by status and reason, as in ``{"healed FILE_GAP": 3}``, worst status last."""
    rows = store.get_face_report()
    rows = rows[rows["status"] != FaceStatus.EXACT]
    pairs, counts = np.unique(np.stack([rows["status"], rows["reason"]], 1), axis=0, return_counts=True)
    return {
        f"{STATUS_NAMES[FaceStatus(status)]} {FaceReason(reason).name}": n
        for (status, reason), n in zip(pairs.tolist(), counts.tolist(), strict=True)
    }
