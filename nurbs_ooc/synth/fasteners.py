"""Screws, bolts, nuts, washers, rivets and clips: closed solids of 4 to 20 exact faces, 1 to 60 mm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nurbs_ooc.synth.bulk_builder import BulkBuilder
from nurbs_ooc.synth.outline import Outline
from nurbs_ooc.synth.solid import SolidBuilder, Steps

Maker = Callable[[SolidBuilder, float, float], None]


def _hex_bolt(solid: SolidBuilder, d: float, length: float) -> None:
    """Hexagon head with a shank and a chamfered end."""
    shank = Steps(0, 0, ((d / 2, 0), (d / 2, length - 0.15 * d), (0.36 * d, length)), top=False)
    dimple = Steps(0, 0, ((0.45 * d, 0), (0.4 * d, -0.08 * d)))
    solid.plate(Outline.regular(6, 1.6 * d), 0.0, 0.65 * d, steps=[shank, dimple])


def _flange_bolt(solid: SolidBuilder, d: float, length: float) -> None:
    """Hexagon head on a round flange."""
    solid.turned([(d / 2, -length), (d / 2, -0.1), (1.1 * d, 0.0), (1.1 * d, 0.14 * d), (0.95 * d, 0.2 * d)])
    lifted = SolidBuilder(solid.builder, np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.2 * d]]), solid.material)
    lifted.plate(Outline.regular(6, 1.5 * d), 0.0, 0.6 * d)


def _socket_screw(solid: SolidBuilder, d: float, length: float) -> None:
    """Round head with a pocket."""
    shank = Steps(0, 0, ((d / 2, 0), (d / 2, length - 0.1 * d), (0.4 * d, length)), top=False)
    pocket = Steps(0, 0, ((0.42 * d, 0), (0.42 * d, -0.5 * d), (0.2 * d, -0.6 * d)))
    solid.plate(Outline.circle(0.78 * d), 0.0, 0.95 * d, steps=[shank, pocket])


def _nut(solid: SolidBuilder, d: float, length: float) -> None:  # noqa: ARG001
    """Hexagon nut."""
    solid.plate(Outline.regular(6, 1.6 * d), 0.0, 0.85 * d, [Outline.circle(d / 2)])


def _washer(solid: SolidBuilder, d: float, length: float) -> None:  # noqa: ARG001
    """Plain washer."""
    solid.plate(Outline.circle(1.05 * d), 0.0, 0.18 * d, [Outline.circle(0.55 * d)])


def _rivet(solid: SolidBuilder, d: float, length: float) -> None:
    """Domed head, shank, upset end."""
    head = ((0.95 * d, 0.0), (0.9 * d, 0.2 * d), (0.6 * d, 0.42 * d), (0.2 * d, 0.5 * d))
    solid.turned([(0.6 * d, -length), (0.7 * d, -length + 0.3 * d), (d / 2, -length + 0.4 * d), (d / 2, 0.0), *head])


def _clip(solid: SolidBuilder, d: float, length: float) -> None:
    """Trim clip: a square plate with a fir-tree stem."""
    stem: list[tuple[float, float]] = [(0.3 * d, 0.0)]
    for k in range(3):
        stem += [(0.3 * d, (k + 0.5) * length / 4), (0.5 * d, (k + 0.7) * length / 4)]
    solid.plate(
        Outline.rectangle(2.2 * d, 1.6 * d, 0.3 * d), 0.0, 0.2 * d,
        [Outline.circle(0.15 * d, 0.8 * d), Outline.circle(0.15 * d, -0.8 * d)],
        [Steps(0, 0, (*stem, (0.2 * d, length)), top=False)],
    )  # fmt: skip


def _weld_stud(solid: SolidBuilder, d: float, length: float) -> None:
    """Stepped pin."""
    solid.turned([(d, 0.0), (d, 0.1 * d), (d / 2, 0.2 * d), (d / 2, 0.9 * length), (0.35 * d, length)])


MAKERS: dict[str, Maker] = {
    "hex bolt": _hex_bolt,
    "flange bolt": _flange_bolt,
    "socket screw": _socket_screw,
    "nut": _nut,
    "washer": _washer,
    "rivet": _rivet,
    "clip": _clip,
    "weld stud": _weld_stud,
}
DIAMETERS = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # mm


def fastener(kind: int, material: int) -> tuple[str, BulkBuilder]:
    """Fastener number ``kind``: name and solid; its axis is z, its head looks up, the seat is at z = 0."""
    names = list(MAKERS)
    name, rest = names[kind % len(names)], kind // len(names)
    d = DIAMETERS[rest % len(DIAMETERS)]
    length = d * (2.0 + 0.5 * (rest // len(DIAMETERS) % 5))
    builder = BulkBuilder()
    MAKERS[name](SolidBuilder(builder, material=material), d, length)
    return f"{name} M{d:g}x{length:g}", builder
