"""The GLB container: arrays go to a spool file as they come, the JSON is put before them at the end.

Source: Khronos Group, glTF 2.0 Specification, section 4 "GLB File Format Specification".
"""

from __future__ import annotations

import json
import shutil
import struct
import tempfile
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from nurbs_cache.errors import UsageError

COMPONENT_TYPES = {"uint16": 5123, "uint32": 5125, "float32": 5126}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
MAX_BYTES = 2**32 - 1  # the header's length field is 32 bits
CHUNK_JSON, CHUNK_BIN = 0x4E4F534A, 0x004E4942


class GlbSpool:
    """Arrays of a GLB under way, with their buffer views and accessors.

    Args:
        folder: where the spool lies; it has no name there, so nothing is left behind whatever happens.
    """

    def __init__(self, folder: Path) -> None:
        self._file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._size = 0
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def close(self) -> None:
        """Give the spool's disk space back."""
        self._file.close()

    def add(self, array: npt.NDArray[Any], *, is_index: bool = False, bounds: bool = False) -> int:
        """Append an array and return the number of its accessor.

        Args:
            array: (n,) or (n, 3), float32, uint16 or uint32; vertex attributes have rows of whole 4 bytes.
            is_index: the array holds vertex indices.
            bounds: give the accessor its minimum and maximum, as glTF wants it for positions.
        """
        data = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False)
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": data.nbytes}
        self.views.append({**view, "target": ELEMENT_ARRAY_BUFFER if is_index else ARRAY_BUFFER})
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": COMPONENT_TYPES[array.dtype.name],
            "count": len(array),
            "type": "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}",
        }
        if bounds:
            accessor["min"] = array.min(axis=0).astype(float).tolist()
            accessor["max"] = array.max(axis=0).astype(float).tolist()
        self.accessors.append(accessor)
        self._file.write(data.data)
        self._file.write(b"\0" * (-data.nbytes % 4))
        self._size += data.nbytes + (-data.nbytes % 4)
        return len(self.accessors) - 1

    def write(self, path: Path, document: dict[str, Any]) -> int:
        """Write the GLB: ``document`` with this spool's buffer, views and accessors; returns its bytes.

        Raises:
            UsageError: it would not fit a GLB's 32-bit lengths.
        """
        if self._size:
            buffers = {"buffers": [{"byteLength": self._size}], "bufferViews": self.views, "accessors": self.accessors}
            document = {**document, **buffers}
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + (8 + self._size if self._size else 0)
        if total > MAX_BYTES:
            raise UsageError(f"{path}: {total} bytes do not fit a GLB ({MAX_BYTES}); use a larger error")
        with path.open("wb") as out:
            out.write(struct.pack("<4sII", b"glTF", 2, total))
            out.write(struct.pack("<II", len(text), CHUNK_JSON) + text)
            if self._size:
                out.write(struct.pack("<II", self._size, CHUNK_BIN))
                self._file.seek(0)
                shutil.copyfileobj(self._file, out, 1 << 20)
        return total
