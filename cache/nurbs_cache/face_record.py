"""How every face came through the build: rows of the stored face report."""

from __future__ import annotations

import numpy as np

FACE_REPORT_DTYPE = np.dtype(
    [
        ("surface", "u8"),  # surface id
        ("status", "u1"),  # FaceStatus: the worst of reading and tessellating
        ("reason", "u2"),  # FaceReason
        ("certified", "f8"),  # mm: certified error of the finest tessellation made
    ],
    align=True,
)
