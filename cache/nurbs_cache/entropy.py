"""Entropy coders of tile streams by name: each stream is stored plain if coding does not shrink it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import zstandard

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.huffman import decode_huffman, encode_huffman
from nurbs_cache.record import compressor, decompressor

PLAIN, ZSTD, HUFFMAN = 0, 1, 2
ZSTD_LEVEL = 1  # 0.5 % more bytes than level 3, and a quarter less time
_SMALL = 24  # bytes; shorter streams never shrink

Bytes = npt.NDArray[np.uint8]
NO_BYTES: Bytes = np.zeros(0, np.uint8)
CODECS = {"zstd": ZSTD, "huffman": HUFFMAN, "plain": PLAIN}


def encode_stream(stream: Bytes, codec: str) -> tuple[int, bytes]:
    """Number of the coder used, and the coded bytes."""
    if codec not in CODECS:
        raise UsageError(f"codec {codec!r} is not one of {', '.join(CODECS)}")
    if codec != "plain" and stream.size > _SMALL:
        coded = compressor(ZSTD_LEVEL).compress(stream.data) if codec == "zstd" else encode_huffman(stream)
        if len(coded) < stream.size:
            return CODECS[codec], coded
    return PLAIN, stream.tobytes()


def decode_stream(coded: memoryview, codec: int, length: int) -> Bytes:
    """``length`` bytes of a stream; read-only.

    Raises:
        CorruptRecordError: unknown coder, or the stream does not decode to ``length`` bytes.
    """
    if codec == PLAIN:
        stream = np.frombuffer(coded, np.uint8)
    elif codec == ZSTD:
        try:
            if zstandard.frame_content_size(coded) != length:
                raise CorruptRecordError(f"tile: a stream is not the {length} bytes that its entry says")
            stream = np.frombuffer(decompressor().decompress(coded), np.uint8)
        except zstandard.ZstdError as error:
            raise CorruptRecordError(f"tile: {error}") from error
    elif codec == HUFFMAN:
        stream = decode_huffman(coded, length)
    else:
        raise CorruptRecordError(f"tile: unknown entropy coder {codec}")
    if len(stream) != length:
        raise CorruptRecordError(f"tile: a stream has {len(stream)} bytes, its entry says {length}")
    return stream
