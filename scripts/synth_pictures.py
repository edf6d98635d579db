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
    "parking-lot": [((-9000, 26500, 8500), (-700, 8600, 0))],
}
ERROR_PX = {"golf": 0.7, "c-class": 1.0, "parking-lot": 1.5}


def run(*command: object) -> None:
    """One command of ours."""
    subprocess.run([sys.executable, "-m", "nurbs_ooc", *map(str, command)], check=True)


def cropped(path: Path) -> Image.Image:
    """A frame without its empty border: the background is the same along each row."""
    image = Image.open(path).convert("RGB")
    pixels = np.asarray(image, np.int16)
    drawn = np.abs(pixels - pixels[:, :1]).max(axis=2) > 12
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    spare = 24
    box = (columns[0] - spare, rows[0] - spare, columns[-1] + spare, rows[-1] + spare)
    return image.crop((max(box[0], 0), max(box[1], 0), min(box[2], image.width), min(box[3], image.height)))


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
    images = [cropped(frames / f"frame_{i:05d}.png") for i in range(len(views))]
    sheet = Image.new("RGB", (sum(i.width for i in images), max(i.height for i in images)), "white")
    left = 0
    for image in images:
        sheet.paste(image, (left, (sheet.height - image.height) // 2))
        left += image.width
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
