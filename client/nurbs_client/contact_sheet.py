"""One picture with a path's frames side by side, numbered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

SHEET_WIDTH = 1600  # pixels
MAX_FRAMES = 24  # more are thinned out evenly
MARGIN = 8
BACKGROUND, TEXT = (255, 255, 255), (90, 95, 100)


def write_contact_sheet(frames: Sequence[Path], output: Path) -> None:
    """Put up to 24 of the PNG files ``frames`` on one sheet."""
    if not frames:
        return
    step = max(len(frames) - 1, 1) / max(min(len(frames), MAX_FRAMES) - 1, 1)
    shown = [frames[round(i * step)] for i in range(min(len(frames), MAX_FRAMES))]
    columns = min(math.ceil(math.sqrt(len(shown))), len(shown))
    rows = math.ceil(len(shown) / columns)
    with Image.open(shown[0]) as first:
        width = (SHEET_WIDTH - MARGIN * (columns + 1)) // columns
        height = max(round(width * first.height / first.width), 1)
    size = (SHEET_WIDTH, rows * (height + MARGIN) + MARGIN)
    sheet = Image.new("RGB", size, BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for number, path in enumerate(shown):
        corner = (
            MARGIN + (number % columns) * (width + MARGIN),
            MARGIN + (number // columns) * (height + MARGIN),
        )
        with Image.open(path) as image:
            sheet.paste(image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS), corner)
        draw.text((corner[0] + 6, corner[1] + 4), path.stem.removeprefix("frame_"), fill=TEXT, font=font)
    sheet.save(output)
