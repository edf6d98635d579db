"""What a key means: the octree's node keys, and the byte keys of every table of a store.

All numbers in byte keys are big-endian, so that the store's byte order is the numeric order.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Self

from nurbs_cache.errors import CorruptRecordError, UsageError

MAX_KEY_TEXT = 40  # bytes that the node table keeps for a key
_TEXT = re.compile(r"(0|[1-9][0-9]*)(?:-([0-7]+))?", re.ASCII)
_HASH = re.compile(r"[0-9a-f]{32}", re.ASCII)


@dataclass(frozen=True, order=True)
class NodeKey:
    """A node of the lazy octree of one material; keys sort depth first, a parent before its children.

    Attributes:
        material: row in the scene's materials, >= 0.
        path: octant digits from the root, "" for the root. Bit 0 of a digit is set in the upper half
            of x, bit 1 of y, bit 2 of z.
    """

    material: int
    path: str = ""

    def __post_init__(self) -> None:
        text = str(self)
        if not _TEXT.fullmatch(text) or len(text) > MAX_KEY_TEXT:
            raise UsageError(
                f"node key {text!r}: want '<material>[-<octant digits>]', at most {MAX_KEY_TEXT} characters"
            )

    def __str__(self) -> str:
        return f"{self.material}-{self.path}" if self.path else f"{self.material}"

    @classmethod
    def parse(cls, text: str | bytes) -> Self:
        """Inverse of ``str``; also takes the bytes of a node record.

        Raises:
            CorruptRecordError: the text is not canonical.
        """
        string = text.decode("ascii", "replace") if isinstance(text, bytes) else text
        match = _TEXT.fullmatch(string)
        if not match or len(string) > MAX_KEY_TEXT:
            raise CorruptRecordError(f"node key {string!r} is not '<material>[-<octant digits>]'")
        return cls(int(match[1]), match[2] or "")

    @property
    def level(self) -> int:
        """Depth below the root, 0 for the root."""
        return len(self.path)

    @property
    def parent(self) -> NodeKey | None:
        """The key one level up, None for a root."""
        return NodeKey(self.material, self.path[:-1]) if self.path else None

    def child(self, octant: int) -> NodeKey:
        """The key of ``octant`` (0 to 7) one level down."""
        if not 0 <= octant <= 7:
            raise UsageError(f"octant {octant} of node {self} is not in 0 to 7")
        return NodeKey(self.material, f"{self.path}{octant}")


def number_key(number: int) -> bytes:
    """Key of a part or of a page: u32."""
    return struct.pack(">I", number)


def parse_number_key(key: bytes) -> int:
    """Inverse of ``number_key``."""
    if len(key) != 4:
        raise CorruptRecordError(f"key {key.hex()}: {len(key)} bytes, a number has 4")
    return int.from_bytes(key, "big")


def surface_key(surface_id: int) -> bytes:
    """Key of a surface's levels of detail: u64."""
    return struct.pack(">Q", surface_id)


def parse_surface_key(key: bytes) -> int:
    """Inverse of ``surface_key``."""
    if len(key) != 8:
        raise CorruptRecordError(f"key {key.hex()} is not the 8 bytes of a surface id")
    return int.from_bytes(key, "big")


def tile_key(tile_hash: str | bytes) -> bytes:
    """Key of a tile: the 16 bytes of its hash, given as 32 hex characters (text, or as in a record)."""
    text = tile_hash.decode("ascii", "replace") if isinstance(tile_hash, bytes) else tile_hash
    if not _HASH.fullmatch(text):
        raise UsageError(f"tile hash {text!r} is not 32 lower-case hex characters")
    return bytes.fromhex(text)
