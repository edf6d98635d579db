"""Which format a file has, by its content, and a plain copy of a compressed one."""

from __future__ import annotations

import gzip
import os
import re
import shutil
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from nurbs_cache.errors import InputFileError

GZIP_MAGIC = b"\x1f\x8b"
HEAD_BYTES = 4096
IGES_FIRST_LINE = re.compile(rb"^.{72}[SCBG] *\d+ *\r?$", re.MULTILINE)


@dataclass
class InputFile:
    """An input that is ready for the kernel.

    Attributes:
        shown: the path as the user gave it.
        plain: path of the plain content; a temporary file if ``shown`` is compressed.
        kind: "step" or "iges".
    """

    shown: Path
    plain: Path
    kind: str

    def remove_copy(self) -> None:
        """Delete the temporary file, if there is one."""
        if self.plain != self.shown:
            self.plain.unlink(missing_ok=True)


def prepare_input(path: Path) -> InputFile:
    """Find out the format of ``path`` and unpack it if need be.

    Raises:
        InputFileError: missing, empty, not STEP or IGES, or a broken archive.
    """
    try:
        with path.open("rb") as file:
            packed = file.read(2) == GZIP_MAGIC
    except OSError as error:
        raise InputFileError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    plain = _unpacked(path) if packed else path
    try:
        return InputFile(path, plain, _kind(path, plain))
    except InputFileError:
        InputFile(path, plain, "").remove_copy()
        raise


def _unpacked(path: Path) -> Path:
    descriptor, name = tempfile.mkstemp(prefix="nurbs-ooc-")
    try:
        with gzip.open(path, "rb") as packed, os.fdopen(descriptor, "wb") as plain:
            shutil.copyfileobj(packed, plain, 1 << 20)
    except (OSError, EOFError, zlib.error) as error:
        Path(name).unlink()
        raise InputFileError(f"{path}: broken gzip archive ({error})") from error
    return Path(name)


def _kind(shown: Path, plain: Path) -> str:
    with plain.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head.strip():
        raise InputFileError(f"{shown}: the file is empty")
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"ISO-10303-21"):
        return "step"
    if IGES_FIRST_LINE.search(head):
        return "iges"
    raise InputFileError(f"{shown}: neither STEP (ISO-10303-21) nor IGES")
