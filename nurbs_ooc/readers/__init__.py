"""Readers of CAD files; see ``open_assembly``."""

from __future__ import annotations

from pathlib import Path

from nurbs_ooc.readers.assembly import AssemblyReader, Part
from nurbs_ooc.readers.input_file import prepare_input
from nurbs_ooc.readers.kernel_reader import KernelReader

__all__ = ["AssemblyReader", "Part", "open_assembly"]


def open_assembly(path: Path | str) -> AssemblyReader:
    """Open a STEP or IGES file, plain or gzipped; the content decides, not the name.

    Use it as a context manager. Lengths come out in mm.

    Raises:
        InputFileError: the file is missing, truncated, or of another kind; one line.
    """
    return KernelReader(prepare_input(Path(path)))
