"""The error ledger."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nurbs_cache.errors import CorruptRecordError, UsageError
from nurbs_cache.ledger import Ledger

LENGTHS = st.floats(0.0, 1e300, allow_subnormal=True)
LEDGERS = st.builds(Ledger, *[LENGTHS] * 6)


@given(LEDGERS)
def test_total_is_never_below_a_sum(ledger: Ledger) -> None:
    total = Fraction(ledger.total)
    assert total >= sum(map(Fraction, ledger.terms))
    for order in list(permutations(ledger.terms))[::37]:
        assert ledger.total >= sum(order)
    assert total <= sum(map(Fraction, ledger.terms)) * (1 + Fraction(1, 2**48)) + Fraction(5e-324)


def test_single_term_is_exact() -> None:
    assert Ledger(trim=0.1).total == 0.1
    assert Ledger().total == 0.0


@given(LEDGERS)
def test_round_trip(ledger: Ledger) -> None:
    assert Ledger.from_bytes(ledger.to_bytes()) == ledger
    assert Ledger(**ledger.as_dict()) == ledger


@given(LEDGERS, LEDGERS)
def test_merge_takes_the_larger(a: Ledger, b: Ledger) -> None:
    merged = a.merge(b)
    assert merged == b.merge(a)
    assert merged.terms == tuple(map(max, a.terms, b.terms))
    assert merged.total >= max(a.total, b.total)


@pytest.mark.parametrize("value", [-1e-300, math.nan, math.inf])
def test_refuses_what_is_no_length(value: float) -> None:
    with pytest.raises(UsageError, match="pcurve"):
        Ledger(pcurve=value)


def test_refuses_bad_bytes() -> None:
    with pytest.raises(CorruptRecordError, match="47 bytes"):
        Ledger.from_bytes(bytes(47))
    with pytest.raises(CorruptRecordError, match="surface"):
        Ledger.from_bytes(b"\xff" * 48)
