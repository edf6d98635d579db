"""What an attack found: a broken promise, with all that is needed to look at it again."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Violation:
    """One broken promise.

    Attributes:
        where: the face, surface or node it concerns, in words.
        row: its row in the surfaces (mesh) or nodes (cache).
        kind: one of those in docs/verify.md, as ``surface to mesh``.
        value: what was measured, in ``unit``.
        limit: what was promised, in ``unit``.
        uv: native parameters of the point of the surface, where there is one.
        point: the point in space, mm.
        unit: mm or degrees.
    """

    where: str
    row: int
    kind: str
    value: float = float("nan")
    limit: float = float("nan")
    uv: tuple[float, float] | None = None
    point: tuple[float, float, float] | None = None
    unit: str = "mm"

    def __str__(self) -> str:
        text = f"{self.where}: {self.kind}"
        if self.value == self.value:
            text += f" {self.value:.6g} {self.unit}, promised {self.limit:.6g} {self.unit}"
        if self.uv is not None:
            text += f" at (u, v) = ({self.uv[0]:.17g}, {self.uv[1]:.17g})"
        if self.point is not None:
            text += " at ({:.9g}, {:.9g}, {:.9g})".format(*self.point)
        return text

    def as_json(self) -> dict[str, Any]:
        """Plain numbers and strings for a report; what is not finite becomes None."""
        finite = {"value": self.value, "limit": self.limit}
        return asdict(self) | {k: v if math.isfinite(v) else None for k, v in finite.items()}
