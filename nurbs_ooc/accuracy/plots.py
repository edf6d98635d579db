"""The page of curves: what a millimetre less costs, drawn so that it is read without the text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nurbs_ooc.accuracy.curves import CurvePoint
from nurbs_ooc.accuracy.encoded import QuantisationPoint
from nurbs_ooc.accuracy.number_types import NumberPoint

COLOURS = ("#0b6e99", "#d9730d", "#787774", "#ad1a72", "#0f7b6c", "#6940a5")
MARKERS = ("o", "s", "^", "D", "v", "P")
DPI = 110
LEGEND_HEIGHT = 0.4  # of four entries, in heights of the curves below


def draw_page(
    path: Path,
    title: str,
    size: float,
    points: Sequence[CurvePoint],
    quantisation: Sequence[QuantisationPoint],
    numbers: Sequence[NumberPoint],
) -> None:
    """Write the PNG: cost curves above, certified over measured, normals, bits and number types below.

    Args:
        path: of the PNG.
        title: the model.
        size: its diagonal, mm.
        points: of all variants.
        quantisation, numbers: see their modules.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 4, figsize=(21, 10), layout="constrained")
    figure.suptitle(f"{title}: what accuracy costs (largest part {size:.4g} mm across)", fontsize=15)
    names = list(dict.fromkeys(p.variant for p in points))
    for axis, key, label in zip(
        axes[0, :3],
        ("seconds", "triangles", "bytes"),
        ("CPU seconds, one core", "triangles", "bytes, encoded"),
        strict=True,
    ):
        _costs(axis, points, names, size, key, label)
    _normals(axes[0, 3], points, names, size)
    _ratio(axes[1, 0], points, names)
    _promise(axes[1, 1], points, names)
    _quantisation(axes[1, 2], quantisation, size)
    _numbers(axes[1, 3], numbers)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _style(names: list[str], name: str) -> dict[str, Any]:
    k = names.index(name) % len(COLOURS)
    return {"color": COLOURS[k], "marker": MARKERS[k], "markersize": 5, "label": name, "linewidth": 1.6}


def _error_axis(axis: Any) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.invert_xaxis()
    axis.grid(True, which="major", alpha=0.4)
    axis.grid(True, which="minor", alpha=0.12)
    axis.set_xlabel("largest measured error / diagonal  (finer →)")


def _costs(axis: Any, points: Sequence[CurvePoint], names: list[str], size: float, key: str, label: str) -> None:
    for name in names:
        own = [p for p in points if p.variant == name and p.measured_max_mm > 0.0]
        axis.plot([p.measured_max_mm / size for p in own], [getattr(p, key) for p in own], **_style(names, name))
    _error_axis(axis)
    axis.set_ylabel(label)
    axis.set_title(f"{label.split(',')[0]} for the error reached")
    axis.legend()


def _normals(axis: Any, points: Sequence[CurvePoint], names: list[str], size: float) -> None:
    for name in names:
        own = [p for p in points if p.variant == name and p.measured_max_mm > 0.0]
        axis.plot([p.measured_max_mm / size for p in own], [p.normal_mean_deg for p in own], **_style(names, name))
    _error_axis(axis)
    axis.set_ylabel("mean angle, degrees")
    axis.set_title("interpolated against exact normals")
    axis.legend()


def _plain(axis: Any, values: Sequence[float], head: float = 0.0) -> None:
    """A logarithmic axis around 1 with plain numbers, and a share ``head`` of its height more for a legend."""
    from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

    low, high = min([0.7, *(0.8 * v for v in values)]), max([2.0, *(1.4 * v for v in values)])
    axis.set_ylim(low, high * (high / low) ** head)
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(ScalarFormatter())
    axis.yaxis.set_minor_formatter(NullFormatter())


def _note(axis: Any, height: float, text: str, side: str) -> None:
    axis.text(0.02, height, text, transform=axis.get_yaxis_transform(), fontsize=9, va=side, alpha=0.8)


def _ratio(axis: Any, points: Sequence[CurvePoint], names: list[str]) -> None:
    own = [p for p in points if p.ratio_median is not None and p.requested_mm]
    for name in dict.fromkeys(p.variant for p in own):
        style, mine = _style(names, name), [p for p in own if p.variant == name]
        shares = [p.setting for p in mine]
        axis.plot(shares, [p.ratio_median or 1.0 for p in mine], **style | {"label": f"{name}, median face"})
        axis.plot(
            shares, [p.ratio_max or 1.0 for p in mine],
            **style | {"label": f"{name}, most cautious face", "linestyle": ":", "alpha": 0.6},
        )  # fmt: skip
    axis.axhline(1.0, color="black", linewidth=1)
    _error_axis(axis)
    _plain(axis, [p.ratio_median or 1.0 for p in own] + [p.ratio_max or 1.0 for p in own], LEGEND_HEIGHT)
    _note(axis, 0.985, "below this line a promise would be broken", "top")
    axis.set_xlabel("requested error / diagonal  (finer →)")
    axis.set_ylabel("certified / measured")
    axis.set_title("how cautious the certified bound is")
    axis.legend(loc="upper right")


def _promise(axis: Any, points: Sequence[CurvePoint], names: list[str]) -> None:
    for name in names:
        own = [p for p in points if p.variant == name and p.requested_mm]
        if own:
            ratio = [p.measured_max_mm / (p.requested_mm or 1.0) for p in own]
            axis.plot([p.setting for p in own], ratio, **_style(names, name))
    axis.axhline(1.0, color="black", linewidth=1)
    _error_axis(axis)
    _plain(axis, [p.measured_max_mm / p.requested_mm for p in points if p.requested_mm and p.measured_max_mm > 0.0])
    _note(axis, 1.015, "above this line: more error than was asked for", "bottom")
    axis.set_xlabel("requested error / diagonal  (finer →)")
    axis.set_ylabel("largest measured / requested")
    axis.set_title("who keeps what was asked for")
    axis.legend()


def _quantisation(axis: Any, points: Sequence[QuantisationPoint], size: float) -> None:
    axis.plot([p.bits for p in points], [p.moved_mm / size for p in points], "o-", color=COLOURS[0])
    axis.set_yscale("log")
    axis.grid(True, alpha=0.4)
    axis.set_xlabel("bits a coordinate")
    axis.set_ylabel("largest displacement / diagonal", color=COLOURS[0])
    axis.set_title("what quantised positions cost")
    other = axis.twinx()
    other.plot([p.bits for p in points], [p.bytes_per_triangle for p in points], "s--", color=COLOURS[1])
    other.set_ylabel("bytes a triangle", color=COLOURS[1])
    other.set_ylim(bottom=0)


def _numbers(axis: Any, points: Sequence[NumberPoint]) -> None:
    rows = [
        ("float32", [p.float32_mm for p in points]),
        ("float32, own origin", [p.float32_own_origin_mm for p in points]),
        ("float64", [p.float64_mm for p in points]),
    ]
    for k, (label, values) in enumerate(rows):
        axis.plot([max(p.distance_mm, 1.0) for p in points], values, marker=MARKERS[k], color=COLOURS[k], label=label)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.grid(True, alpha=0.4)
    axis.set_xlabel("distance from the origin, mm")
    axis.set_ylabel("largest error of evaluation, mm")
    axis.set_title("number types, near and far")
    axis.legend()
