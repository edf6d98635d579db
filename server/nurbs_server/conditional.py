"""Conditional and partial requests (RFC 9110, sections 13 and 14) as pure functions of the headers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

_ETAG = re.compile(r'(W/)?("[\x21\x23-\x7e\x80-\xff]*")')
_RANGE = re.compile(r"bytes=\s*(\d{0,18})-(\d{0,18})\s*")
_FIELDS = {
    b"if-match": "if_match",
    b"if-none-match": "if_none_match",
    b"range": "byte_range",
    b"if-range": "if_range",
}


@dataclass(frozen=True)
class Conditions:
    """The request's headers that make an answer conditional or partial, as they were sent."""

    if_match: str | None = None
    if_none_match: str | None = None
    byte_range: str | None = None
    if_range: str | None = None

    @classmethod
    def from_headers(cls, headers: Iterable[tuple[bytes, bytes]]) -> Conditions:
        """Pick them out of ASGI headers (lower-case names); repeated lists are joined."""
        found: dict[str, str] = {}
        for name, value in headers:
            field = _FIELDS.get(name)
            if field:
                text = value.decode("latin-1")
                found[field] = f"{found[field]},{text}" if field in found else text
        return cls(**found) if found else NO_CONDITIONS


NO_CONDITIONS = Conditions()


@dataclass(frozen=True)
class Decision:
    """Which status to answer with, and which bytes of the whole: ``start`` up to ``stop``."""

    status: int
    start: int = 0
    stop: int = 0


def etag_listed(header: str, etag: str, *, strong: bool) -> bool:
    """Whether a list of entity tags names ``etag`` (quoted, strong); "*" names all.

    Comparing strongly, a weak tag never matches.
    """
    if header.strip() == "*":
        return True
    return any(tag == etag and not (strong and weak) for weak, tag in _ETAG.findall(header))


def parse_range(header: str, size: int) -> tuple[int, int] | None:
    """First and past-the-end byte of a single range within ``size`` bytes.

    Returns:
        None where the header is to be ignored: another unit, several ranges, nonsense.
        An empty range (start == stop) means that it cannot be satisfied.
    """
    match = _RANGE.fullmatch(header.strip())
    if not match or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if not first:
        return max(0, size - int(last)), size
    start, stop = int(first), size if not last else min(size, int(last) + 1)
    if last and int(last) < int(first):
        return None
    return (start, stop) if start < size else (size, size)


def decide(conditions: Conditions, etag: str, size: int, *, ranges: bool = True) -> Decision:
    """The answer to a GET or HEAD of ``size`` bytes named ``etag``, in the order that the RFC gives.

    Args:
        conditions: of the request.
        etag: quoted, strong.
        size: of the whole body.
        ranges: False ignores Range, as for HEAD.
    """
    if conditions is NO_CONDITIONS:
        return Decision(200, 0, size)
    if conditions.if_match is not None and not etag_listed(conditions.if_match, etag, strong=True):
        return Decision(412)
    if conditions.if_none_match is not None and etag_listed(conditions.if_none_match, etag, strong=False):
        return Decision(304)
    if not ranges or conditions.byte_range is None:
        return Decision(200, 0, size)
    if conditions.if_range is not None and conditions.if_range.strip() != etag:
        return Decision(200, 0, size)
    span = parse_range(conditions.byte_range, size)
    if span is None:
        return Decision(200, 0, size)
    return Decision(206, *span) if span[0] < span[1] else Decision(416)
