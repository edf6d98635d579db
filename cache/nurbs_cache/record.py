"""The envelope of every stored value but tiles: length, checksum and identity around a payload.

Layout, little-endian (see FORMAT.md)::

     0  4  magic "NREC"           16  16  blake2b-128 of the payload: its identity in the content hash
     4  1  version                32   4  crc32 of bytes 0 to 31 and of the body
     5  1  0 plain, 1 zstd        36   .  body
     6  2  zero
     8  8  length of the payload
"""

from __future__ import annotations

import hashlib
import struct
import threading
import zlib

import zstandard

from nurbs_cache.errors import CorruptRecordError

MAGIC = b"NREC"
VERSION = 1
_HEAD = struct.Struct("<4sBBHQ16s")
_CRC = struct.Struct("<I")
BODY_START = _HEAD.size + _CRC.size
_PLAIN, _ZSTD = 0, 1
_SMALL = 128  # bytes; below, compression saves nothing
_LEVEL = 1  # 3 saves 4 % on control nets and takes 1.6 times as long

_local = threading.local()


def compressor(level: int) -> zstandard.ZstdCompressor:
    """This thread's compressor of a level; they are not safe to share between threads."""
    made: dict[int, zstandard.ZstdCompressor] = _local.__dict__.setdefault("compressors", {})
    if level not in made:
        made[level] = zstandard.ZstdCompressor(level=level, write_checksum=False, write_content_size=True)
    return made[level]


def decompressor() -> zstandard.ZstdDecompressor:
    """This thread's decompressor."""
    try:
        made: zstandard.ZstdDecompressor = _local.decompressor
    except AttributeError:
        made = _local.decompressor = zstandard.ZstdDecompressor()
    return made


def pack(payload: bytes) -> bytes:
    """Wrap ``payload``; equal payloads give equal identities, whatever the compressor's version."""
    codec, body = _PLAIN, payload
    if len(payload) > _SMALL:
        packed = compressor(_LEVEL).compress(payload)
        if len(packed) < len(payload):
            codec, body = _ZSTD, packed
    identity = hashlib.blake2b(payload, digest_size=16).digest()
    head = _HEAD.pack(MAGIC, VERSION, codec, 0, len(payload), identity)
    return b"".join((head, _CRC.pack(zlib.crc32(body, zlib.crc32(head))), body))


def unpack(data: bytes | memoryview, what: str) -> bytes:
    """The payload of a record; ``what`` names it in messages.

    Raises:
        CorruptRecordError: truncated, foreign, of a newer version or failing its checksum.
    """
    codec, length = _checked_head(data, what)
    body = memoryview(data)[BODY_START:]
    if codec == _PLAIN:
        payload = bytes(body)
    else:
        try:
            payload = decompressor().decompress(body, max_output_size=length)
        except zstandard.ZstdError as error:
            raise CorruptRecordError(f"{what}: {error}") from error
    if len(payload) != length:
        raise CorruptRecordError(f"{what}: {len(payload)} bytes, its header says {length}")
    return payload


def identity(data: bytes | memoryview, what: str) -> bytes:
    """16 bytes that stand for the payload of a record, without unpacking it."""
    _checked_head(data, what)
    return bytes(data[16:32])


def verify(data: bytes | memoryview, what: str) -> None:
    """Unpack and compare with the identity, which reading alone does not.

    Raises:
        CorruptRecordError: as ``unpack``, or the payload is not the one that was packed.
    """
    if hashlib.blake2b(unpack(data, what), digest_size=16).digest() != data[16:32]:
        raise CorruptRecordError(f"{what}: the payload is not the one its header names")


def _checked_head(data: bytes | memoryview, what: str) -> tuple[int, int]:
    """Codec and payload length, after every check that needs no unpacking."""
    if len(data) < BODY_START:
        raise CorruptRecordError(f"{what}: {len(data)} bytes, a record has at least {BODY_START}")
    magic, version, codec, zero, length, _ = _HEAD.unpack_from(data)
    if magic != MAGIC:
        raise CorruptRecordError(f"{what}: starts with {magic!r}, not with {MAGIC!r}")
    if version != VERSION:
        raise CorruptRecordError(f"{what}: record version {version}, this program reads {VERSION}")
    view = memoryview(data)
    if zlib.crc32(view[BODY_START:], zlib.crc32(view[: _HEAD.size])) != _CRC.unpack_from(data, _HEAD.size)[0]:
        raise CorruptRecordError(f"{what}: checksum does not match")
    if codec not in (_PLAIN, _ZSTD) or zero:
        raise CorruptRecordError(f"{what}: unknown codec {codec}")
    return codec, length
