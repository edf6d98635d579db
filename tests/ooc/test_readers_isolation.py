"""A kernel that crashes or hangs on one part costs that part only."""

from __future__ import annotations

import faulthandler
import os
import signal
import time
from collections.abc import Callable
from functools import partial

import pytest

from nurbs_cache.surface_record import FaceReason, FaceStatus, GeometryBatch
from nurbs_ooc.geometry.builder import BatchBuilder
from nurbs_ooc.geometry.sample_faces import add_plane
from nurbs_ooc.readers.isolation import WorkDiedError, run_isolated
from nurbs_ooc.readers.part_geometry import PartSource, isolated_parts


def sound() -> GeometryBatch:
    builder = BatchBuilder()
    add_plane(builder)
    return builder.build()


def crash(how: int) -> GeometryBatch:
    faulthandler.disable()  # pytest's would print a stack of the process that is meant to die
    os.kill(os.getpid(), how)
    raise AssertionError("unreachable")


def hang() -> GeometryBatch:
    time.sleep(60)
    return sound()


def raises() -> GeometryBatch:
    raise RuntimeError("not a kernel error")


def statuses(parts: list[PartSource], limit_s: float = 30.0) -> list[list[tuple[int, int]]]:
    batches = [GeometryBatch.from_bytes(data) for data in isolated_parts(parts, limit_s)]
    return [[(int(s["status"]), int(s["reason"])) for s in batch.surfaces] for batch in batches]


GOOD = [(FaceStatus.EXACT, FaceReason.NONE)]
LOST = (FaceStatus.FAILED, FaceReason.KERNEL_CRASHED)


@pytest.mark.parametrize("how", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_crashed_part_is_marked_and_the_others_come(how: int) -> None:
    parts = [
        PartSource("a", [0], sound),
        PartSource("b", [2, 1, 1], partial(crash, how)),
        PartSource("c", [0], sound),
        PartSource("d", [0], partial(crash, how)),
    ]
    assert statuses(parts) == [GOOD, [LOST] * 3, GOOD, [LOST]]


def test_crashed_part_keeps_its_materials_and_names() -> None:
    [data] = isolated_parts([PartSource("b", [2, 1], partial(crash, signal.SIGSEGV))])
    batch = GeometryBatch.from_bytes(data)
    assert list(batch.surfaces["material"]) == [2, 1]
    assert batch.sources == ["b/face 1", "b/face 2"]


def test_hanging_part_is_given_up() -> None:
    parts = [PartSource("a", [0], hang), PartSource("b", [0], sound)]
    assert statuses(parts, limit_s=0.5) == [[LOST], GOOD]


def test_python_error_costs_the_part_too(capfd: pytest.CaptureFixture[str]) -> None:
    assert statuses([PartSource("a", [0], raises), PartSource("b", [0], sound)]) == [[LOST], GOOD]
    assert "not a kernel error" in capfd.readouterr().err


def test_what_was_sent_before_the_end_arrives() -> None:
    def work(send: Callable[[object], None]) -> None:
        send(1)
        send(b"x" * 1_000_000)
        crash(signal.SIGKILL)

    items = run_isolated(work)
    assert next(items) == 1
    assert next(items) == b"x" * 1_000_000
    with pytest.raises(WorkDiedError):
        next(items)
