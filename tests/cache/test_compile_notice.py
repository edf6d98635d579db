"""The one word about compiling: before the first kernel, and never again."""

from __future__ import annotations

import numba
import pytest

from nurbs_cache.compile_notice import on_first_compile
from nurbs_cache.jit import helper, note_run, ran_before


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_compiling_is_told_once() -> None:
    told = []
    on_first_compile(lambda: told.append(1))

    @helper
    def double(x: int) -> int:
        return 2 * x

    @numba.njit
    def run(x: int) -> int:
        return double(x)

    assert told == []
    assert run(3) == 6
    assert run(3.0) == 6.0
    assert told == [1]


def test_a_module_that_ran_is_remembered_until_its_source_changes(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("kernels")
    monkeypatch.setenv("NURBS_OOC_KERNEL_CACHE", str(folder))
    first, second = folder / "a.py", folder / "b.py"
    first.write_text("x = 1\n")
    second.write_text("x = 2\n")
    assert not ran_before(str(first))
    note_run(str(first))
    assert ran_before(str(first))
    assert not ran_before(str(second))
