"""What the kernel's process tells the reader, in order: Opened, then per group a Scene and its PartData, Finished."""

from __future__ import annotations

from dataclasses import dataclass, field

from nurbs_cache.scene_record import Material, Product

Placement = tuple[int, int, int, tuple[float, ...]]  # part, product, material or -1, twelve numbers


@dataclass(frozen=True)
class Opened:
    """The file was parsed.

    Attributes:
        file_unit, unit_mm: as in ``AssemblyReader``.
        n_groups: how many scenes come, not counting one for what the kernel left out.
    """

    file_unit: str
    unit_mm: float
    n_groups: int


@dataclass(frozen=True)
class Scene:
    """Products, materials and placements of one group of root shapes; rows count from 0 in each group.

    Attributes:
        part_names: of the parts that follow, one each.
        part_faces: how many faces each has.
    """

    products: list[Product] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)
    part_names: list[str] = field(default_factory=list)
    part_faces: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Transferred:
    """Which of the file's faces the kernel took; stays inside the kernel's process."""

    entities: set[int]


@dataclass(frozen=True)
class PartData:
    """``GeometryBatch.to_bytes()`` of the next part."""

    data: bytes


@dataclass(frozen=True)
class Failed:
    """The file cannot be read at all."""

    message: str


@dataclass(frozen=True)
class Finished:
    """Nothing follows."""


Message = Opened | Transferred | Scene | PartData | Failed | Finished
