"""Folded sheet-metal brackets with holes: closed solids of planes and bends, 20 to 200 mm."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.outline import Outline
from nurbs_ooc.synth.solid import SolidBuilder, Steps

Array = npt.NDArray[np.float64]

TURN_X = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]])  # local z becomes -y


def _folded(course: Array, thickness: float, radius: float) -> Outline:
    """The section of a strip folded along ``course`` (n, 2): corners rounded inside and outside."""
    along = np.diff(course, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inner, bends = [course[0] + thickness * left[0]], [0.0]
    for i in range(1, len(course) - 1):
        both = left[i - 1] + left[i]
        inner.append(course[i] + 2.0 * thickness * both / (both @ both))
        bends.append(np.sign(along[i - 1] @ left[i]))
    inner.append(course[-1] + thickness * left[-1])
    # A left bend is tight on the left side; the strip's other side has the larger radius.
    lower = [0.0] + [radius + (thickness if b < 0 else 0.0) for b in bends[1:]] + [0.0]
    upper = [0.0] + [radius + (thickness if b > 0 else 0.0) for b in bends[1:]] + [0.0]
    corners = np.concatenate([course, np.array(inner)[::-1]])
    return Outline.polygon(corners, np.array(lower + upper[::-1]))


def bracket(rng: np.random.Generator, material: int) -> tuple[str, BulkBuilder]:
    """A seeded bracket: L, Z, U or hat section, or a flat gusset; with its lugs' holes and studs."""
    builder = BulkBuilder()
    kind = int(rng.integers(5))
    thickness, width = float(rng.choice([1.0, 1.5, 2.0, 3.0])), float(rng.uniform(15.0, 60.0))
    a, b, c = rng.uniform(15.0, 60.0, 3)
    if kind == 4:
        _gusset(SolidBuilder(builder, material=material), rng, a + 20.0, b + 20.0, thickness)
        return "gusset", builder
    courses = (
        [(a, 0), (0, 0), (0, b)],
        [(a, 0), (0, 0), (0, b), (-c, b)],
        [(a, c), (a, 0), (0, 0), (0, b)],
        [(-a, 0), (0, 0), (0, b), (c, b), (c, 0), (c + a, 0)],
    )
    section = _folded(np.array(courses[kind])[::-1], thickness, 1.2 * thickness)
    SolidBuilder(builder, material=material).plate(section, 0.0, width)
    # The lug stands beside the fold: a tab with a hole and an embossed seat.
    tab = SolidBuilder(builder, TURN_X + np.array([[0, 0, 0, 0.0], [0, 0, 0, -0.01], [0, 0, 0, 0]]), material)
    x, y, r = 0.5 * a * (-1 if kind == 3 else 1), 0.5 * width, min(0.25 * a, 0.35 * width)
    outline = Outline.rectangle(2.0 * r, 2.0 * r, 0.3 * r, x, y)
    tab.plate(outline, 0.0, 0.8 * thickness, [Outline.circle(0.45 * r, x, y)])
    return ("angle bracket", "offset bracket", "channel bracket", "hat bracket")[kind], builder


def _gusset(solid: SolidBuilder, rng: np.random.Generator, a: float, b: float, thickness: float) -> None:
    """A triangular plate with lightening holes and a stud."""
    corners = np.array([(0.0, 0.0), (a, 0.0), (a, 0.3 * b), (0.3 * a, b), (0.0, b)])
    outline = Outline.polygon(corners, 3.0)
    holes = [Outline.circle(0.09 * min(a, b), 0.18 * a, 0.2 * b), Outline.circle(0.08 * min(a, b), 0.7 * a, 0.15 * b)]
    holes.append(Outline.rectangle(0.14 * a, 0.2 * b, 0.03 * a, 0.2 * a, 0.6 * b))
    height = float(rng.uniform(4.0, 12.0))
    stud = Steps(0.45 * a, 0.35 * b, ((0.06 * a, 0.0), (0.06 * a, height), (0.04 * a, height + 1.0)))
    solid.plate(outline, 0.0, thickness, holes, [stud])
