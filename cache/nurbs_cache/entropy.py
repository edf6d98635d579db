"""Entropy coders of tile streams by name: each stream is stored plain if coding does not shrink it."""

from __future__ import annotations

import threading

import numpy as np
import numpy.typing as npt
import zstandard

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.huffman import decode_huffman, encode_huffman
from nurbs_cache.record import decompressor

PLAIN, ZSTD, HUFFMAN = 0, 1, 2
# Level 1 looks for repeated strings of five bytes; of seven and in a small table are found few that only seem to be
# repeated: 0.3 % more bytes, an eighth less time.
_MIN_MATCH, _HASH_LOG, _WINDOW_LOG = 7, 10, 20
_SMALL = 24  # bytes; shorter streams never shrink

Bytes = npt.NDArray[np.uint8]
NO_BYTES: Bytes = np.zeros(0, np.uint8)
CODECS = {"zstd": ZSTD, "huffman": HUFFMAN, "plain": PLAIN}


_local = threading.local()


def _compressor() -> zstandard.ZstdCompressor:
    """This thread's compressor; they are not safe to share between threads."""
    if not hasattr(_local, "compressor"):
        parameters = zstandard.ZstdCompressionParameters(
            strategy=zstandard.STRATEGY_FAST, min_match=_MIN_MATCH, hash_log=_HASH_LOG, window_log=_WINDOW_LOG,
            chain_log=_HASH_LOG, search_log=1, target_length=0, write_content_size=True, write_checksum=False,
        )  # fmt: skip
        _local.compressor = zstandard.ZstdCompressor(compression_params=parameters)
    made: zstandard.ZstdCompressor = _local.compressor
    return made


def encode_stream(stream: Bytes, codec: str) -> tuple[int, bytes]:
    """Number of the coder used, and the coded bytes."""
    if codec not in CODECS:
        raise UsageError(f"codec {codec!r} is not one of {', '.join(CODECS)}")
    if codec != "plain" and stream.size > _SMALL:
        coded = _compressor().compress(stream.data) if codec == "zstd" else encode_huffman(stream)
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
