#!/usr/bin/env python3
"""Put the studies of `nurbs-ooc accuracy` into docs/accuracy.md: pictures, and a table at equal measured error.

    scripts/accuracy_findings.py FOLDER ... --docs docs/accuracy.md

Each FOLDER is one that the command wrote. Triangles and seconds of a variant at a given measured error are
read off its curve, linearly between logarithms; outside the curve's range there is no number.
"""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path
from typing import Any

import click
import numpy as np
from docs_section import replace_section

SHARES = (1e-2, 1e-3, 2e-4)  # of the diagonal: where the curves are compared


def read_off(points: list[dict[str, Any]], error: float, key: str) -> float | None:
    """``key`` of one variant where its measured error is ``error`` mm: the cheapest crossing of its curve."""
    rows = [(p["measured_max_mm"], p[key]) for p in points if p["measured_max_mm"] > 0.0 and p[key] > 0]
    found = []
    for (e0, y0), (e1, y1) in itertools.pairwise(rows):
        if min(e0, e1) <= error <= max(e0, e1) and e0 != e1:
            share = np.log(error / e0) / np.log(e1 / e0)
            found.append(float(np.exp(np.log(y0) + share * np.log(y1 / y0))))
    return min(found) if found else None


def shown(value: float | None, digits: int) -> str:
    """A cell."""
    return "" if value is None else f"{value:.{digits}g}" if value < 1000 else f"{value:.0f}"


def section(folders: list[Path], pictures: Path) -> str:
    """The findings as Markdown."""
    lines = ["## Findings", ""]
    head = "| model | diagonal mm | error / diagonal | variant | triangles | CPU ms | worst measured / requested |"
    lines += [head, "|---|--:|--:|---|--:|--:|--:|"]
    for folder in folders:
        result = json.loads((folder / "accuracy.json").read_text(encoding="utf-8"))
        names = list(dict.fromkeys(p["variant"] for p in result["points"]))
        for share in SHARES:
            for name in names:
                own = [p for p in result["points"] if p["variant"] == name]
                kept = [p["measured_max_mm"] / p["requested_mm"] for p in own if p["requested_mm"]]
                triangles = read_off(own, share * result["diagonal_mm"], "triangles")
                seconds = read_off(own, share * result["diagonal_mm"], "seconds")
                if triangles is None:
                    continue
                cells = [folder.name, f"{result['diagonal_mm']:.4g}", f"{share:g}", name, f"{triangles:.0f}"]
                cells += [shown(None if seconds is None else 1e3 * seconds, 3), f"{max(kept):.2f}" if kept else ""]
                lines.append("| " + " | ".join(cells) + " |")
        shutil.copyfile(folder / "accuracy.png", pictures / f"accuracy_{folder.name}.png")
    for folder in folders:
        lines += ["", f"![{folder.name}](pictures/accuracy_{folder.name}.png)"]
    return "\n".join(lines)


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--docs", required=True, type=click.Path(path_type=Path, exists=True), help="Page to fill in.")
def main(folders: tuple[Path, ...], docs: Path) -> None:
    """Fill the page's section `findings` from FOLDERS."""
    replace_section(docs, "findings", section(list(folders), docs.parent / "pictures"))


if __name__ == "__main__":
    main()
