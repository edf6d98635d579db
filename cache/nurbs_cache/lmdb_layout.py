"""Is an LMDB file whole? LMDB maps its file, so touching a page beyond a truncated end kills the process.

The file is therefore looked at with plain reads first. A file may lawfully be shorter than its meta
page says (pages that were allocated and given up in one transaction are never written), so a short
file is walked: it is whole if every page that a tree refers to lies inside.

Source: the structures of LMDB 0.9 (``MDB_meta``, ``MDB_page``, ``MDB_node``, ``MDB_db``), 64-bit, little-endian.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import NamedTuple

from nurbs_cache.errors import CacheError

_META_MAGIC = 0xBEEFC0DE
_META_VERSION = 1
_PAGE_HEAD = 16
_BRANCH, _LEAF, _META, _FIXED = 0x01, 0x02, 0x08, 0x20  # page flags; fixed: values without nodes
_BIG, _SUB = 0x01, 0x02  # node flags: value on its own pages; value is a database
_NO_PAGE = 2**64 - 1
_DB_SIZE, _DB_ROOT = 48, 40


class _Meta(NamedTuple):
    page_size: int
    roots: tuple[int, int]  # free list, main
    last_page: int
    transaction: int


def check_whole(path: Path) -> None:
    """Refuse a ``data.mdb`` that is truncated or not LMDB's.

    Raises:
        CacheError: one line that names the file and what is wrong.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError as error:
        raise CacheError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        meta = _newest_meta(descriptor, path)
        n_pages = os.fstat(descriptor).st_size // meta.page_size
        if n_pages <= meta.last_page:
            _walk(descriptor, meta, n_pages, path)
    finally:
        os.close(descriptor)


def _newest_meta(descriptor: int, path: Path) -> _Meta:
    """The meta page of the last stored transaction."""
    head = os.pread(descriptor, 152, 0)
    metas = []
    if len(head) == 152:
        page_size = struct.unpack_from("<I", head, _PAGE_HEAD + 24)[0]
        for start in (0, page_size):
            meta = _parse_meta(os.pread(descriptor, 152, start))
            if meta:
                metas.append(meta)
    if not metas:
        raise CacheError(f"{path}: not an LMDB file of this system, or truncated")
    return max(metas, key=lambda meta: meta.transaction)


def _parse_meta(page: bytes) -> _Meta | None:
    if len(page) < 152:
        return None
    flags = struct.unpack_from("<H", page, 10)[0]
    magic, version = struct.unpack_from("<II", page, _PAGE_HEAD)
    if magic != _META_MAGIC or version != _META_VERSION or not flags & _META:
        return None
    databases = _PAGE_HEAD + 24  # free list, then main; the first field of the first is the page size
    page_size = struct.unpack_from("<I", page, databases)[0]
    free = struct.unpack_from("<Q", page, databases + _DB_ROOT)[0]
    main = struct.unpack_from("<Q", page, databases + _DB_SIZE + _DB_ROOT)[0]
    last_page, transaction = struct.unpack_from("<QQ", page, databases + 2 * _DB_SIZE)
    return _Meta(page_size, (free, main), last_page, transaction) if page_size >= 512 else None


def _walk(descriptor: int, meta: _Meta, n_pages: int, path: Path) -> None:
    """Visit every page of every tree by plain reads."""
    todo = list(meta.roots)
    while todo:
        number = todo.pop()
        if number == _NO_PAGE:
            continue
        page = os.pread(descriptor, meta.page_size, number * meta.page_size) if number < n_pages else b""
        if len(page) < meta.page_size:
            raise CacheError(f"{path}: truncated: page {number} is missing, the file has {n_pages}")
        children, last = _references(page, meta.page_size)
        if last >= n_pages:
            raise CacheError(f"{path}: truncated: page {last} is missing, the file has {n_pages}")
        todo += children


def _references(page: bytes, page_size: int) -> tuple[list[int], int]:
    """Tree pages that a page refers to, and the last of the pages that hold its long values (-1: none)."""
    flags, lower = struct.unpack_from("<HH", page, 10)
    if flags & _FIXED or not flags & (_BRANCH | _LEAF):
        return [], -1
    children: list[int] = []
    last = -1
    for offset in struct.unpack_from(f"<{(lower - _PAGE_HEAD) // 2}H", page, _PAGE_HEAD):
        low, high, node_flags, key_size = struct.unpack_from("<4H", page, offset)
        data = offset + 8 + key_size
        if flags & _BRANCH:
            children.append(low | high << 16 | node_flags << 32)
        elif node_flags & _SUB:
            children.append(struct.unpack_from("<Q", page, data + _DB_ROOT)[0])
        elif node_flags & _BIG:
            n_bytes = _PAGE_HEAD + (low | high << 16)
            last = max(last, struct.unpack_from("<Q", page, data)[0] + (n_bytes - 1) // page_size)
    return children, last
