"""Tables of rows in pages: reading a range, replacing everything, changing single rows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nurbs_cache import record
from nurbs_cache.errors import CorruptRecordError, MissingRecordError, UsageError
from nurbs_cache.keys import number_key
from nurbs_cache.raw_store import RawStore, Writing

PAGE_ROWS = 256  # 20 KiB of items, 44 KiB of nodes before compression

Rows = npt.NDArray[np.void]


def clean_rows(rows: npt.ArrayLike, dtype: np.dtype[np.void]) -> Rows:
    """A copy in ``dtype`` whose padding bytes are zero: equal rows are then equal bytes."""
    given = np.atleast_1d(np.asarray(rows))
    if given.dtype.names != dtype.names:
        raise UsageError(f"rows with fields {given.dtype.names}, want {dtype.names}")
    cleaned = np.zeros(given.shape, dtype)
    for name in dtype.names or ():
        cleaned[name] = given[name]
    return cleaned


def parse_rows(payload: bytes, dtype: np.dtype[np.void], what: str) -> Rows:
    """Read-only rows of a payload."""
    if len(payload) % dtype.itemsize:
        raise CorruptRecordError(f"{what}: {len(payload)} bytes are no whole number of rows of {dtype.itemsize}")
    return np.frombuffer(payload, dtype)


def replace_rows(writing: Writing, table: str, rows: Rows) -> None:
    """Make ``rows`` the whole table."""
    n_pages = -(-len(rows) // PAGE_ROWS)
    for key in writing.keys(table)[n_pages:]:
        writing.delete(table, key)
    for page in range(n_pages):
        part = rows[page * PAGE_ROWS : (page + 1) * PAGE_ROWS]
        writing.put(table, number_key(page), record.pack(part.tobytes()))


def read_rows(store: RawStore, table: str, dtype: np.dtype[np.void], first: int, count: int) -> Rows:
    """Rows ``first`` to ``first + count`` as a new, writable array; the caller has checked the range."""
    rows = np.zeros(count, dtype)
    done = 0
    while done < count:
        page, offset = divmod(first + done, PAGE_ROWS)
        what = f"{store.name}: page {page} of {table}"
        part = parse_rows(record.unpack(store.get(table, number_key(page)), what), dtype, what)[offset:]
        part = part[: count - done]
        if not len(part):
            raise CorruptRecordError(f"{what}: ends before row {first + done}")
        rows[done : done + len(part)] = part
        done += len(part)
    return rows


def update_rows(writing: Writing, table: str, numbers: npt.NDArray[np.int64], rows: Rows) -> None:
    """Replace the rows ``numbers`` by ``rows``; of a row given twice, the last one counts."""
    pages = numbers // PAGE_ROWS
    for page in np.unique(pages).tolist():
        what = f"page {page} of {table}"
        stored = writing.find(table, number_key(page))
        if stored is None:
            raise MissingRecordError(f"{what} is not stored")
        changed = parse_rows(record.unpack(stored, what), rows.dtype, what).copy()
        here = pages == page
        changed[numbers[here] - page * PAGE_ROWS] = rows[here]
        writing.put(table, number_key(page), record.pack(changed.tobytes()))
