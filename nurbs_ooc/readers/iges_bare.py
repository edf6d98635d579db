"""B-spline surfaces (entity 128) straight from the text of an IGES file, without the kernel.

The kernel gives back nothing for some valid files. Entities 128 that it did not transfer and that no
other entity uses are taken from here, with their natural boundary; entities 124 place them.

Source: IGES 5.3 (US PRO, 1996), sections 2.2.4 (file structure), 4.23 (type 128), 4.21 (type 124),
4.77 (type 314), table 3 (colour numbers).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from nurbs_cache.errors import InputFileError
from nurbs_cache.surface_record import FaceReason, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.forms import Array, SurfaceForm
from nurbs_ooc.geometry.natural_boundary import natural_loop
from nurbs_ooc.geometry.torn import whole_parts
from nurbs_ooc.readers.clamping import clamp
from nurbs_ooc.readers.faces import add_failed
from nurbs_ooc.readers.refusal import FaceRefusedError, require_finite, require_knots, require_weights

BSPLINE_SURFACE, TRANSFORM, COLOUR = 128, 124, 314
TRIMMED_SURFACES = (143, 144)
USED_SURFACE = {140: 5, 141: 3, 142: 2, 143: 2, 144: 1, 510: 1}  # which parameter of a type points to a surface
NUMBERED_COLOURS: dict[int, tuple[float, float, float]] = {
    1: (0.0, 0.0, 0.0),
    2: (1.0, 0.0, 0.0),
    3: (0.0, 1.0, 0.0),
    4: (0.0, 0.0, 1.0),
    5: (1.0, 1.0, 0.0),
    6: (1.0, 0.0, 1.0),
    7: (0.0, 1.0, 1.0),
    8: (1.0, 1.0, 1.0),
}
FIELD = 8  # columns per directory field
DATA_COLUMNS = 65  # of a parameter line: 64, and one that has to be blank but that some writers use


@dataclass(frozen=True)
class Entity:
    """One directory entry.

    Attributes:
        number: of its first directory line, which is how others point to it.
        transform: number of its entity 124, 0 for none.
        colour: 0 none, 1 to 8 numbered, negative: minus the number of its entity 314.
        independent: visible and not part of another entity.
    """

    number: int
    kind: int
    first_line: int
    n_lines: int
    transform: int
    colour: int
    independent: bool
    label: str


@dataclass(frozen=True)
class BareSurface:
    """An untrimmed surface and where it came from; lengths still in the file's unit."""

    entity: Entity
    rgb: tuple[float, float, float] | None
    placed: Array
    numbers: list[float]

    @property
    def name(self) -> str:
        """Label and directory number."""
        return f"{self.entity.label or 'surface'} D{self.entity.number}"

    def geometry(self, unit_mm: float, material: int) -> GeometryBatch:
        """One part with this face, in mm; a face for each part of a torn surface."""
        builder = BatchBuilder()
        try:
            for form in whole_parts(self._form(unit_mm)):
                builder.surface(form, material=material, source=self.name)
                builder.loop(natural_loop(builder, form))
        except FaceRefusedError as refusal:
            builder = BatchBuilder()
            add_failed(builder, refusal.reason, material, f"{self.name} ({refusal})")
        return builder.build()

    def _form(self, unit_mm: float) -> SurfaceForm:
        """Parameters in their order: K1 K2 M1 M2, five flags, knots, weights, points (first index fastest)."""
        require_finite(np.array(self.numbers[:5]))
        n_u, n_v, degree_u, degree_v = (int(n) for n in self.numbers[1:5])
        n_u, n_v = n_u + 1, n_v + 1
        sizes = np.cumsum([10, n_u + degree_u + 1, n_v + degree_v + 1, n_u * n_v, 3 * n_u * n_v])
        if len(self.numbers) < sizes[-1] or min(degree_u, degree_v) < 1:
            raise FaceRefusedError(FaceReason.BAD_KNOTS, f"{len(self.numbers)} of {sizes[-1]} parameters")
        values = np.array(self.numbers)
        knots_u, knots_v, weights, points = (values[a:b] for a, b in pairwise(sizes))
        require_finite(values)
        require_weights(weights)
        require_knots(knots_u, degree_u, n_u)
        require_knots(knots_v, degree_v, n_v)
        net = points.reshape(n_v, n_u, 3).swapaxes(0, 1) @ self.placed[:, :3].T + self.placed[:, 3]
        form = SurfaceForm.nurbs(
            degree_u, degree_v, knots_u, knots_v, net * unit_mm, weights.reshape(n_v, n_u).swapaxes(0, 1)
        )
        return _clamped(form)


def _clamped(form: SurfaceForm) -> SurfaceForm:
    knots_u, points = clamp(form.knots_u, form.degree_u, form.points)
    knots_v, columns = clamp(form.knots_v, form.degree_v, points.swapaxes(0, 1))
    box = float(knots_u[0]), float(knots_u[-1]), float(knots_v[0]), float(knots_v[-1])
    return SurfaceForm(
        form.kind,
        form.frame,
        *box,
        degree_u=form.degree_u,
        degree_v=form.degree_v,
        knots_u=knots_u,
        knots_v=knots_v,
        points=np.ascontiguousarray(columns.swapaxes(0, 1)),
        rational=form.rational,
    )


class IgesText:
    """The directory and parameters of a plain IGES file.

    Raises:
        InputFileError: the directory cannot be read.
    """

    def __init__(self, path: Path, shown: str) -> None:
        lines = path.read_bytes().splitlines()
        sections: dict[bytes, list[bytes]] = {key: [] for key in (b"S", b"G", b"D", b"P", b"T")}
        for line in lines:
            key = line[72:73]
            if key in sections:
                sections[key].append(line[:72].ljust(72))
        self._parameters = sections[b"P"]
        try:
            self.entities = {entity.number: entity for entity in _directory(sections[b"D"])}
        except ValueError as error:
            raise InputFileError(f"{shown}: IGES directory is malformed ({error})") from error

    def numbers(self, entity: Entity) -> list[float]:
        """All parameters of ``entity`` as numbers, the type first; text becomes NaN, empty ones 0."""
        rows = self._parameters[entity.first_line - 1 : entity.first_line - 1 + entity.n_lines]
        text = b"".join(row[:DATA_COLUMNS].rstrip() for row in rows).decode("ascii", "replace")
        return [_number(word) for word in text.split(";", 1)[0].split(",")]

    def missing_surfaces(self, transferred: set[int]) -> list[BareSurface]:
        """Entities 128 that stand for themselves and are not among ``transferred``."""
        used = {
            int(numbers[USED_SURFACE[entity.kind]])
            for entity in self.entities.values()
            if entity.kind in USED_SURFACE and len(numbers := self.numbers(entity)) > USED_SURFACE[entity.kind]
        }
        return [
            BareSurface(entity, self._rgb(entity), self._placed(entity), self.numbers(entity))
            for entity in self.entities.values()
            if entity.kind == BSPLINE_SURFACE
            and entity.independent
            and entity.number not in transferred
            and entity.number not in used
        ]

    def missing_trimmed(self, transferred: set[int]) -> list[Entity]:
        """Trimmed surfaces that stand for themselves and are not among ``transferred``."""
        return [
            entity
            for entity in self.entities.values()
            if entity.kind in TRIMMED_SURFACES and entity.independent and entity.number not in transferred
        ]

    def _rgb(self, entity: Entity) -> tuple[float, float, float] | None:
        """SRGB components, 0 to 1."""
        if entity.colour >= 0:
            return NUMBERED_COLOURS.get(entity.colour)
        definition = self.entities.get(-entity.colour)
        if definition is None or definition.kind != COLOUR:
            return None
        red, green, blue = (min(max(c / 100.0, 0.0), 1.0) for c in self.numbers(definition)[1:4])
        return red, green, blue

    def _placed(self, entity: Entity) -> Array:
        """(3, 4) matrix of the entity's transformation, nested ones multiplied."""
        definition = self.entities.get(entity.transform)
        if definition is None or definition.kind != TRANSFORM:
            return np.eye(4)[:3]
        matrix = np.eye(4)
        matrix[:3] = np.reshape(self.numbers(definition)[1:13], (3, 4))
        outer = np.eye(4)
        outer[:3] = self._placed(definition)
        return np.asarray((outer @ matrix)[:3])


def _directory(lines: list[bytes]) -> Iterator[Entity]:
    for index in range(0, len(lines) - 1, 2):
        first = [lines[index][FIELD * k : FIELD * (k + 1)].decode("ascii", "replace").strip() for k in range(9)]
        second = [lines[index + 1][FIELD * k : FIELD * (k + 1)].decode("ascii", "replace").strip() for k in range(9)]
        status = first[8].replace(" ", "0").rjust(8, "0")
        yield Entity(
            number=index + 1,
            kind=int(first[0]),
            first_line=int(first[1]),
            n_lines=int(second[3] or 1),
            transform=int(first[6] or 0),
            colour=int(second[2] or 0),
            independent=status[:2] == "00" and status[2:4] == "00",
            label=second[7],
        )


def _number(word: str) -> float:
    word = word.strip().replace("D", "E").replace("d", "e")
    try:
        return float(word) if word else 0.0
    except ValueError:
        return float("nan")
