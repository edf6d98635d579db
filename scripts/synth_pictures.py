#!/usr/bin/env python3
"""The pictures of docs/synth.md: makes each model, builds its roots and draws it from in front and behind.

Run from a checkout: scripts/synth_pictures.py [golf c-class parking-lot] [--work FOLDER]. Tiles that the views need
are built on demand. Frames are cropped to what is drawn and put side by side.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

DOCS = Path(__file__).resolve().parent.parent / "docs" / "pictures"
VIEWS = {  # eye, target, in mm
    "golf": [((-2300, 3300, 1500), (1850, 0, 560)), ((6300, 3300, 1800), (2150, 0, 580))],
    "c-class": [((-2400, 3500, 1500), (2050, 0, 560)), ((6700, 3500, 1800), (2350, 0, 580))],
    "parking-lot": [((-10500, 30500, 9500), (-900, 10600, 0))],
}
ERROR_PX = {"golf": 0.7, "c-class": 1.0, "parking-lot": 1.5}


def run(*command: object) -> None:
    """One command of ours."""
    subprocess.run([sys.executable, "-m", "nurbs_ooc", *map(str, command)], check=True)


def side_by_side(paths: list[Path]) -> Image.Image:
    """Frames without their empty borders, next to one another; the background is the same along each row."""
    images = [Image.open(path).convert("RGB") for path in paths]
    boxes = []
    for image in images:
        pixels = np.asarray(image, np.int16)
        drawn = np.abs(pixels - pixels[:, :1]).max(axis=2) > 12
        rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
        boxes.append((columns[0], rows[0], columns[-1], rows[-1]))
    spare = 24
    top = max(min(box[1] for box in boxes) - spare, 0)
    bottom = min(max(box[3] for box in boxes) + spare, images[0].height)
    sides = [
        (max(box[0] - spare, 0), min(box[2] + spare, image.width)) for box, image in zip(boxes, images, strict=True)
    ]
    sheet = Image.new("RGB", (sum(right - left for left, right in sides), bottom - top))
    at = 0
    for image, (left, right) in zip(images, sides, strict=True):
        sheet.paste(image.crop((left, top, right, bottom)), (at, 0))
        at += right - left
    return sheet


def picture(model: str, work: Path) -> None:
    """Make one picture."""
    store, cache, frames = work / f"{model}.nurbs", work / f"{model}.cache", work / f"{model}.frames"
    if not cache.exists():
        run("synth", model, "-o", store, "--force")
        run("build", store, "-o", cache, "--levels", "root", "--force")
    views = VIEWS[model]
    keys = [{"time": i, "eye": eye, "target": target, "fov": 38} for i, (eye, target) in enumerate(views)]
    path = work / f"{model}.json"
    path.write_text(json.dumps({"keyframes": keys, "frames": len(keys)}))
    run("fly", cache, "--path", path, "-o", frames, "--size", "960x540", "--error-px", ERROR_PX[model])
    sheet = side_by_side([frames / f"frame_{i:05d}.png" for i in range(len(views))])
    sheet.save(DOCS / f"synth_{model.replace('-', '_')}.png", optimize=True)


def main() -> None:
    """Make the pictures that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=list(VIEWS), help="golf, c-class, parking-lot (default: all)")
    parser.add_argument("--work", type=Path, help="folder for stores and caches, kept; what is there is used again")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = options.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        for model in options.models:
            picture(model, work)


if __name__ == "__main__":
    main()
