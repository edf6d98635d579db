"""Fasteners in rows and brackets in pairs: few shapes, placed often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.brackets import bracket
from nurbs_ooc.synth.fasteners import fastener
from nurbs_ooc.synth.part_draft import PartDraft
from nurbs_ooc.synth.volumes import Volume, pick, upright

Array = npt.NDArray[np.float64]

ROW = (3, 18)  # fasteners in a row
PITCH = (18.0, 55.0)  # mm between them
FASTENER_ROLES = ("zinc", "steel", "plastic", "zinc", "zinc", "steel", "plastic", "steel")


def _row(box: Volume, n: int, rng: np.random.Generator) -> list[Array]:
    """``n`` equal orientations along a line inside a box."""
    linear = upright(rng)
    axis = int(rng.choice(3, p=box.size / box.size.sum()))
    pitch = min(float(rng.uniform(*PITCH)), 0.8 * box.size[axis] / n)
    start = np.array(box.low) + rng.uniform(0.1, 0.9, 3) * box.size
    start[axis] = box.low[axis] + rng.uniform(0.0, 1.0) * (box.size[axis] - pitch * n)
    places = []
    for k in range(n):
        place = np.concatenate([linear, start[:, None]], axis=1)
        place[axis, 3] += k * pitch
        places.append(place)
    return places


def fasteners(
    n_surfaces: int, n_shapes: int, boxes: list[Volume], roles: dict[str, int], rng: np.random.Generator
) -> list[PartDraft]:
    """Rows of fasteners with at most ``n_surfaces`` placed surfaces."""
    parts, left = [], n_surfaces
    for kind in range(n_shapes):
        name, builder = fastener(kind, roles[FASTENER_ROLES[kind % len(FASTENER_ROLES)]])
        parts.append(PartDraft(name, ("hardware", "fasteners"), builder, []))
    while left > 0:
        # Small numbers are the common sizes.
        part = parts[min(int(rng.exponential(0.4 * n_shapes)), n_shapes - 1)]
        n = min(int(rng.integers(*ROW)), left // part.builder.n_surfaces)
        if not n:
            break
        part.places += _row(pick(boxes, rng), n, rng)
        left -= n * part.builder.n_surfaces
    return [part for part in parts if part.places]


def brackets(
    n_surfaces: int, n_shapes: int, boxes: list[Volume], roles: dict[str, int], rng: np.random.Generator
) -> list[PartDraft]:
    """Brackets with at most ``n_surfaces`` placed surfaces."""
    parts, left = [], n_surfaces
    for k in range(n_shapes):
        name, builder = bracket(rng, roles[("zinc", "steel", "engine black")[k % 3]])
        parts.append(PartDraft(f"{name} {k + 1}", ("hardware", "brackets"), builder, []))
    for k in range(1 << 30):
        part = parts[k % n_shapes]
        if part.builder.n_surfaces > left:
            break
        box = pick(boxes, rng)
        place = np.concatenate([upright(rng), np.zeros((3, 1))], axis=1)
        points = part.builder.all_vertices() @ place[:, :3].T
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        if (size > box.size).any():
            place[:, :3] *= 0.9 * float((box.size / size).min())
            low, size = (0.9 * float((box.size / size).min()) * x for x in (low, size))
        place[:, 3] = np.array(box.low) + rng.random(3) * (box.size - size) - low
        part.places.append(place)
        left -= part.builder.n_surfaces
    return [part for part in parts if part.places]
