"""Sizes of memory as people write them: 800MiB, 1.5GiB, 2G."""

from __future__ import annotations

import re

import click

_SHIFTS = {"": 0, "k": 10, "m": 20, "g": 30, "t": 40}
_SIZE = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([kmgt]?)(?:i?b)?\s*", re.IGNORECASE)


def byte_size(text: str) -> int:
    """Bytes of a size; K, M, G and T (also KiB, ...) are powers of 1024. For click's ``type=``.

    Raises:
        click.BadParameter: it is none.
    """
    match = _SIZE.fullmatch(text)
    if not match:
        raise click.BadParameter(f"{text!r}: want a size such as 800MiB or 1.5GiB")
    return int(float(match[1]) * 2 ** _SHIFTS[match[2].lower()])
