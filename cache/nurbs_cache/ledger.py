"""The error ledger of a tile: every term that separates what is drawn from the exact surfaces."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import ClassVar, Self

from nurbs_cache.errors import CorruptRecordError, UsageError

_NAMES = ("surface", "trim", "pcurve", "cluster", "quantisation", "float32")
_ROUND_UP = 1.0 + 2.0**-50  # above the rounding of a float64 sum of six terms, in any order


@dataclass(frozen=True)
class Ledger:
    """Six error terms, each a bound in mm, finite and >= 0; their sum bounds the drawn geometry.

    Attributes:
        surface: chord error of the triangles.
        trim: error of the trimming polylines, measured in space.
        pcurve: gap between p-curves, edge curves and surface in the source.
        cluster: furthest that clustering moved a vertex.
        quantisation: furthest that quantisation moved a vertex.
        float32: what rounding relative positions to float32 adds.
    """

    surface: float = 0.0
    trim: float = 0.0
    pcurve: float = 0.0
    cluster: float = 0.0
    quantisation: float = 0.0
    float32: float = 0.0

    SIZE: ClassVar[int] = 48

    def __post_init__(self) -> None:
        a, b, c, d, e, f = self.terms
        if not (
            0.0 <= a < math.inf
            and 0.0 <= b < math.inf
            and 0.0 <= c < math.inf
            and 0.0 <= d < math.inf
            and 0.0 <= e < math.inf
            and 0.0 <= f < math.inf
        ):  # written out: every tile that is decoded comes by here
            name, value = next(pair for pair in zip(_NAMES, self.terms, strict=True) if not 0.0 <= pair[1] < math.inf)
            raise UsageError(f"ledger: {name} is {value}, want a finite length >= 0 mm")

    def as_dict(self) -> dict[str, float]:
        """The six terms by name, mm."""
        return {name: float(value) for name, value in zip(_NAMES, self.terms, strict=True)}

    @property
    def terms(self) -> tuple[float, float, float, float, float, float]:
        """The six terms in order, mm."""
        return self.surface, self.trim, self.pcurve, self.cluster, self.quantisation, self.float32

    @property
    def total(self) -> float:
        """Sum of the terms, mm, rounded up: no float64 sum of them, in any order, is larger."""
        terms = [term for term in self.terms if term > 0.0]
        return terms[0] if len(terms) == 1 else math.fsum(terms) * _ROUND_UP

    def merge(self, other: Ledger) -> Ledger:
        """The ledger of both together: the larger of each term."""
        return Ledger(*map(max, self.terms, other.terms))

    def to_bytes(self) -> bytes:
        """48 bytes: the terms in order as little-endian float64."""
        return struct.pack("<6d", *self.terms)

    @classmethod
    def from_bytes(cls, data: bytes | memoryview) -> Self:
        """Inverse of ``to_bytes``.

        Raises:
            CorruptRecordError: wrong length, or a term is not a finite length >= 0.
        """
        if len(data) != cls.SIZE:
            raise CorruptRecordError(f"ledger: {len(data)} bytes, want {cls.SIZE}")
        try:
            return cls(*struct.unpack("<6d", data))
        except UsageError as error:
            raise CorruptRecordError(str(error)) from error
