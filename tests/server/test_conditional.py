"""Conditional and partial requests, case by case from RFC 9110."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nurbs_server.conditional import NO_CONDITIONS, Conditions, Decision, decide, etag_listed, parse_range

ETAG = '"abc"'
SIZE = 100


@pytest.mark.parametrize(
    ("header", "strong", "listed"),
    [
        ('"abc"', True, True),
        ('"abc"', False, True),
        ('W/"abc"', True, False),
        ('W/"abc"', False, True),
        ('"x", "abc" ,"y"', True, True),
        ('"a,b", W/"abc", "abc"', True, True),
        ("*", True, True),
        ('"abcd"', False, False),
        ("abc", False, False),  # not quoted: no entity tag
        ("", False, False),
    ],
)
def test_etag_lists(header: str, strong: bool, listed: bool) -> None:
    assert etag_listed(header, ETAG, strong=strong) is listed


@pytest.mark.parametrize(
    ("header", "span"),
    [
        ("bytes=0-0", (0, 1)),
        ("bytes=10-19", (10, 20)),
        ("bytes=90-", (90, 100)),
        ("bytes=90-1000", (90, 100)),
        ("bytes=-10", (90, 100)),
        ("bytes=-1000", (0, 100)),
        (" bytes= 5-6 ", (5, 7)),
        ("bytes=100-", (100, 100)),  # beyond the end
        ("bytes=-0", (100, 100)),  # the last no bytes: cannot be satisfied
        ("bytes=20-10", None),
        ("bytes=-", None),
        ("bytes=0-1,5-6", None),  # several ranges: all is sent instead
        ("lines=0-1", None),
        ("bytes=a-b", None),
        ("bytes=" + "9" * 5000 + "-", None),
        ("", None),
    ],
)
def test_ranges(header: str, span: tuple[int, int] | None) -> None:
    assert parse_range(header, SIZE) == span


@pytest.mark.parametrize(
    ("conditions", "decision"),
    [
        (NO_CONDITIONS, Decision(200, 0, SIZE)),
        (Conditions(if_match=ETAG), Decision(200, 0, SIZE)),
        (Conditions(if_match='"other"'), Decision(412)),
        (Conditions(if_none_match=ETAG), Decision(304)),
        (Conditions(if_none_match='"other"'), Decision(200, 0, SIZE)),
        (Conditions(if_match='"other"', if_none_match=ETAG), Decision(412)),  # If-Match comes first
        (Conditions(if_none_match=ETAG, byte_range="bytes=0-1"), Decision(304)),
        (Conditions(byte_range="bytes=0-1"), Decision(206, 0, 2)),
        (Conditions(byte_range="bytes=0-1", if_range=ETAG), Decision(206, 0, 2)),
        (Conditions(byte_range="bytes=0-1", if_range='"other"'), Decision(200, 0, SIZE)),
        (Conditions(byte_range="bytes=0-1", if_range='W/"abc"'), Decision(200, 0, SIZE)),  # weak never matches
        (Conditions(byte_range="bytes=0-1", if_range="Sat, 01 Jan 2000 00:00:00 GMT"), Decision(200, 0, SIZE)),
        (Conditions(byte_range="bytes=200-"), Decision(416)),
        (Conditions(byte_range="bytes=oops"), Decision(200, 0, SIZE)),
    ],
)
def test_decisions(conditions: Conditions, decision: Decision) -> None:
    assert decide(conditions, ETAG, SIZE) == decision


def test_range_is_for_get_only() -> None:
    assert decide(Conditions(byte_range="bytes=0-1"), ETAG, SIZE, ranges=False) == Decision(200, 0, SIZE)


def test_an_empty_body_has_no_range() -> None:
    assert decide(Conditions(byte_range="bytes=0-"), ETAG, 0) == Decision(416)


def test_headers_are_picked_out_and_joined() -> None:
    headers = [(b"host", b"x"), (b"if-none-match", b'"a"'), (b"range", b"bytes=0-1"), (b"if-none-match", b'"b"')]
    assert Conditions.from_headers(headers) == Conditions(if_none_match='"a","b"', byte_range="bytes=0-1")
    assert Conditions.from_headers([(b"accept", b"*/*")]) is NO_CONDITIONS


@given(st.text(max_size=40), st.integers(0, 1000))
def test_any_range_header_gives_a_range_within(header: str, size: int) -> None:
    span = parse_range("bytes=" + header, size)
    assert span is None or 0 <= span[0] <= span[1] <= size
