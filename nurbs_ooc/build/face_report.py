"""How every face came through, over all tessellations of a build: the worst status, the finest error."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache.surface_record import FaceReason, FaceStatus
from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.hlod.mesh_pool import MeshPool

STATUS_NAMES = {status: status.name.lower() for status in FaceStatus}


class FaceReport:
    """The stored face report, kept up to date while surfaces are tessellated again and again."""

    def __init__(self, store: TypedStore) -> None:
        self._store = store
        self._rows = store.get_face_report()

    def add(self, surfaces: npt.NDArray[np.uint64], meshes: MeshPool) -> None:
        """Take in the meshes of ``surfaces`` (slot by slot) and store the rows that changed.

        Worse statuses replace better ones; of certified errors the smallest is kept. Neither depends on
        the order of the calls.
        """
        at = np.searchsorted(self._rows["surface"], surfaces)
        before = self._rows.copy()
        worse = meshes.status > self._rows["status"][at]
        order = np.argsort(meshes.status[worse], kind="stable")
        where = at[worse][order]
        self._rows["status"][where], self._rows["reason"][where] = (
            meshes.status[worse][order],
            meshes.reason[worse][order],
        )
        np.minimum.at(self._rows["certified"], at, meshes.errors.sum(axis=1))
        changed = np.flatnonzero(before != self._rows)
        if len(changed):
            self._store.put_face_report(self._rows[changed])


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
